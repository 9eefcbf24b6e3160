"""Packs directories into archives, in an order that is not theirs."""

from __future__ import annotations

import io
import tarfile
import warnings
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path

__all__ = ["FORMS", "pack", "pack_files"]

FORMS = ("zip", "tar", "tar.gz", "tgz", "tar.bz2", "tar.xz")
"""Endings of the archives that `pack` writes."""


def pack(directory: Path, archive: Path, top: str = "", wanted: Callable[[str], bool] = lambda _: True) -> Path:
    """Packs the files below a directory; `top` is put before their names."""
    names = [path.relative_to(directory).as_posix() for path in directory.rglob("*") if path.is_file()]
    # The order of a directory's own listing is that of its disk: here names read backwards.
    ordered = sorted(filter(wanted, names), key=lambda name: name[::-1])
    return pack_files(archive, ((top + name, (directory / name).read_bytes()) for name in ordered))


def pack_files(archive: Path, files: Iterable[tuple[str, bytes]]) -> Path:
    """Packs files given as names and contents; the archive's ending says how."""
    archive.parent.mkdir(parents=True, exist_ok=True)
    if archive.suffix == ".zip":
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as zipped, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of names that come twice
            for name, data in files:
                zipped.writestr(name, data)
        return archive
    kind = {".tar": "", ".tgz": "gz"}.get(archive.suffix, archive.suffix[1:])
    with tarfile.open(archive, f"w:{kind}") as packed:  # type: ignore[call-overload]
        for name, data in files:
            info = tarfile.TarInfo(name)
            info.size = len(data)
            packed.addfile(info, io.BytesIO(data))
    return archive
