"""Fingerprints of traverses."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from everplace.errors import ImageError
from everplace.route.fingerprint import file_digests, traverse_fingerprint
from everplace.route.route import open_route


def test_it_is_the_hash_of_stems_and_files_wherever_they_lie(tiny_route: Path, tmp_path: Path) -> None:
    traverse = open_route(tiny_route)["summer"]
    digests = [hashlib.sha256(path.read_bytes()).digest() for path in traverse.paths]
    assert b"".join(file_digests(traverse)) == b"".join(digests)
    expected = hashlib.sha256(json.dumps([str(place) for place in range(12)]).encode() + b"".join(digests)).hexdigest()
    assert traverse_fingerprint(traverse) == expected
    shutil.copytree(tiny_route, tmp_path / "elsewhere")
    assert traverse_fingerprint(open_route(tmp_path / "elsewhere")["summer"]) == expected


def test_another_image_order_or_stem_gives_another(tiny_route: Path) -> None:
    traverse = open_route(tiny_route)["summer"]
    found = {
        traverse_fingerprint(traverse),
        traverse_fingerprint(traverse[1:]),
        traverse_fingerprint(traverse.take([1, 0])),
    }
    (tiny_route / "summer" / "3.png").write_bytes((tiny_route / "summer" / "4.png").read_bytes())
    found.add(traverse_fingerprint(traverse))
    (tiny_route / "summer" / "11.png").rename(tiny_route / "summer" / "12.png")
    found.add(traverse_fingerprint(open_route(tiny_route)["summer"]))
    assert len(found) == 5
    with pytest.raises(ImageError, match="11.png"):
        traverse_fingerprint(traverse)
