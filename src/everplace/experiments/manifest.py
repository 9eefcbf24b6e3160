"""What a comparison is made of: DIR/manifest.json says enough for another person to get the same numbers.

What all methods share is the study: route, truth, match, split, versions. One directory holds one study. Methods may
be added to it, taken away, or trained anew, also methods that are fitted to one where none was.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from everplace.describe.costs import COST_DEFINITIONS
from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.match.matching import Matching
from everplace.progress import Progress, quiet
from everplace.route.fingerprint import traverse_fingerprint
from everplace.route.route import Route
from everplace.scoring.retrieval import MatchRule, Pair, pair_of, rule_of, true_matches
from everplace.scoring.score_definitions import SCORE_DEFINITIONS

__all__ = ["DEFINITIONS", "MANIFEST", "Study", "compared_pairs", "open_study", "require_same_study", "require_told"]

MANIFEST = "manifest.json"

DEFINITIONS = {**SCORE_DEFINITIONS, **COST_DEFINITIONS}
"""One sentence for every score and cost, by its column in the tables."""

_FORMAT = 2
_LIBRARIES = (
    "everplace", "h5py", "lightning-fabric", "numpy", "onnxruntime", "pillow", "safetensors", "scikit-learn", "scipy",
    "torch",
)  # fmt: skip
_NOT_OF_THE_STUDY = ("methods", "left_out", "fit", "command")
"""With what methods are fitted stands in the config.toml of their runs, and other values are refused there."""


@dataclass(frozen=True, eq=False)
class Study:
    """What all methods of a comparison share.

    Attributes:
        route: The traverses, after selection; at least two.
        truth: When a match is right, fully resolved.
        matching: Options of the match.
        document: All of it, with versions, fingerprints and definitions, as plain values for manifest.json.
    """

    route: Route
    truth: MatchRule
    matching: Matching
    document: dict[str, Any]

    def key(self, settings: Mapping[str, Any]) -> str:
        """A hash of the study and of one method's settings, which decide that method's results."""
        text = json.dumps([self.document, dict(settings)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def open_study(
    route: Route,
    truth: MatchRule,
    matching: Matching,
    *,
    split: Mapping[str, Any] | None = None,
    progress: Progress = quiet,
) -> Study:
    """Gathers what a comparison is made of; every image file is read once.

    Args:
        route: The traverses, after selection.
        truth: When a match is right; what it leaves open comes from the route.
        matching: Options of the match.
        split: How the places were chosen, as plain values.
        progress: Told of the files read.

    Raises:
        RouteError: There is only one traverse, or the truth cannot be told.
        ConfigError: Both a tolerance and a radius are given.
        ImageError: An image cannot be read.
    """
    digest = hashlib.sha256()
    pairs = compared_pairs(route)
    resolved = truth
    for pair in pairs:
        matches, resolved = true_matches(pair, truth)
        digest.update(np.packbits(matches).tobytes())
    document = {  # in this order a directory that holds another study names what differs
        "format": _FORMAT,
        "route": route.name,
        "protocol": route.protocol,
        "split": dict(split or {}),
        "truth": {
            "tolerance": resolved.tolerance,
            "radius": resolved.radius,
            "pairs": resolved.pairs,
            "sha256": digest.hexdigest(),
        },
        "match": matching.metrics(),
        "traverses": [
            {
                "name": traverse.name,
                "condition": traverse.condition,
                "frames": len(traverse),
                "sha256": traverse_fingerprint(traverse, progress),
            }
            for traverse in route.traverses
        ],
        "pairs": [{"query": pair.query.name, "database": pair.database.name} for pair in pairs],
        "versions": _versions(),
        "machine": _machine(),
        "definitions": DEFINITIONS,
    }
    return Study(route, resolved, matching, json.loads(json.dumps(document)))


def compared_pairs(route: Route) -> list[Pair]:
    """All ordered pairs of a route's traverses.

    Raises:
        RouteError: There is only one traverse.
    """
    if len(route.traverses) < 2:
        raise RouteError(f"a comparison needs two traverses, but {route.name} has one; add another or choose both")
    return [pair_of(route, query.name, database.name) for query, database in permutations(route.traverses, 2)]


def require_told(route: Route, truth: MatchRule) -> None:
    """Makes sure that the truth of a comparison can be told, as far as names show it: neither slow nor heavy.

    Raises:
        RouteError: There is only one traverse.
        ConfigError: Both a tolerance and a radius are given.
        NotAlignedError: Stems are to tell the truth, but are no places, or none is shared.
    """
    for pair in compared_pairs(route):
        rule_of(pair, truth)


def require_same_study(out: Path, study: Study) -> None:
    """Makes sure that a directory holds no other study; nothing is written.

    Raises:
        ConfigError: It does, or its manifest.json cannot be read.
    """
    path = out / MANIFEST
    if not path.exists():
        return
    try:
        before = json.loads(path.read_text("utf-8"))
        known = {name: value for name, value in before.items() if name not in _NOT_OF_THE_STUDY}
    except (OSError, ValueError, AttributeError, RecursionError):
        raise ConfigError(
            f"{readable(path)} was not written by `everplace compare`, or was altered; name another `out`, or remove it"
        ) from None
    if different := _differences(known, study.document):
        name, old, new = different[0]
        raise ConfigError(
            f"{readable(out)} holds a comparison with other settings ({name} was {_short(old)} and is now "
            f"{_short(new)}); name another `out`, or remove it"
        )


def _differences(old: Any, new: Any, name: str = "") -> list[tuple[str, Any, Any]]:
    """Where two documents differ, by dotted names."""
    if isinstance(old, dict) and isinstance(new, dict):
        keys = [*new, *(key for key in old if key not in new)]
        parts = [_differences(old.get(key), new.get(key), f"{name}.{key}".strip(".")) for key in keys]
        return [one for part in parts for one in part]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        parts = [_differences(*both, f"{name}.{index}") for index, both in enumerate(zip(old, new, strict=True))]
        return [one for part in parts for one in part]
    return [] if old == new else [(name, old, new)]


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 40 else f"{text[:36]} ..."


def _versions() -> dict[str, str]:
    import cv2

    found = {"python": platform.python_version(), "opencv": cv2.__version__}
    for name in _LIBRARIES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):  # an extra
            found[name] = importlib.metadata.version(name)
    return found


def _machine() -> dict[str, str]:
    import torch

    device = torch.cuda.get_device_name() if torch.cuda.is_available() else "cpu"
    return {"system": f"{platform.system()} {platform.machine()}", "processor": _processor(), "device": device}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8", "replace").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or "unknown")
