"""What the service answers, asked over HTTP."""

from __future__ import annotations

import asyncio
import io
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image
from tests.serve.running_service import RunningService, running

from everplace.images.decoding import ImageSpec, decode_image
from everplace.mapping.localizer import Localizer
from everplace.mapping.route_map import Map
from everplace.serve.http_app import build_app
from everplace.serve.map_service import MapService
from everplace.serve.service_limits import DEFAULT_LIMITS


def test_a_frame_is_answered_as_by_localize(
    service: RunningService, unchanged_three_map: Path, winter: list[Path]
) -> None:
    alone = Localizer(unchanged_three_map, sequence=1)
    for path in winter[20:24]:
        expected = alone.locate(decode_image(path, ImageSpec()), 1.5).to_dict()
        answer = service.localize(path, time="1.5").json()
        assert answer.pop("version") == 3
        assert answer.pop("frame") == path.stem
        assert answer == json.loads(json.dumps(expected))


def test_a_session_keeps_its_filter_beside_others(
    service: RunningService, unchanged_three_map: Path, winter: list[Path]
) -> None:
    there, back = Localizer(unchanged_three_map), Localizer(unchanged_three_map)
    for one, other in zip(winter[:14], winter[::-1], strict=False):
        for name, localizer, path in (("there", there, one), ("back", back, other)):
            expected = localizer.locate(decode_image(path, ImageSpec())).probability
            assert service.localize(path, session=name).json()["probability"] == pytest.approx(expected)
    assert service.client.delete("/sessions/there").status_code == 204
    assert service.client.delete("/sessions/there").status_code == 404
    anew = Localizer(unchanged_three_map).locate(decode_image(winter[5], ImageSpec())).probability
    assert service.localize(winter[5], session="there").json()["probability"] == pytest.approx(anew)


def test_matches_and_details_are_what_the_answer_rests_on(service: RunningService, winter: list[Path]) -> None:
    answer = service.localize(winter[33], matches="4", details="true", frame="my name", session="details").json()
    assert answer["frame"] == "my name"
    matches = answer["matches"]
    assert len({match["place"] for match in matches}) == 4
    same = ("place", "drive", "database_frame", "score", "probability")
    assert {key: matches[0][key] for key in same} == {key: answer[key] for key in same}
    assert answer["places_per_bin"] == 1
    assert len(answer["belief"]) == len(answer["similarity"]) == 60
    assert sum(answer["belief"]) + answer["off_map"] == pytest.approx(1)
    assert int(np.argmax(answer["similarity"])) == 33
    assert answer["similarity"][33] == pytest.approx(answer["score"])
    for match in matches:
        info = service.client.get(f"/frames/{match['id']}/info").json()
        assert (info["drive"], info["condition"], info["frame"], info["place"]) == (
            match["drive"], match["condition"], match["database_frame"], match["place"],
        )  # fmt: skip


def test_what_was_not_asked_for_is_not_said(service: RunningService, winter: list[Path]) -> None:
    answer = service.localize(winter[0]).json()
    assert not {"matches", "belief", "similarity", "places_per_bin"} & set(answer)


def test_the_map_is_that_of_map_info(service: RunningService, unchanged_three_map: Path) -> None:
    shown, info = service.client.get("/map").json(), json.loads(json.dumps(Map.open(unchanged_three_map).info()))
    assert {key: shown[key] for key in info} == info


def test_every_frame_of_the_map_has_its_thumbnail(service: RunningService, unchanged_three_map: Path) -> None:
    table = Map.open(unchanged_three_map).frames("thumbnail", "stem")
    for row in (0, 59, 60, 125, 179):
        response = service.client.get(f"/frames/{row}")
        assert response.headers["content-type"] == "image/jpeg"
        assert response.content == table["thumbnail"][row].as_py()
        assert service.client.get(f"/frames/{row}/info").json()["frame"] == table["stem"][row].as_py()


def test_what_a_browser_has_is_not_sent_again(service: RunningService) -> None:
    for path in ("/frames/7", "/map", "/"):
        first = service.client.get(path)
        assert first.status_code == 200
        again = service.client.get(path, headers={"If-None-Match": first.headers["etag"]})
        assert (again.status_code, again.content) == (304, b"")
    assert service.client.get("/frames/8", headers={"If-None-Match": first.headers["etag"]}).status_code == 200


