"""The files of the page, read once: no path from a request reaches the disk."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib.resources import files

__all__ = ["INDEX", "PageFile", "page_files"]

INDEX = "index.html"
_TEXTS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
"""Not asked of the system, whose own table may say otherwise."""


@dataclass(frozen=True)
class PageFile:
    """One file.

    Attributes:
        content: All of it.
        media_type: For the browser.
        tag: Changes with the content.
    """

    content: bytes
    media_type: str
    tag: str


def page_files() -> dict[str, PageFile]:
    """By name."""
    found = {}
    for entry in files("everplace.serve").joinpath("page").iterdir():
        if entry.is_file():
            content = entry.read_bytes()
            kind = _TEXTS.get("." + entry.name.rpartition(".")[2], "application/octet-stream")
            found[entry.name] = PageFile(content, f"{kind}; charset=utf-8", hashlib.sha256(content).hexdigest()[:16])
    return found
