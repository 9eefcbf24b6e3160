"""The page in a real browser, on a real service: a user's way through it, by pointer and by keyboard."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image
from tests.experiments.comparing import untrained_run
from tests.serve.running_service import RunningService, running

from everplace.mapping.route_map import Map

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Position, Response

DRIVE = 14
"""Frames of the played drives: longer than the filter looks back."""

pytestmark = pytest.mark.slow


@dataclass
class Opened:
    """The page, and what went over the wire for it.

    Attributes:
        page: In the browser.
        url: Of the service.
        complaints: What the browser's console said.
        requests: Addresses that were asked for.
        answers: Of `/localize`, in order.
    """

    page: Page
    url: str
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)
    answers: list[dict[str, Any]] = field(default_factory=list)

    def text(self, selector: str) -> str:
        return self.page.locator(selector).inner_text().replace("\u00a0", " ").replace("\u2212", "-")

    def choose(self, *files: Path) -> None:
        self.page.set_input_files("#frames-input", list(files))

    def play(self, *files: Path) -> None:
        """Plays a drive to its end, as fast as it goes."""
        self.answers.clear()
        self.choose(*files)
        self.page.select_option("#speed", "0")
        self.page.locator("#play", has_text="Play again").wait_for()

    def focus_by_tab(self, identifier: str) -> None:
        """Presses Tab until the element has the focus, which must be visible."""
        for _ in range(60):
            if self.page.evaluate("document.activeElement.id") == identifier:
                outline = self.page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
                assert outline != "none"
                return
            self.page.keyboard.press("Tab")
        raise AssertionError(f"Tab never reaches {identifier}")


@contextmanager
def opened(browser: Browser, url: str, width: int = 1280, scheme: Any = "light") -> Iterator[Opened]:
    context = browser.new_context(color_scheme=scheme, viewport={"width": width, "height": 900})
    page = context.new_page()
    seen = Opened(page, url)
    page.on("console", lambda message: seen.complaints.append(message.text))
    page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    page.on("request", lambda request: seen.requests.append(request.url))

    def keep(response: Response) -> None:
        if response.url.endswith("/localize") and response.ok:
            seen.answers.append(response.json())

    page.on("response", keep)
    page.goto(url)
    yield seen
    strange = [one for one in seen.requests if not one.startswith((url, "blob:" + url, "data:"))]
    assert strange == []
    context.close()


def drop(seen: Opened, *files: Path) -> None:
    """Drops files on the page, as from a file manager."""
    given = [(path.name, base64.b64encode(path.read_bytes()).decode()) for path in files]
    transfer = seen.page.evaluate_handle(
        """(files) => {
            const transfer = new DataTransfer();
            for (const [name, text] of files) {
                const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
                transfer.items.add(new File([bytes], name, { type: "image/png" }));
            }
            return transfer;
        }""",
        given,
    )
    seen.page.dispatch_event("body", "dragenter", {"dataTransfer": transfer})
    assert seen.page.locator("#drop-sign").is_visible()
    seen.page.dispatch_event("body", "drop", {"dataTransfer": transfer})
    assert seen.page.locator("#drop-sign").is_hidden()


def shown_percent(text: str) -> float:
    found = re.search(r"([\d.]+) %", text)
    assert found, text
    return float(found[1]) / 100


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1280])
def test_the_whole_story(
    browser: Browser, service: RunningService, winter: list[Path], width: int, scheme: Any
) -> None:
    with opened(browser, service.url, width, scheme) as seen:
        page = seen.page
        page.locator("#coverage-table tbody tr").first.wait_for()
        assert "60 places, 3 drives (summer, autumn and winter), hog16" in seen.text("#map-summary")
        assert page.locator("#query-empty").is_visible()
        assert page.locator("#matrix-empty").is_visible()

        drop(seen, winter[33])
        page.locator("#sentence").wait_for()
        alone = service.localize(winter[33]).json()
        assert alone["place"] == 33
        assert re.fullmatch(r"At place 33 with [\d> ]+ %, looks like winter\.", seen.text("#sentence"))
        assert shown_percent(seen.text("#sentence")) == pytest.approx(alone["probability"], abs=0.01)
        assert seen.text("#live") == f"Frame {winter[33].stem}: {seen.text('#sentence')}"
        page.locator("#match-image[src]").wait_for()
        assert seen.text("#match-caption") == f"Best match: place 33, frame {winter[33].stem} of winter"
        assert page.locator("#matches li").count() == 6
        # A tall strip and the ring: the answer on the route, of which the map knows the poses.
        assert page.locator("#belief-chart .answer-mark").count() == 1
        assert page.locator("#poses-chart .ring").count() == 1

        before = seen.text("#threshold-text")
        page.locator("#threshold-slider").fill("0.2")
        assert seen.text("#threshold-text") != before
        assert "held-out answers" in seen.text("#threshold-text")

        seen.play(*winter[:DRIVE])
        assert len(seen.answers) == DRIVE
        assert seen.text("#position-text") == f"{DRIVE} of {DRIVE}"
        canvas = page.locator("#matrix-chart canvas")
        assert [int(canvas.get_attribute(side) or 0) for side in ("width", "height")] == [60, DRIVE]
        canvas.scroll_into_view_if_needed()
        box = canvas.bounding_box()
        assert box is not None
        cell: Position = {"x": box["width"] * 5.5 / 60, "y": box["height"] * 7.5 / DRIVE}
        canvas.hover(position=cell)
        cosine = seen.answers[7]["similarity"][5]
        assert f"Frame 7 ({winter[7].stem}), place 5: cosine {cosine:.3f}" in seen.text("#matrix-readout")
        canvas.click(position=cell)
        assert f"Frame 7 and place 5: cosine {cosine:.3f}" in seen.text("#pair-text")
        assert "Place 5: frame" in seen.text("#pair-place-caption")
        page.locator("#pair-go").click()
        assert seen.text("#query-caption") == f"Query: {winter[7].stem}"

        page.locator("#truth").check()
        page.locator("#threshold-slider").fill("0")
        assert f"{DRIVE} of {DRIVE} answers of the played drive are accepted, " in seen.text("#threshold-text")
        assert seen.text("#verdict") == "✓ right"

        assert page.evaluate("document.documentElement.scrollWidth") <= width
        for picture in page.locator("figure svg, figure img, canvas").all():
            place = picture.bounding_box()
            if place is not None:
                assert place["x"] >= 0
                assert place["x"] + place["width"] <= width
        ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (ground == "rgb(255, 255, 255)") == (scheme == "light")
        assert seen.complaints == []


def test_it_is_all_done_by_keyboard(browser: Browser, service: RunningService, winter: list[Path]) -> None:
    with opened(browser, service.url) as seen:
        page = seen.page
        page.on("filechooser", lambda _: None)  # so that no chooser of the system opens before one is waited for
        page.locator("#coverage-table tbody tr").first.wait_for()
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.className") == "skip"
        seen.focus_by_tab("choose-frames")
        with page.expect_file_chooser() as chooser:
            page.keyboard.press("Enter")
        chooser.value.set_files(winter[:DRIVE])
        page.select_option("#speed", "1")
        page.locator("#position-text", has_text=re.compile("^[3-9] of")).wait_for()
        page.keyboard.press("Space")
        page.locator("#play", has_text="Play").wait_for()
        page.wait_for_load_state("networkidle")  # the frame that was asked about is shown still
        at = int(page.locator("#position").input_value())
        page.keyboard.press("ArrowRight")
        page.locator("#query-caption", has_text=winter[at + 1].stem).wait_for()
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("ArrowLeft")
        page.locator("#query-caption", has_text=winter[max(at - 1, 0)].stem).wait_for()
        page.keyboard.press("Space")
        page.locator("#play", has_text="Play again").wait_for()

        canvas = page.locator("#matrix-chart canvas")
        canvas.focus()
        for key in ("ArrowDown", "ArrowDown", "ArrowRight", "Shift+ArrowRight"):
            page.keyboard.press(key)
        assert f"Frame 2 ({winter[2].stem}), place 11: cosine" in seen.text("#matrix-readout")
        page.keyboard.press("Enter")
        assert "Frame 2 and place 11: cosine" in seen.text("#pair-text")
        page.keyboard.press("End")
        assert "place 59: cosine" in seen.text("#matrix-readout")

        seen.focus_by_tab("truth")
        page.keyboard.press("Space")
        page.locator("#threshold-slider").focus()
        page.keyboard.press("Home")
        assert seen.text("#threshold-value") == "0.00"
        assert f"{DRIVE} of {DRIVE} answers" in seen.text("#threshold-text")
        page.keyboard.press("End")
        assert seen.text("#threshold-value") == "1.00"
        page.locator("#coverage-chart [tabindex]").focus()
        page.keyboard.press("ArrowDown")
        assert seen.text("#coverage-readout") == "Place 0 in autumn: 1 frame."
        assert seen.complaints == []


def test_precision_and_recall_are_those_of_the_answers(
    browser: Browser, service: RunningService, winter: list[Path], unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    """Frames of a summer drive run backwards under names of other places are wrong; two names are not on the map."""
    played = []
    names = [*(winter[place].stem for place in range(8)), *(winter[place].stem for place in (50, 51)), "x1", "x2"]
    shown = [*range(8), 20, 21, 30, 31]
    for number, (name, place) in enumerate(zip(names, shown, strict=True)):
        path = tmp_path / f"{number:02d}" / f"{name}.png"
        path.parent.mkdir()
        path.write_bytes((unchanged_rendered_route / "autumn" / winter[place].name).read_bytes())
        played.append(path)
    with opened(browser, service.url) as seen:
        seen.page.locator("#coverage-table tbody tr").first.wait_for()
        seen.play(*played)
        assert seen.page.locator("#truth-note").inner_text() == "10 of 12 frame names are those of frames of the map."
        seen.page.locator("#truth").check()
        expected = {name: place for place, name in enumerate(path.stem for path in winter)}
        right = np.array([abs(one["place"] - expected.get(one["frame"], -9)) <= 1 for one in seen.answers])
        probability = np.array([one["probability"] for one in seen.answers])
        assert 0 < right.sum() < 10
        for threshold in (0.0, 0.3, 0.6, 0.9):
            seen.page.locator("#threshold-slider").fill(str(threshold))
            accepted = probability >= threshold
            good = int((accepted & right).sum())
            are = "is" if accepted.sum() == 1 else "are"
            sentence = (
                f"{accepted.sum()} of 12 answers of the played drive {are} accepted, "
                f"{good} right and {accepted.sum() - good} wrong: precision {100 * good / accepted.sum():.1f} %, "
                f"recall {100 * good / 10:.1f} %."
            )
            assert sentence in seen.text("#threshold-text")
        # A threshold that wrong answers pass shows them as crosses, in the picture too.
        seen.page.locator("#threshold-slider").fill("0")
        for chart in ("#answers-chart", "#matrix-chart"):
            discs = seen.page.locator(f"{chart} .mark.right").get_attribute("d") or ""
            crosses = seen.page.locator(f"{chart} .mark.wrong").get_attribute("d") or ""
            assert discs.count("a") == 2 * right.sum()
            assert crosses.count("M") == 2 * (~right).sum()
        seen.page.locator("#tolerance").fill("60")
        assert "10 right and 2 wrong" in seen.text("#threshold-text")


def test_a_frame_elsewhere_is_not_on_the_map(browser: Browser, service: RunningService, tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (64, 128, 3), np.uint8)
    path = tmp_path / "noise.png"
    Image.fromarray(noise).save(path)
    answer = service.localize(path).json()
    assert answer["off_map"] > 0.5
    with opened(browser, service.url) as seen:
        seen.choose(path)
        seen.page.locator("#sentence").wait_for()
        assert re.fullmatch(r"Not on this map \([\d> ]+ %\)\.", seen.text("#sentence"))
        assert shown_percent(seen.text("#sentence")) == pytest.approx(answer["off_map"], abs=0.01)
        assert seen.page.locator("#belief-chart .answer-mark").count() == 0
        assert seen.text("#match-caption").startswith("Most alike on the map: ")


def test_a_map_of_one_drive_says_that_it_is_provisional(
    browser: Browser, unchanged_summer_map: Path, winter: list[Path]
) -> None:
    with running(unchanged_summer_map) as service, opened(browser, service.url) as seen:
        seen.choose(winter[10])
        seen.page.locator("#sentence").wait_for()
        assert seen.text("#provisional").startswith("Provisional: ")
        assert seen.text("#live").endswith(" Provisional.")
        assert seen.text("#curve-empty").startswith("No curve yet.")
        assert "No two drives share places yet" in seen.text("#learned-text")
        assert seen.complaints == []


def test_holes_of_the_map_are_named(
    browser: Browser, summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    part = tmp_path / "autumn"
    part.mkdir()
    for path in sorted((unchanged_rendered_route / "autumn").glob("*.png"))[20:50]:
        (part / path.name).write_bytes(path.read_bytes())
    Map.open(summer_map).add(part, align="names")
    with running(summer_map) as service, opened(browser, service.url) as seen:
        row = seen.page.locator("#coverage-table tbody tr", has_text="autumn")
        row.wait_for()
        assert row.locator("td").all_inner_texts() == ["1", "30 of 60", "0 to 19 and 50 to 59"]
        levels = [one.get_attribute("class") for one in seen.page.locator("#coverage-chart .level").all()]
        assert levels == [f"level level-{number}" for number in (1, 0, 1, 0)]
        cells = seen.page.locator("#learned-table tbody tr", has_text="autumn").locator("td").all_inner_texts()
        assert cells == ["autumn", "30", "30", "30", "0", "frame names", "\u2013", "yes"]


def test_the_token_is_asked_for_once(browser: Browser, unchanged_three_map: Path, winter: list[Path]) -> None:
    with running(unchanged_three_map, token="open-sesame") as service, opened(browser, service.url) as seen:
        page = seen.page
        page.locator("#token-dialog[open]").wait_for()
        assert page.evaluate("document.activeElement.id") == "token"
        page.keyboard.type("shut")
        page.keyboard.press("Enter")
        page.locator("#token-problem").wait_for()
        page.keyboard.type("open-sesame")
        page.keyboard.press("Enter")
        page.locator("#coverage-table tbody tr").first.wait_for()
        assert page.locator("#token-dialog").is_hidden()
        seen.choose(winter[12])
        page.locator("#match-image[src^='blob:']").wait_for()
        assert page.evaluate("document.getElementById('match-image').decode().then(() => true)")
        page.reload()
        page.locator("#coverage-table tbody tr").first.wait_for()
        assert page.locator("#token-dialog").is_hidden()


def test_a_file_that_is_no_image_is_refused_in_a_sentence(
    browser: Browser, service: RunningService, winter: list[Path], tmp_path: Path
) -> None:
    broken = tmp_path / f"{winter[1].stem}.png"
    broken.write_bytes(b"no image")
    notes = tmp_path / "notes.txt"
    notes.write_text("x")
    with opened(browser, service.url) as seen:
        seen.page.locator("#coverage-table tbody tr").first.wait_for()
        seen.choose(notes)
        assert seen.text("#query-problem").startswith("There is no image among these files; choose PNG")
        seen.choose(winter[0], broken, winter[2], notes)
        seen.page.locator("#query-problem", has_text="has no answer").wait_for()
        assert re.fullmatch(rf"Frame {broken.stem} has no answer\. The image is .*\.", seen.text("#query-problem"))
        assert seen.text("#files-note") == "1 file is no image and was left out: notes.txt."
        assert seen.text("#sentence") == "This frame has no answer."
        # The drive goes on behind it, and later frames keep their numbers.
        seen.page.locator("#play").click()
        seen.page.locator("#play", has_text="Play again").wait_for()
        assert seen.text("#query-caption") == f"Query: {winter[2].stem}"
        assert [one["frame"] for one in seen.answers] == [winter[0].stem, winter[2].stem]


def test_a_folder_of_several_drives_lets_one_be_chosen(
    browser: Browser, service: RunningService, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    for drive, count in (("autumn", 3), ("winter", 4)):
        (tmp_path / "route" / drive).mkdir(parents=True)
        for path in sorted((unchanged_rendered_route / drive).glob("*.png"))[:count]:
            (tmp_path / "route" / drive / path.name).write_bytes(path.read_bytes())
    with opened(browser, service.url) as seen:
        seen.page.locator("#coverage-table tbody tr").first.wait_for()
        seen.page.set_input_files("#folder-input", tmp_path / "route")
        seen.page.locator("#play", has_text="Play again").wait_for()
        assert seen.text("#position-text") == "3 of 3"
        options = seen.page.locator("#folder-select option").all_inner_texts()
        assert options == ["route/autumn (3)", "route/winter (4)"]
        seen.page.select_option("#folder-select", "1")
        seen.page.locator("#position-text", has_text="4 of 4").wait_for()
        assert "looks like winter" in seen.text("#sentence")


def test_a_map_that_grows_is_read_anew(
    browser: Browser, summer_map: Path, unchanged_rendered_route: Path, winter: list[Path]
) -> None:
    with running(summer_map, look_seconds=0.0) as service, opened(browser, service.url) as seen:
        seen.page.locator("#coverage-table tbody tr").first.wait_for()
        seen.choose(*winter[:DRIVE])
        seen.page.select_option("#speed", "1")
        seen.page.locator("#position-text", has_text=re.compile("^[2-9] of")).wait_for()
        Map.open(summer_map).add(unchanged_rendered_route / "autumn")
        seen.page.locator("#files-note", has_text="version 2").wait_for()
        assert "2 drives (summer and autumn)" in seen.text("#map-summary")
        seen.page.select_option("#speed", "0")
        seen.page.locator("#play", has_text="Play again").wait_for()
        assert [one["version"] for one in seen.answers[-DRIVE:]] == [2] * DRIVE
        assert seen.complaints == []


def test_the_query_is_shown_in_the_condition_of_its_match(
    browser: Browser, unchanged_rendered_route: Path, winter: list[Path], tmp_path: Path
) -> None:
    run = untrained_run(tmp_path / "run", "c-vae")
    made = Map.create(tmp_path / "map", unchanged_rendered_route / "autumn", method=str(run))
    made.add(unchanged_rendered_route / "winter", align="names")
    with running(tmp_path / "map") as service, opened(browser, service.url) as seen:
        seen.choose(winter[7])
        picture = seen.page.locator("#translated-image[src^='blob:']")
        picture.wait_for()
        matched = seen.answers[0]["drive"]
        assert seen.page.locator("#translated-condition option").all_inner_texts()[0] == f"as the match: {matched}"
        assert picture.get_attribute("alt") == f"The frame {winter[7].stem} as it would look in {matched}"
        other = "autumn" if matched == "winter" else "winter"
        seen.page.select_option("#translated-condition", other)
        seen.page.locator(f"#translated-image[alt$='{other}']").wait_for()
        assert seen.complaints == []


def test_a_service_that_has_gone_is_said(browser: Browser, unchanged_three_map: Path, winter: list[Path]) -> None:
    with running(unchanged_three_map) as service, opened(browser, service.url) as seen:
        seen.page.locator("#coverage-table tbody tr").first.wait_for()
        service.process.terminate()
        service.process.wait(20)
        seen.choose(winter[0])
        seen.page.locator("#query-problem").wait_for()
        assert seen.text("#query-problem").endswith(
            "has no answer. The service does not answer; see whether everplace serve still runs."
        )
