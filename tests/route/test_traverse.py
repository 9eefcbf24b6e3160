from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from everplace.route.traverse import Frame, Pose, Traverse


@pytest.fixture
def drive() -> Traverse:
    poses = np.arange(12, dtype=np.float64).reshape(4, 3)
    return Traverse("jan", "winter", Path("/r/jan"), ("1", "2", "10", "x.y"), (".png", ".jpg", ".png", ".PNG"), poses)


def test_frames_are_made_on_access(drive: Traverse) -> None:
    assert len(drive) == 4
    assert drive[1] == Frame("2", Path("/r/jan/2.jpg"), Pose(3.0, 4.0, 5.0))
    assert drive[-1].path == Path("/r/jan/x.y.PNG")
    assert [frame.stem for frame in drive] == ["1", "2", "10", "x.y"]
    assert drive.paths == tuple(frame.path for frame in drive)
    assert drive[int(np.int64(2))].stem == drive[np.int64(2)].stem == "10"  # type: ignore[call-overload]
    with pytest.raises(IndexError):
        drive[4]


def test_slices_and_take_keep_stems_paths_and_poses_together(drive: Traverse) -> None:
    for part, stems in ((drive[1:3], ("2", "10")), (drive.take([3, 0]), ("x.y", "1"))):
        assert part.stems == stems
        assert part.name == "jan"
        assert part.condition == "winter"
        whole = {frame.stem: frame for frame in drive}
        assert list(part) == [whole[stem] for stem in stems]
    assert drive.take(np.array([], dtype=np.int64)).stems == ()
    assert len(drive) == 4


def test_frames_without_poses() -> None:
    drive = Traverse("a", "a", Path("/r/a"), ("1",), (".png",))
    assert drive[0].pose is None
    assert drive[:1].poses is None


def test_printing_a_million_frames_is_short(drive: Traverse) -> None:
    assert "x.y" not in repr(drive)
