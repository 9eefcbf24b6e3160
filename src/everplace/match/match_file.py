"""Match files: everplace's CSV, hloc's list of image pairs, kapture's pairs file."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TextIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from everplace.choices import MatchFormat, ScoreKind
from everplace.errors import ConfigError, DescriptorsError
from everplace.files import readable, whole_file

__all__ = ["write_matches"]

_Match: TypeAlias = tuple[str, str, str, int, str]  # query, database, score, rank, kind of score


def write_matches(
    path: Path,
    query: Sequence[str],
    database: Sequence[str],
    indices: NDArray[np.int64],
    scores: NDArray[np.float32],
    *,
    format: MatchFormat = "csv",
    kind: ScoreKind,
    accepted: NDArray[np.bool_] | None = None,
) -> None:
    """Writes the best matches of every query, whole or not at all.

    "csv" has the columns query, database, score, rank (from 1), score_kind. "hloc-pairs" is what hloc's matchers read:
    a line `query database` a match. "kapture" is the pairs file of kapture 1.1: `query, database, score`. Both know an
    image by the name of its file, so theirs are image names.
    Scores are written so that reading them as float32 gives them back exactly.

    Args:
        path: The file.
        query: M names.
        database: N names.
        indices: M×K into `database`, best first, as of `everplace.match.similarity.top_k`.
        scores: M×K.
        format: The kind of file.
        kind: What the scores are.
        accepted: M×K, which of them are written; None: all.

    Raises:
        ConfigError: There is no such format.
        DescriptorsError: The shapes do not fit, or a name cannot stand in the format.
        StorageError: The place cannot be written to.
    """
    writers = {"csv": _write_csv, "hloc-pairs": _write_hloc_pairs, "kapture": _write_kapture}
    if format not in writers:
        raise ConfigError(f"`format` {format!r} is not known; choose {', '.join(writers)}")
    if indices.shape != scores.shape or indices.ndim != 2 or len(indices) != len(query):
        raise DescriptorsError(
            f"indices of shape {indices.shape} and scores of shape {scores.shape} are no matches of "
            f"{len(query)} queries; both must be M×K"
        )
    chosen = np.ones(scores.shape, np.bool_) if accepted is None else accepted
    matches = _matches(query, database, indices, scores, kind, chosen)
    with (
        whole_file(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="surrogateescape", newline="") as file,
    ):
        writers[format](file, matches)


def _matches(
    query: Sequence[str],
    database: Sequence[str],
    indices: NDArray[np.int64],
    scores: NDArray[np.float32],
    kind: ScoreKind,
    accepted: NDArray[np.bool_],
) -> Iterator[_Match]:
    for row, column in np.argwhere(accepted).tolist():
        yield query[row], database[int(indices[row, column])], f"{scores[row, column]:.9g}", column + 1, kind


def _write_csv(file: TextIO, matches: Iterator[_Match]) -> None:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(("query", "database", "score", "rank", "score_kind"))
    writer.writerows(matches)


def _write_hloc_pairs(file: TextIO, matches: Iterator[_Match]) -> None:
    for query, database, *_ in matches:
        for name in (query, database):
            if len(name.split()) != 1:
                raise _cannot_hold("hloc-pairs", name, "white space")
        file.write(f"{query} {database}\n")


def _write_kapture(file: TextIO, matches: Iterator[_Match]) -> None:
    file.write("# kapture format: 1.1\n# query_image, map_image, score\n")
    for query, database, score, *_ in matches:
        for name in (query, database):
            if not name or "," in name or "\n" in name or name != name.strip() or name.startswith("#"):
                raise _cannot_hold(
                    "kapture", name, "no character, a comma, a line break, an outer space or a leading #"
                )
        file.write(f"{query}, {database}, {score}\n")


def _cannot_hold(format: str, name: str, what: str) -> DescriptorsError:
    return DescriptorsError(
        f"the format {format} cannot hold the name {readable(name)!r}, which has {what}; rename the image or write csv"
    )