def test_a_number_of_another_version_is_refused(service: RunningService) -> None:
    assert service.client.get("/frames/7?version=3").status_code == 200
    response = service.client.get("/frames/7?version=2")
    assert (response.status_code, response.json()["detail"]) == (
        404, "the map has become version 3 meanwhile; ask /map again",
    )  # fmt: skip


def test_health_and_metrics(service: RunningService, winter: list[Path]) -> None:
    assert service.client.get("/healthz").json() == {"status": "ok", "version": 3}

    def counted(text: str) -> float:
        begin = 'everplace_requests_total{method="POST",route="/localize",status="200"} '
        return sum(float(line.removeprefix(begin)) for line in text.splitlines() if line.startswith(begin))

    before = counted(service.client.get("/metrics").text)
    service.localize(winter[0], session="counted")
    after = service.client.get("/metrics")
    assert after.headers["content-type"].startswith("text/plain")
    assert counted(after.text) == before + 1
    assert "everplace_map_version 3.0" in after.text
    assert 'everplace_request_seconds_bucket{le="+Inf",route="/localize"}' in after.text
    sessions = next(line for line in after.text.splitlines() if line.startswith("everplace_sessions "))
    assert float(sessions.split()[1]) >= 1


def test_no_address_of_a_request_becomes_a_label(service: RunningService) -> None:
    service.client.get("/secret-of-mine")
    assert "secret" not in service.client.get("/metrics").text


def test_the_interface_is_described_without_other_hosts(service: RunningService) -> None:
    described = service.client.get("/openapi.json").json()
    assert {"/localize", "/map", "/frames/{id}", "/frames/{id}/info", "/translate", "/healthz", "/metrics"} <= set(
        described["paths"]
    )
    assert service.client.get("/docs").status_code == 404


def png(width: int, height: int) -> bytes:
    file = io.BytesIO()
    Image.new("L", (width, height)).save(file, "PNG")
    return file.getvalue()


@pytest.mark.parametrize(
    ("content", "status", "said"),
    [
        (b"", 400, "empty, broken or of an unknown kind"),
        (b"GIF89a", 400, "empty, broken or of an unknown kind"),
        (png(64, 64)[:-20], 400, "empty, broken or of an unknown kind"),
        (b"\xff\xd8\xff\xe0" + b"\0" * 100, 400, "empty, broken or of an unknown kind"),
        (b"P6 99999 9999 255\n", 413, "pixels"),
        (png(6000, 5000), 413, "25000000 pixels"),
    ],
)
def test_what_is_no_image_is_refused(service: RunningService, content: bytes, status: int, said: str) -> None:
    response = service.client.post("/localize", files={"image": ("x.png", content)})
    assert response.status_code == status
    assert said in response.json()["detail"]


@pytest.mark.parametrize(
    ("fields", "status"),
    [
        ({"matches": "21"}, 422), ({"matches": "-1"}, 422), ({"matches": "many"}, 422), ({"time": "nan"}, 422),
        ({"time": "1e999"}, 422), ({"session": "../x"}, 422), ({"session": "x" * 65}, 422),
        ({"details": "perhaps"}, 422), ({"frame": "x" * 257}, 422), ({"session": "", "time": ""}, 200),
        ({"frame": "\u2028\u0000é"}, 200),
    ],
)  # fmt: skip
def test_fields_are_checked(service: RunningService, winter: list[Path], fields: dict[str, str], status: int) -> None:
    response = service.localize(winter[0], **fields)
    assert response.status_code == status
    if status == 422:
        assert response.json()["detail"].startswith(next(iter(fields)))


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        ("application/json", b'{"image": 1}'),
        ("multipart/form-data", b"no boundary"),
        ("multipart/form-data; boundary=x", b"--y"),
        (
            "multipart/form-data; boundary=x",
            b'--x\r\nContent-Disposition: form-data; name="image"\r\n\r\ntext\r\n--x--\r\n',
        ),
        ("application/x-www-form-urlencoded", b"image=%ff%fe"),
        ("text/plain", b""),
    ],
)
def test_forms_without_an_image_are_refused(service: RunningService, kind: str, body: bytes) -> None:
    response = service.client.post("/localize", content=body, headers={"Content-Type": kind})
    assert response.status_code == 400
    assert set(response.json()) == {"detail"}


