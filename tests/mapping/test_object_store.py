"""Maps at an object store's address: the same code, against a server on this machine."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from tests.cli.test_main import call, refused
from tests.mapping.drives import copied, images_of

from everplace.errors import EverplaceError, MapError
from everplace.mapping import place_search
from everplace.mapping.localizer import Localizer
from everplace.mapping.route_map import Map

pytestmark = pytest.mark.slow

T = TypeVar("T")
BUCKET = "maps"


@pytest.fixture(scope="module")
def store() -> Iterator[str]:
    """The address of an empty bucket; the environment says how to get there."""
    boto3 = pytest.importorskip("boto3", reason="needs the extra dev")
    moto = pytest.importorskip("moto.server", reason="needs the extra dev")
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (
            ("AWS_ENDPOINT", f"http://{host}:{port}"),
            ("AWS_ALLOW_HTTP", "true"),
            ("AWS_ACCESS_KEY_ID", "key"),
            ("AWS_SECRET_ACCESS_KEY", "secret"),
            ("AWS_REGION", "us-east-1"),
        ):
            patch.setenv(name, value)
        boto3.client("s3", endpoint_url=f"http://{host}:{port}", region_name="us-east-1").create_bucket(Bucket=BUCKET)
        yield f"s3://{BUCKET}"
    server.stop()


@pytest.fixture(scope="module")
def upload(store: str, drives: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    """Copies a map of summer and autumn that was made in a directory to the store, under a name."""
    import boto3

    made = tmp_path_factory.mktemp("map") / "made"
    Map.create(made, drives / "summer", method="hog16").add(drives / "autumn")
    client = boto3.client("s3", endpoint_url=os.environ["AWS_ENDPOINT"], region_name="us-east-1")

    def copy(name: str) -> str:
        for path in made.rglob("*"):
            if path.is_file():
                client.upload_file(str(path), BUCKET, f"{name}/{path.relative_to(made).as_posix()}")
        return f"{store}/{name}"

    return copy


@pytest.fixture(scope="module")
def drives(unchanged_rendered_route: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 30 frames of each drive."""
    path = tmp_path_factory.mktemp("drives")
    for name in ("summer", "autumn", "winter"):
        copied(unchanged_rendered_route / name, path / name, slice(30))
    return path


def meanwhile(when: str, what: Callable[[], object]) -> Callable[..., Iterator[T]]:
    """A progress in which something happens once, when the work comes to `when`."""
    due = [what]

    def progress(items: Iterable[T], said: str, total: int | None = None) -> Iterator[T]:
        if said.startswith(when) and due:
            due.pop()()
        yield from items

    return progress


def test_from_create_to_restore(store: str, drives: Path, tmp_path: Path) -> None:
    address, beside = f"{store}/route", tmp_path / "beside"
    for where in (address, beside):
        Map.create(where, drives / "summer", method="hog16").add(drives / "autumn")
    there, here = Map.open(address), Map.open(beside)
    assert (
        there.frames("stem", "place", "thumbnail").to_pydict() == here.frames("stem", "place", "thumbnail").to_pydict()
    )
    np.testing.assert_array_equal(there.descriptors(), here.descriptors())
    assert there.verify() == []
    assert there.info()["bytes"] is None
    image = images_of(drives / "winter")[12]
    assert Localizer(address).locate(image) == Localizer(beside).locate(image)
    there.remove("autumn")
    there.restore(2)
    assert [one["version"] for one in Map.open(address).versions()] == [1, 2, 3, 4]
    assert Map.open(address).drives == ("summer", "autumn")
    with pytest.raises(MapError, match="a map stands at s3://.*already"):
        Map.create(address, drives / "winter", method="hog16")


def test_the_command_takes_an_address(upload: Callable[[str], str], drives: Path) -> None:
    address = upload("by-command")
    status, out, _ = call("localize", address, drives / "winter", "--json-lines")
    assert (status, len(out.splitlines())) == (0, 30)
    assert call("map", "verify", address)[0] == 0


@pytest.mark.parametrize(
    ("when", "change"), [("describing", "add"), ("describing", "remove"), ("learning", "add"), ("learning", "remove")]
)
def test_of_two_writers_one_is_refused_and_the_map_is_whole(
    upload: Callable[[str], str], drives: Path, when: str, change: str
) -> None:
    """The other one is through when the first has come to `when`."""
    address = upload(f"race-{when}-{change}")

    def other() -> None:
        if change == "add":
            Map.open(address).add(drives / "winter", name="first")
        else:
            Map.open(address).remove("autumn")

    with pytest.raises(
        MapError, match="another process changed the map .* meanwhile.*give the command again"
    ) as caught:
        Map.open(address).add(drives / "winter", name="second", progress=meanwhile(when, other))
    assert len(str(caught.value).splitlines()) == 1
    winner = Map.open(address)
    assert winner.drives == (("summer", "autumn", "first") if change == "add" else ("summer",))
    assert [one["version"] for one in winner.versions()] == [1, 2, 3]
    assert winner.verify() == []
    winner.add(drives / "winter", name="second")
    assert Map.open(address).drives[-1] == "second"
    assert Map.open(address).verify() == []


def test_a_remover_that_is_late_is_refused(upload: Callable[[str], str], drives: Path) -> None:
    address = upload("late")
    with pytest.raises(MapError, match="another process changed the map"):
        Map.open(address).remove(
            "autumn", meanwhile("learning", lambda: Map.open(address).add(drives / "winter", learn=False))
        )
    assert Map.open(address).drives == ("summer", "autumn", "winter")
    assert Map.open(address).verify() == []


def test_a_map_that_somebody_else_made_meanwhile_stays(store: str, drives: Path) -> None:
    address = f"{store}/twice"
    first = meanwhile("describing", lambda: Map.create(address, drives / "autumn", method="hog16"))
    with pytest.raises(MapError, match="a map stands at"):
        Map.create(address, drives / "summer", method="hog16", progress=first)
    assert Map.open(address).drives == ("autumn",)
    assert Map.open(address).verify() == []


def test_a_graph_of_such_a_map_lies_in_the_cache(
    upload: Callable[[str], str], drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("faiss", reason="needs the extra faiss")
    address = upload("graph")
    image = images_of(drives / "autumn")[12]
    exact = Localizer(address).locate(image)
    monkeypatch.setattr(place_search, "EXACT_BELOW", 10)
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path / "cache"))
    assert Localizer(address).locate(image).place == exact.place
    assert len(list((tmp_path / "cache").rglob("*.hnsw"))) == 1


def test_what_is_not_there_is_told_in_a_sentence(store: str) -> None:
    assert "there is no map at s3://maps/none" in refused("map", "info", f"{store}/none")
    message = refused("map", "info", "s3://no-such-bucket/map")
    assert "cannot look for a map at s3://no-such-bucket/map (The specified bucket does not exist)" in message
    with pytest.raises(EverplaceError, match="what the environment says of it"):
        Map.open("s3://no-such-bucket/map")
