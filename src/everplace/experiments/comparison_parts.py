"""What a comparison keeps of each method while it runs, so that one that was killed continues.

`DIR/parts/<label>-<key>/` holds `descriptors-<n>.h5` of the n-th traverse as soon as it is described, and `result.json`
when all pairs are scored. The key is the hash of the study and of the method's settings (`Study.key`), so a part never
goes stale; every file appears whole, by rename. `DIR/parts/pictures.json` lists the pictures of single methods in DIR.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from everplace.audit.leakage import Audit
from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Descriptors, load_descriptors
from everplace.errors import DescriptorsError
from everplace.files import remove_file, write_json, write_text
from everplace.progress import Progress, quiet
from everplace.route.traverse import Traverse
from everplace.scoring.precision_table import AtPrecision
from everplace.scoring.scores import PrecisionRecall, Scores

__all__ = ["PARTS", "MethodResult", "PairResult", "Part", "keep_pictures"]

PARTS = "parts"

_RESULT = "result.json"
_PICTURES = "pictures.json"
_COSTS = ("dimension", "ms_per_image", "beside_other_work", "peak_memory_mb", "unmeasured")


@dataclass(frozen=True, eq=False)
class PairResult:
    """One method on one ordered pair.

    Attributes:
        scores: See `everplace.scoring.scores`.
        curve: The best-match precision-recall curve.
        precision_table: See `everplace.scoring.precision_table`.
        frame_by_frame: The scores without sequences, where sequences are matched.
        new_place: See `everplace.scoring.retrieval.Retrieval`.
    """

    scores: Scores
    curve: PrecisionRecall
    precision_table: dict[str, AtPrecision]
    frame_by_frame: Scores | None = None
    new_place: dict[str, float] | None = None


@dataclass(frozen=True, eq=False)
class MethodResult:
    """One method on all ordered pairs.

    Attributes:
        pairs: By (query, database) traverse name.
        dimension: Numbers in a descriptor.
        ms_per_image: Description alone, see `everplace.describe.costs.time_describer`.
        beside_other_work: Whether other processes kept the machine busy while that was measured.
        peak_memory_mb: See `everplace.describe.costs.peak_memory`; None where it could not be measured.
        unmeasured: Why the peak memory could not be measured, if that failed.
        audit: The leakage audit, for the VAE family.
    """

    pairs: dict[tuple[str, str], PairResult]
    dimension: int
    ms_per_image: float
    beside_other_work: bool = False
    peak_memory_mb: float | None = None
    unmeasured: str = ""
    audit: Audit | None = None

    def costs(self) -> dict[str, int | float | None]:
        """What the method costs, as metrics.json and the columns of the tables say it."""
        peak = self.peak_memory_mb
        return {
            "dimension": self.dimension,
            "bytes_per_descriptor": 4 * self.dimension,
            "ms_per_image": round(self.ms_per_image, 4),
            "peak_memory_mb": None if peak is None else round(peak, 1),
        }


class Part:
    """What is kept of one method.

    Attributes:
        directory: Where; it need not exist yet.
    """

    def __init__(self, out: Path, label: str, key: str) -> None:
        self.directory = out / PARTS / f"{re.sub(r'[^A-Za-z0-9._-]+', '-', label)[:60]}-{key}"

    def described(
        self, describer: Describer, number: int, traverse: Traverse, progress: Progress = quiet
    ) -> Descriptors:
        """The descriptors of the route's n-th traverse, as they were kept, or described now and kept.

        Raises:
            ImageError: A frame cannot be decoded.
            StorageError: They cannot be written.
        """
        path = self.directory / f"descriptors-{number}.h5"
        if path.is_file():
            try:
                kept = load_descriptors(path)
            except DescriptorsError:  # damaged: made again, and replaced
                kept = None
            if kept is not None and kept.names == traverse.stems and kept.dimension == describer.dimension:
                return kept
        made = describer.describe(traverse, progress=progress)
        made.save(path)
        return made

    def save(self, result: MethodResult) -> None:
        """Keeps a result.

        Raises:
            StorageError: It cannot be written.
        """
        document = {
            **{name: getattr(result, name) for name in _COSTS},
            "audit": None if result.audit is None else dataclasses.asdict(result.audit),
            "pairs": [_pair_document(*names, one) for names, one in result.pairs.items()],
        }
        write_text(self.directory / _RESULT, json.dumps(document))

    def load(self) -> MethodResult | None:
        """The result that was kept; None if there is none, or it was damaged."""
        try:
            found = json.loads((self.directory / _RESULT).read_text("utf-8"))
            return MethodResult(
                pairs={(pair["query"], pair["database"]): _pair_result(pair) for pair in found["pairs"]},
                **{name: found[name] for name in _COSTS},
                audit=None if found["audit"] is None else TypeAdapter(Audit).validate_python(found["audit"]),
            )
        except (OSError, ValueError, LookupError, TypeError, ValidationError):
            return None


def keep_pictures(out: Path, names: Sequence[str]) -> None:
    """Removes the pictures that an earlier call wrote and that are none of these, which are noted for the next.

    Args:
        out: The directory of the comparison.
        names: PNG files in it.

    Raises:
        StorageError: Something cannot be removed or written.
    """
    record = out / PARTS / _PICTURES
    try:
        before = TypeAdapter(list[str]).validate_json(record.read_bytes())
    except (OSError, ValidationError):
        before = []
    for name in sorted(set(before) - set(names)):
        # A name of any other kind was not written here: the record was altered.
        if Path(name).name == name and name.endswith(".png"):
            remove_file(out / name)
    if before or names:
        write_json(record, list(names))


def _pair_document(query: str, database: str, result: PairResult) -> dict[str, Any]:
    curve = {name: getattr(result.curve, name) for name in ("recall", "precision", "threshold")}
    return {
        "query": query,
        "database": database,
        "scores": result.scores.to_dict(),
        "curve": {name: values.tolist() for name, values in curve.items()},
        "threshold_type": str(result.curve.threshold.dtype),
        "precision_table": {name: row.to_dict() for name, row in result.precision_table.items()},
        "frame_by_frame": None if result.frame_by_frame is None else result.frame_by_frame.to_dict(),
        "new_place": result.new_place,
    }


def _pair_result(document: dict[str, Any]) -> PairResult:
    curve = {name: np.array(values, np.float64) for name, values in document["curve"].items()}
    curve["threshold"] = curve["threshold"].astype(np.dtype(document["threshold_type"]))
    return PairResult(
        TypeAdapter(Scores).validate_python(document["scores"]),
        PrecisionRecall(**curve),
        TypeAdapter(dict[str, AtPrecision]).validate_python(document["precision_table"]),
        TypeAdapter(Scores | None).validate_python(document["frame_by_frame"]),
        document["new_place"],
    )
