from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.importing.packing import pack_files

from everplace.errors import RouteError
from everplace.importing.containers.archive_tree import ArchivePath
from everplace.importing.containers.archives import read_members
from everplace.importing.import_route import import_route

FORMS = ("zip", "tar.gz", "tar.bz2", "tar.xz")
SMALL = io.BytesIO()
Image.fromarray(np.zeros((16, 24, 3), dtype=np.uint8)).save(SMALL, "PNG")
ZEROS = bytes(40 * 2**20)


def stored(form: str, height: int, width: int) -> bytes:
    """A picture of one colour whose file is not packed."""
    buffer = io.BytesIO()
    Image.fromarray(np.full((height, width, 3), 77, dtype=np.uint8)).save(buffer, form, **{"compress_level": 0})
    return buffer.getvalue()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("name", "content"),
    [("1.png", SMALL.getvalue() + ZEROS), ("1.png", ZEROS), ("1.bmp", stored("BMP", 8, 8) + ZEROS)],
    ids=["png and zeros", "zeros", "bmp and zeros"],
)
def test_what_unpacks_to_a_thousand_times_its_size_is_refused(
    tmp_path: Path, form: str, name: str, content: bytes
) -> None:
    path = pack_files(tmp_path / f"winter.{form}", [("winter/0.png", SMALL.getvalue()), (f"winter/{name}", content)])
    with pytest.raises(RouteError, match=rf"winter/{name}, which unpacks to more than 1000 times its size"):
        list(read_members(path, [f"winter/{name}"]))
    with pytest.raises(RouteError, match=rf"winter\.{form} holds winter/{name}"):
        import_route("nordland", path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("archive", FORMS)
@pytest.mark.parametrize("form", ["BMP", "PNG", "TIFF", "PPM"])
def test_a_picture_of_one_colour_that_is_so_large_is_read(tmp_path: Path, archive: str, form: str) -> None:
    content = stored(form, 3000, 4000)
    path = pack_files(tmp_path / f"a.{archive}", [("0.img", content), ("1.img", SMALL.getvalue())])
    assert dict(read_members(path, ["0.img", "1.img"])) == {"0.img": content, "1.img": SMALL.getvalue()}


@pytest.mark.parametrize("form", FORMS)
def test_a_file_that_nobody_asks_for_does_no_harm(tmp_path: Path, form: str) -> None:
    path = pack_files(tmp_path / f"a.{form}", [("truth.npy", ZEROS), ("0.png", SMALL.getvalue()), ("b.txt", b"x y\n")])
    tree = ArchivePath(path)
    assert tree.images == ("0.png",)
    with (tree / "b.txt").open() as file:
        assert file.read() == b"x y\n"
    with pytest.raises(RouteError, match=r"truth\.npy, which unpacks"):
        (tree / "truth.npy").open()


@pytest.mark.parametrize("form", [*FORMS, "tar"])
def test_short_files_and_plain_tars_pack_as_they_like(tmp_path: Path, form: str) -> None:
    content = bytes(2**20) if form != "tar" else ZEROS
    path = pack_files(tmp_path / f"a.{form}", [("zeros.txt", content)])
    assert dict(read_members(path, ["zeros.txt"])) == {"zeros.txt": content}
