"""One frame in, one answer out."""

from __future__ import annotations

import json
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.forked import ForkedProcess
from tests.mapping.drives import another_camera, images_of

from everplace.errors import EverplaceError, MapError
from everplace.mapping.localizer import Localizer
from everplace.mapping.map_answer import MapAnswer
from everplace.mapping.route_map import Map
from everplace.route.traverse import Pose


def test_an_answer_is_whole(unchanged_three_map: Path, unchanged_rendered_route: Path) -> None:
    answer = Localizer(unchanged_three_map, sequence=1).locate(images_of(unchanged_rendered_route / "winter")[33], 7.5)
    assert isinstance(answer, MapAnswer)
    assert (answer.place, answer.drive, answer.database_frame, answer.time) == (33, "winter", "00033", 7.5)
    assert answer.score == pytest.approx(1, abs=1e-3)
    assert 0 <= answer.off_map <= 1
    assert 0.5 < answer.probability <= 1
    assert answer.probability + answer.off_map <= 1 + 1e-6
    assert set(answer.condition) == {"summer", "autumn", "winter"}
    assert sum(answer.condition.values()) == pytest.approx(1)
    assert max(answer.condition, key=lambda name: answer.condition[name]) == "winter"
    assert isinstance(answer.pose, Pose)
    assert not answer.provisional
    written = json.loads(json.dumps(answer.to_dict(), allow_nan=False))
    assert written["pose"] == list(answer.pose)


def test_a_map_of_one_drive_answers_provisionally(unchanged_summer_map: Path, unchanged_rendered_route: Path) -> None:
    localizer = Localizer(unchanged_summer_map)
    answers = [localizer.locate(image) for image in images_of(unchanged_rendered_route / "autumn")[:20]]
    assert localizer.provisional
    assert all(answer.provisional for answer in answers)
    assert np.mean([abs(answer.place - place) <= 1 for place, answer in enumerate(answers)]) >= 0.9


@pytest.mark.parametrize("sequence", [1, 10])
def test_probabilities_are_probabilities_also_of_what_is_no_place(unchanged_three_map: Path, sequence: int) -> None:
    localizer = Localizer(unchanged_three_map, sequence=sequence)
    rng = np.random.default_rng(0)
    for shape in ((64, 128, 3), (1, 1), (200, 30, 3), (5, 300)):
        for image in (np.zeros(shape, np.uint8), np.full(shape, 255, np.uint8), rng.integers(0, 256, shape, np.uint8)):
            answer = localizer.locate(image)
            assert all(0 <= number <= 1 for number in (answer.probability, answer.off_map, *answer.condition.values()))
            json.dumps(answer.to_dict(), allow_nan=False)


@pytest.mark.parametrize("grey", [0, 128, 254])
def test_a_covered_lens_is_at_no_place(
    unchanged_three_map: Path, unchanged_summer_map: Path, unchanged_rendered_route: Path, grey: int
) -> None:
    noise = np.random.default_rng(0).integers(-1, 2, (20, 64, 128, 3))
    covered = np.clip(grey + noise, 0, 255).astype(np.uint8)
    for address in (unchanged_three_map, unchanged_summer_map):
        assert Localizer(address, sequence=1).locate(covered[0]).probability < 0.1
        localizer = Localizer(address)
        winter = images_of(unchanged_rendered_route / "winter")
        driven = [localizer.locate(image).probability for image in winter[10:20]]
        while_covered = [localizer.locate(image).probability for image in covered]
        assert driven[-1] > 0.5
        assert while_covered[-1] < 0.1  # it may be anywhere by now
        assert while_covered[-1] < while_covered[4] < driven[-1]
        after = [localizer.locate(image) for image in winter[40:50]][-1]
        assert abs(after.place - 49) <= 1
        assert after.probability > 0.5


def test_frames_of_any_size_grey_or_in_colour(unchanged_three_map: Path, unchanged_rendered_route: Path) -> None:
    image = images_of(unchanged_rendered_route / "autumn")[25]
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    larger = np.asarray(cv2.resize(image, (640, 480)), np.uint8)
    for frame in (image, grey, grey[:, :, None], larger, another_camera(image)):
        assert abs(Localizer(unchanged_three_map, sequence=1).locate(frame).place - 25) <= 1


