"""Where the container of a video says that the file ends: a file that is shorter was cut off.

Only lengths are read, which the containers hold in front of what they measure (Matroska: RFC 9559; MP4 and QuickTime:
ISO/IEC 14496-12; AVI: RIFF; ASF: its file properties; MPEG transport streams: packets of one length).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

__all__ = ["ends_early"]

_EBML, _SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"
_ASF_HEADER = bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c")
_ASF_PROPERTIES = bytes.fromhex("a1dcab8c47a9cf118ee400c00c205365")
_SYNC = 0x47
_PROBE = 1 << 16
_ZEROS = 64


def ends_early(path: Path) -> bool:
    """Says whether a file ends before its container does; False also where the container does not tell.

    Zeros at the end of Matroska and AVI, and in place of an MP4's next box, count as such an end: so a copy looks whose
    place on the disk was taken before its content came.
    """
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        start = file.read(_PROBE)
        if start.startswith(_EBML):
            return _segment_end(start) > size or _ends_in_zeros(file, size)
        if start.startswith(b"RIFF"):
            return _riff_end(file, size) > size or _ends_in_zeros(file, size)
        if start.startswith(_ASF_HEADER):
            at = start.find(_ASF_PROPERTIES)
            return at >= 0 and int.from_bytes(start[at + 40 : at + 48], "little") > size
        if start[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
            return _boxes_end(file, size) > size
        for packet, sync in ((188, 0), (192, 4)):
            if len(start) > 2 * packet and all(start[at] == _SYNC for at in range(sync, len(start), packet)):
                return size % packet != 0
    return False


def _ends_in_zeros(file: BinaryIO, size: int) -> bool:
    file.seek(max(0, size - _ZEROS))
    return not any(file.read(_ZEROS))


def _segment_end(start: bytes) -> int:
    """Returns where a Matroska file's segment ends; 0: it does not say, as while it is recorded."""
    position = 0
    for name in (_EBML, _SEGMENT):
        at = position + len(name)
        if start[position:at] != name or at >= len(start) or not start[at]:
            return 0
        width = 9 - start[at].bit_length()
        unknown = (1 << 7 * width) - 1
        length = int.from_bytes(start[at : at + width], "big") & unknown
        if length == unknown:
            return 0
        position = at + width + length
    return position


def _riff_end(file: BinaryIO, size: int) -> int:
    """Returns where the last RIFF chunk of an AVI ends; long files have several."""
    end = 0
    while end < size:
        file.seek(end)
        head = file.read(8)
        length = int.from_bytes(head[4:], "little")
        if head[:4] != b"RIFF" or not length:
            break
        end += 8 + length
    return end


def _boxes_end(file: BinaryIO, size: int) -> int:
    """Returns where the last box of an MP4 ends."""
    end = 0
    while end < size:
        file.seek(end)
        head = file.read(16)
        length = int.from_bytes(head[:4], "big")
        if length == 1:
            length = int.from_bytes(head[8:], "big")
        if not any(head):  # space that was taken and not written
            return size + 1
        if length < 8 or not head[4:8].isalnum():  # up to the end of the file, or no box
            break
        end += length
    return end
