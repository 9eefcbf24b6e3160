from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from everplace.errors import ConfigError, RouteError
from everplace.images.decoding import ImageSpec, decode_image
from everplace.importing.import_route import import_route
from everplace.route.route import open_route


@pytest.fixture
def drives(tmp_path: Path) -> Path:
    """Two drives of 5 images each, named as two cameras would."""
    rng = np.random.default_rng(2)
    root = tmp_path / "drives"
    for name, pattern in (("jan", "IMG_{}.png"), ("jul", "frame{}.png")):
        (root / name).mkdir(parents=True)
        for number in (8, 9, 10, 11, 100):
            Image.fromarray(rng.integers(0, 256, (6, 8, 3), dtype=np.uint8)).save(root / name / pattern.format(number))
    return root


def test_drives_get_the_same_stems_in_natural_order(tmp_path: Path, drives: Path) -> None:
    summary = import_route("images", drives, tmp_path / "out", {"conditions": "winter,summer"})
    assert summary.linked == 10
    assert "`stems=own`" in summary.notes[0]
    route = open_route(tmp_path / "out")
    assert route.shared_stems() == tuple(f"{number:06d}" for number in range(5))
    assert {traverse.name: traverse.condition for traverse in route.traverses} == {"jan": "winter", "jul": "summer"}
    assert [path.resolve().name for path in route["jan"].paths] == [f"IMG_{n}.png" for n in (8, 9, 10, 11, 100)]