@pytest.mark.parametrize("charset", ["unicode_escape", "utf-7", "utf-16", "idna", "hex", "no-such"])
def test_text_of_any_encoding_is_no_trouble(service: RunningService, winter: list[Path], charset: str) -> None:
    content = winter[0].read_bytes()
    body = (
        b'--x\r\nContent-Disposition: form-data; name="frame"\r\n\r\n\\ud800+2AA-\r\n'
        b'--x\r\nContent-Disposition: form-data; name="image"; filename="a.png"\r\n\r\n' + content + b"\r\n--x--\r\n"
    )
    kind = f"multipart/form-data; boundary=x; charset={charset}"
    response = service.client.post("/localize", content=body, headers={"Content-Type": kind})
    assert response.status_code in (200, 400, 422)


@pytest.mark.parametrize(
    "path", ["/frames/180", "/frames/9007199254740992", "/page/..%2fmap_service.py", "/page/nope.js", "/nothing"]
)
def test_what_is_not_there(service: RunningService, path: str) -> None:
    response = service.client.get(path)
    assert response.status_code == 404
    assert set(response.json()) == {"detail"}


def test_the_page_is_served_by_fixed_names(service: RunningService) -> None:
    page = service.client.get("/")
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    assert service.client.get("/page/main.js").headers["content-type"] == "text/javascript; charset=utf-8"
    assert service.client.get("/page/style.css").headers["content-type"] == "text/css; charset=utf-8"


def test_a_map_of_a_method_without_decoder_translates_nothing(service: RunningService, winter: list[Path]) -> None:
    response = service.client.post("/translate", files={"image": winter[0].read_bytes()}, data={"condition": "winter"})
    assert response.status_code == 404
    assert "cannot show a frame in another condition" in response.json()["detail"]
    assert service.client.get("/map").json()["decodes"] is False


def test_files_of_a_megabyte_and_more(service: RunningService, winter: list[Path]) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (1200, 1200, 3), np.uint8)
    file = io.BytesIO()
    Image.fromarray(noise).save(file, "PNG")
    assert len(file.getvalue()) > 4 << 20
    assert service.client.post("/localize", files={"image": ("noise.png", file.getvalue())}).json()["frame"] == "noise"


@pytest.mark.slow
def test_a_map_that_grows_meanwhile(summer_map: Path, unchanged_rendered_route: Path, winter: list[Path]) -> None:
    with running(summer_map, look_seconds=0.2) as service, ThreadPoolExecutor(1) as pool:
        first = service.localize(winter[30], session="drive").json()
        assert (first["version"], first["provisional"]) == (1, True)
        adding = pool.submit(lambda: Map.open(summer_map).add(unchanged_rendered_route / "winter"))
        versions = [1]
        while versions[-1] == 1 or not adding.done():
            answer = service.localize(winter[30], session="other")
            assert answer.status_code == 200
            versions.append(answer.json()["version"])
            assert len(versions) < 5000, adding.exception(timeout=1)
        assert set(versions) == {1, 2}
        assert versions == sorted(versions)
        later = service.localize(winter[31], session="drive").json()
        assert (later["version"], later["drive"], later["place"]) == (2, "winter", 31)
        anew = Localizer(summer_map).locate(decode_image(winter[31], ImageSpec())).probability
        assert later["probability"] == pytest.approx(anew)  # the session began again
        assert service.client.get("/map").json()["drives"][1]["name"] == "winter"
        assert service.client.get("/healthz").json()["version"] == 2


def test_a_failure_is_one_sentence_without_its_details(
    unchanged_summer_map: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(row: int) -> dict[str, object]:
        raise RuntimeError(f"secret of row {row}")

    service = MapService(unchanged_summer_map, DEFAULT_LIMITS)
    monkeypatch.setattr(service.map.loaded, "frame", fail)
    app = build_app(service, host="127.0.0.1")

    async def asked() -> httpx.Response:
        transport = httpx.ASGITransport(app=app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await client.get("/frames/3/info")

    answer = asyncio.run(asked())
    service.close()
    assert (answer.status_code, answer.json()) == (500, {"detail": "the service failed; it has logged why"})
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert "secret of row 3" in capsys.readouterr().err
