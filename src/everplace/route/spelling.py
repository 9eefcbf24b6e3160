"""Names that look equal and are not: written in two Unicode forms, or in capitals on one side only.

Unicode writes é as one character (NFC) or as e with an accent behind it (NFD). macOS's tools often write NFD, others
NFC, and a file system that keeps names as they are takes the two for different ones. So does everplace.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable

__all__ = ["spelling_hint"]


def spelling_hint(names: Iterable[str], others: Iterable[str], before: str = "; ") -> str:
    """Says which name has one on the other side that looks like it, why they differ, and what to do.

    Args:
        names: Names that were not found among the others.
        others: The names that there are.
        before: What the hint begins with.

    Returns:
        A part of a sentence; empty where no two names look alike.
    """
    known: dict[str, str] = {}
    for other in others:
        known.setdefault(_folded(other), other)
    for name in names:
        other = known.get(_folded(name), name)
        if other == name:
            continue
        if unicodedata.normalize("NFC", name) == unicodedata.normalize("NFC", other):
            return (
                f"{before}{name!r} and {other!r} look equal, but one of them is written with accents as characters of "
                "their own (NFD, as macOS does) and the other without (NFC): rename the files to one form, as `convmv "
                "-f utf8 -t utf8 --nfc --notest -r DIR` does"
            )
        return f"{before}{name!r} and {other!r} differ only in capitals or Unicode form: rename the files alike"
    return ""


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())
