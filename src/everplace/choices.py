"""What options with a few possible values take: each list stands here once, for the commands and the library."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

__all__ = [
    "SEQUENCE_METHODS",
    "AlignedBy",
    "DescriptorFormat",
    "Engine",
    "MatchFormat",
    "ScoreKind",
    "SequenceMethod",
    "Standardisation",
]

Standardisation: TypeAlias = Literal["centre", "full", "running"]
"""See `everplace.match.standardise`."""

SequenceMethod: TypeAlias = Literal["filter", "seqslam", "mean"]
"""See `everplace.sequences.sequence_search`."""

SEQUENCE_METHODS: tuple[SequenceMethod, ...] = get_args(SequenceMethod)

DescriptorFormat: TypeAlias = Literal["everplace", "hloc"]
"""Layouts of a file of descriptors."""

Engine: TypeAlias = Literal["local", "ray"]
"""What describes: this process, or a cluster (`everplace.cluster`)."""

MatchFormat: TypeAlias = Literal["csv", "hloc-pairs", "kapture"]
"""See `everplace.match.match_file`."""

ScoreKind: TypeAlias = Literal["cosine", "negative-difference", "log-probability", "log-odds", "seqslam"]
"""What the score of a match is; see `everplace.match.matching.Matching.score_kind`."""

AlignedBy: TypeAlias = Literal["poses", "pairs", "images"]
"""What tells the same places of two drives; see `everplace.alignment.align`."""