@pytest.mark.parametrize(
    "image",
    [np.zeros((4, 4), np.float32), np.zeros((4, 4, 4), np.uint8), np.zeros((0, 4), np.uint8), np.zeros(4, np.uint8)],
)
def test_what_is_no_image_is_refused_and_forgotten(
    unchanged_three_map: Path, unchanged_rendered_route: Path, image: np.ndarray
) -> None:
    localizer = Localizer(unchanged_three_map)
    with pytest.raises(EverplaceError):
        localizer.locate(image)
    assert len(localizer.state()) == 0


def test_the_filter_helps_over_frames_alone(unchanged_summer_map: Path, unchanged_rendered_route: Path) -> None:
    images = images_of(unchanged_rendered_route / "winter")
    right = {}
    for length in (1, 10):
        localizer = Localizer(unchanged_summer_map, sequence=length)
        answers = [localizer.locate(image) for image in images]
        right[length] = np.mean([abs(answer.place - place) <= 1 for place, answer in enumerate(answers)])
    assert right[10] >= right[1]
    assert right[10] >= 0.8


def test_frames_alone_know_nothing_of_those_before(unchanged_three_map: Path, unchanged_rendered_route: Path) -> None:
    images = images_of(unchanged_rendered_route / "autumn")[10:14]
    localizer = Localizer(unchanged_three_map, sequence=1)
    together = [localizer.locate(image) for image in images]
    assert together == [Localizer(unchanged_three_map, sequence=1).locate(image) for image in images]


def test_a_drive_does_not_find_itself_where_it_is_left_out(
    unchanged_three_map: Path, unchanged_rendered_route: Path
) -> None:
    image = images_of(unchanged_rendered_route / "winter")[33]
    localizer = Localizer(unchanged_three_map, sequence=1)
    left_out = localizer.locate(image, excluded=("winter", 33, 5))
    assert left_out.drive in {"summer", "autumn"}
    assert abs(left_out.place - 33) <= 1
    assert localizer.locate(image, excluded=("winter", 43, 5)).database_frame == "00033"
    assert localizer.locate(image, excluded=("autumn", 33, 5)).database_frame == "00033"


def test_frames_left_out_of_a_map_of_one_drive(unchanged_summer_map: Path, unchanged_rendered_route: Path) -> None:
    localizer = Localizer(unchanged_summer_map, sequence=1)
    image = images_of(unchanged_rendered_route / "summer")[30]
    answer = localizer.locate(image, excluded=("summer", 30, 10))
    assert abs(answer.place - 30) >= 10
    assert answer.off_map > localizer.locate(image).off_map
    nothing = localizer.locate(image, excluded=("summer", 30, 1000))
    assert nothing.off_map == pytest.approx(1, abs=1e-6)
    json.dumps(nothing.to_dict(), allow_nan=False)


def test_frames_left_out_are_no_answer_though_those_before_lead_there(
    unchanged_summer_map: Path, unchanged_rendered_route: Path
) -> None:
    localizer = Localizer(unchanged_summer_map)
    for number, image in enumerate(images_of(unchanged_rendered_route / "summer")[:40]):
        answer = localizer.locate(image, excluded=("summer", number, 10) if number >= 20 else None)
        assert number < 20 or abs(answer.place - number) >= 10


@pytest.mark.parametrize("name", ["autumn", "winter"])
def test_a_robot_that_stands_is_where_it_came_to(
    unchanged_summer_map: Path, unchanged_rendered_route: Path, name: str
) -> None:
    """In front of the places that a frame alone finds worst, with the noise of a camera."""
    images = images_of(unchanged_rendered_route / name)
    rng = np.random.default_rng(0)

    def noisy(place: int) -> list[np.ndarray]:
        return [np.clip(images[place] + rng.normal(0, 1, images[place].shape), 0, 255).astype(np.uint8) for _ in "123"]

    alone = Localizer(unchanged_summer_map, sequence=1)
    worst = np.argsort([alone.locate(image).probability for image in images])
    for place in [one for one in worst.tolist() if one >= 10][:3]:
        localizer = Localizer(unchanged_summer_map)
        for image in images[: place + 1]:
            before = localizer.locate(image)
        shown = noisy(place)
        for number in range(100):
            after = localizer.locate(shown[number % 3])
        assert abs(after.place - before.place) <= 1
        assert after.probability >= before.probability - 0.15
        assert len(localizer.state()) <= 10