def test_images_named_by_seconds_are_imported_in_the_order_of_time(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    for stem in ("1305031110.5", "1305031110.0", "1305031110.125", "1305031110.25"):
        Image.new("L", (8, 6)).save(tmp_path / "day" / f"{stem}.png")
    import_route("images", tmp_path / "day", tmp_path / "out")
    (traverse,) = open_route(tmp_path / "out").traverses
    assert traverse.stems == ("000000", "000001", "000002", "000003")
    assert [path.resolve().stem[10:] for path in traverse.paths] == [".0", ".125", ".25", ".5"]


def test_stems_of_their_own_or_of_the_files(tmp_path: Path, drives: Path) -> None:
    import_route("images", drives, tmp_path / "own", {"stems": "own", "every_frames": "2"})
    assert open_route(tmp_path / "own")["jul"].stems == ("jul-000000", "jul-000001", "jul-000002")
    import_route("images", drives / "jan", tmp_path / "file", {"stems": "file", "every_frames": "2"})
    assert open_route(tmp_path / "file")["jan"].stems == ("IMG_8", "IMG_10", "IMG_100")


def test_drives_that_are_not_aligned_stay_so(tmp_path: Path, drives: Path) -> None:
    summary = import_route("images", drives, tmp_path / "out", {"aligned": "false"})
    assert summary.notes == ()
    route = open_route(tmp_path / "out")
    assert not route.stems_are_places
    assert route.shared_stems() == ()
    import_route("images", tmp_path / "out", tmp_path / "again", {"stems": "file"})
    again = open_route(tmp_path / "again")
    assert not again.stems_are_places
    assert again["jul"].stems == route["jul"].stems == again["jan"].stems
    import_route("images", tmp_path / "out", tmp_path / "known", {"stems": "file", "aligned": "true"})
    assert len(open_route(tmp_path / "known").shared_stems()) == 5
    import_route("images", tmp_path / "out", tmp_path / "anew")
    assert open_route(tmp_path / "anew").stems_are_places
    (tmp_path / "again" / "route.toml").write_text("aligned = 3\n")
    with pytest.raises(ConfigError, match="wrong value of 'aligned'"):
        import_route("images", tmp_path / "again", tmp_path / "wrong", {"stems": "file"})


def test_times_and_poses_by_time(tmp_path: Path, drives: Path) -> None:
    (drives / "jan" / "times.csv").write_text(
        "stem,seconds\n" + "".join(f"IMG_{n},{t}\n" for t, n in enumerate((8, 9, 10, 11, 100)))
    )
    (drives / "jan" / "poses.csv").write_text("seconds,x,y,heading\n0,0,0,0\n2,20,4,3.0\n4,20,8,-3.0\n")
    options = {"pose_limit": "1", "size": "4x3"}
    import_route("images", drives / "jan", tmp_path / "out", options)
    traverse = open_route(tmp_path / "out")["jan"]
    assert traverse.poses is not None
    expected = np.array([[0, 0, 0], [10, 2, 1.5], [20, 4, 3.0], [20, 6, np.pi], [20, 8, -3.0]])
    difference = traverse.poses - expected
    difference[:, 2] = np.angle(np.exp(1j * difference[:, 2]))  # 3.0 and -3.0 meet at π, not at 0
    np.testing.assert_allclose(difference, 0, atol=1e-9)
    assert decode_image(traverse.paths[0], ImageSpec()).shape == (3, 4, 3)
    # Fewer poses than frames: refused, or dropped if wanted; sampled by the way travelled
    (drives / "jan" / "poses.csv").write_text("seconds,x,y,heading\n1,0,0,0\n2,20,4,3.0\n4,20,8,-3.0\n")
    with pytest.raises(RouteError, match=r"poses.csv has no pose within 0.5 s of the frame 'IMG_8' of jan, at 0.000 s"):
        import_route("images", drives / "jan", tmp_path / "refused")
    assert not (tmp_path / "refused").exists()
    options = {"without_pose": "drop", "every_metres": "15"}
    assert import_route("images", drives / "jan", tmp_path / "dropped", options).frames == 2


def test_an_imported_route_can_be_imported_again(tmp_path: Path, drives: Path) -> None:
    (drives / "jan" / "times.csv").write_text("stem,seconds\n" + "".join(f"IMG_{n},{n}\n" for n in (8, 9, 10, 11, 100)))
    (drives / "jan" / "poses.csv").write_text(
        "stem,x,y,heading\n" + "".join(f"IMG_{n},{n},0,0.5\n" for n in (8, 9, 10, 11, 100))
    )
    import_route("images", drives, tmp_path / "first")
    import_route("images", tmp_path / "first" / "jan", tmp_path / "second", {"every_seconds": "2"})
    again = open_route(tmp_path / "second")["jan"]
    assert again.poses is not None
    assert again.poses[:, 0].tolist() == [8, 10, 100]


def test_what_cannot_be(tmp_path: Path, drives: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(ConfigError, match="names 1 conditions, but .* holds 2 drives: jan, jul"):
        import_route("images", drives, out, {"conditions": "winter"})
    with pytest.raises(ConfigError, match="every_seconds and change exclude each other"):
        import_route("images", drives, out, {"every_seconds": "1", "change": "0.9"})
    with pytest.raises(ConfigError, match="every_seconds needs the time of each frame, and 'IMG_8' has none"):
        import_route("images", drives, out, {"every_seconds": "1"})
    with pytest.raises(ConfigError, match="`size`=0x3 cannot be: it is not WIDTHxHEIGHT"):
        import_route("images", drives, out, {"size": "0x3"})
    (drives / "jan" / "times.csv").write_text("stem,seconds\nIMG_8,0\n")
    with pytest.raises(RouteError, match=r"times.csv has no time for 4 of 5 frames, the first is 'IMG_9'; add a line"):
        import_route("images", drives, out)
    shutil.rmtree(drives / "jan")
    shutil.rmtree(drives / "jul")
    with pytest.raises(RouteError, match="holds no image, nor do its directories"):
        import_route("images", drives, out)
    assert not out.exists()


IN_STEP = "equal numbers of frames, the drives taken to be in step"


@pytest.mark.parametrize(
    ("options", "origin"),
    [
        ({}, IN_STEP),
        ({"stems": "file"}, "equal names of frames"),
        ({"stems": "own"}, None),
        ({"aligned": "false"}, None),
    ],
)
def test_where_the_truth_comes_from(tmp_path: Path, drives: Path, options: dict[str, str], origin: str | None) -> None:
    import_route("images", drives, tmp_path / "out", options)
    assert open_route(tmp_path / "out").truth_origin == origin
    import_route("images", drives / "jan", tmp_path / "one", options)
    assert open_route(tmp_path / "one").truth_origin is None


@pytest.mark.parametrize(
    ("said", "stems", "told"),
    [
        ("", "file", ("an alignment", "hog")),
        ("", "shared", ("an alignment", "hog")),
        ("", "own", (None, None)),
        ("radius = 5.0", "file", ("equal names of frames", "hog")),
    ],
)
def test_what_a_route_says_of_its_truth_comes_along(
    tmp_path: Path, drives: Path, said: str, stems: str, told: tuple[str | None, str | None]
) -> None:
    (drives / "route.toml").write_text(f'truth_from = "an alignment"\naligned_by = "hog"\n{said}\n')
    import_route("images", drives, tmp_path / "out", {"stems": stems})
    route = open_route(tmp_path / "out")
    assert (route.truth_origin, route.aligned_by) == told


def test_a_route_toml_that_is_wrong_matters_where_names_are_kept_alone(tmp_path: Path, drives: Path) -> None:
    (drives / "route.toml").write_text("tolerance = ")
    import_route("images", drives, tmp_path / "out")
    with pytest.raises(ConfigError, match="not valid TOML"):
        import_route("images", drives, tmp_path / "file", {"stems": "file"})