OTHER = """
import sys
import numpy as np
from tests.mapping.drives import images_of
from pathlib import Path
from everplace.mapping.localizer import Localizer

localizer = Localizer(sys.argv[1])
localizer.restore(np.load(sys.argv[3]))
for image in images_of(Path(sys.argv[2]))[12:17]:
    print(repr(localizer.locate(image)))
"""


def test_its_state_goes_on_in_another_process(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    drive = unchanged_rendered_route / "winter"
    images = images_of(drive)
    localizer = Localizer(unchanged_three_map)
    for image in images[:12]:
        localizer.locate(image)
    np.save(tmp_path / "state.npy", localizer.state())
    wanted = [repr(localizer.locate(image)) for image in images[12:17]]
    command = ["-c", OTHER, unchanged_three_map, drive, tmp_path / "state.npy"]
    out, err = ForkedProcess(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE).communicate()
    assert err == ""
    assert out.splitlines() == wanted


def test_a_state_of_another_map_is_refused(unchanged_three_map: Path, tmp_path: Path) -> None:
    localizer = Localizer(unchanged_three_map)
    for state in (np.ones((3, 7)), np.ones(60), np.ones((2, 60, 1)), np.full((2, 423), "1")):
        with pytest.raises(MapError, match="of another map, or of another version of it; begin anew"):
            localizer.restore(state)


def test_it_answers_from_the_version_it_opened(three_map: Path, unchanged_rendered_route: Path) -> None:
    image = images_of(unchanged_rendered_route / "winter")[20]
    localizer = Localizer(three_map, sequence=1)
    before = localizer.locate(image)
    Map.open(three_map).restore(1)
    assert localizer.locate(image) == before
    assert Localizer(three_map, sequence=1).locate(image).drive == "summer"
    assert Localizer(Map.open(three_map, 3), sequence=1).locate(image) == before


def test_localizers_of_one_map_share_it_and_know_nothing_of_each_other(
    unchanged_three_map: Path, unchanged_rendered_route: Path
) -> None:
    images = images_of(unchanged_rendered_route / "winter")
    shared = Localizer(unchanged_three_map)
    one, other = shared.another(10), shared.another(1)
    for image in images[20:26]:
        alone = Localizer(unchanged_three_map, sequence=1).locate(image)
        found = one.locate(image), other.locate(image)
        assert found[1] == alone
    anew = Localizer(unchanged_three_map)
    assert [anew.locate(image) for image in images[20:26]][-1] == found[0]
    assert (len(shared.state()), len(one.state()), len(other.state())) == (0, 6, 0)
    assert one.places is shared.places


def test_localizers_of_one_map_answer_in_threads(unchanged_three_map: Path, unchanged_rendered_route: Path) -> None:
    images = images_of(unchanged_rendered_route / "winter")[:12]
    shared = Localizer(unchanged_three_map)
    expected = [localized(shared.another(10), images[start:]) for start in range(4)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda start: localized(shared.another(10), images[start:]), range(4)))
    assert found == expected


def localized(localizer: Localizer, images: list[np.ndarray]) -> list[MapAnswer]:
    return [localizer.locate(image) for image in images]


@pytest.mark.parametrize("sequence", [1, 10])
def test_an_observation_is_what_the_answer_rests_on(
    unchanged_three_map: Path, unchanged_rendered_route: Path, sequence: int
) -> None:
    localizer, alone = (Localizer(unchanged_three_map, sequence=sequence) for _ in range(2))
    table = localizer.map.frames("stem", "place")
    for image in images_of(unchanged_rendered_route / "winter")[30:33]:
        seen = localizer.observe(image, 2.0, matches=5)
        answer = seen.answer
        assert answer == alone.locate(image, 2.0)
        assert seen.belief.sum() + answer.off_map == pytest.approx(1)
        column = localizer.places.tolist().index(answer.place)
        assert answer.probability == pytest.approx(seen.belief[column - 1 : column + 2].sum())
        assert seen.similarity[column] == np.float32(answer.score)
        assert len(seen.matches) == len({match.place for match in seen.matches}) == 5
        best = seen.matches[0]
        assert (best.place, best.drive, best.database_frame, best.score, best.probability) == (
            answer.place, answer.drive, answer.database_frame, answer.score, answer.probability,
        )  # fmt: skip
        for match in seen.matches:
            row = table.slice(match.id, 1).to_pylist()[0]
            assert (row["drive"], row["stem"], row["place"]) == (match.drive, match.database_frame, match.place)
            assert match.condition == match.drive
    assert localizer.observe(image).matches == ()
