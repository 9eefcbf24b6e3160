"""Whether a map's answers keep their word, by those that were held out when it last learnt."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from everplace.mapping.reliability import (
    Interval,
    Measured,
    ReliabilityBins,
    brier_score,
    expected_calibration_error,
    reliability_bins,
    threshold_for,
    with_interval,
)
from everplace.mapping.route_map import Map

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["AnswerReliability", "answer_reliability", "reliability_figure"]

_PRECISIONS = (0.9, 0.95, 0.99)


@dataclass(frozen=True, eq=False)
class AnswerReliability:
    """What the answers of a map were worth, each of the last ten views of a drive that was held out.

    Attributes:
        answers: How many.
        bins: The reliability diagram.
        calibration_error: Expected calibration error, with its interval over stretches.
        brier: Brier score, likewise.
        thresholds: By precision, the least probability that reaches it and its interval; infinite: none does.
    """

    answers: int
    bins: ReliabilityBins
    calibration_error: Measured
    brier: Measured
    thresholds: dict[float, tuple[float, Interval]]

    def to_dict(self) -> dict[str, Any]:
        """JSON values; null stands for a threshold that no answer reaches."""
        found: dict[str, Any] = {"answers": self.answers}
        for name, measured in (("calibration_error", self.calibration_error), ("brier", self.brier)):
            found |= {name: measured.value, f"{name}_interval": list(measured.interval)}
        for precision, (threshold, interval) in self.thresholds.items():
            name = f"threshold_at_{precision:g}"
            found |= {name: _finite(threshold), f"{name}_interval": [_finite(end) for end in interval]}
        return found


def answer_reliability(map_: Map) -> AnswerReliability | None:
    """Measures the answers that were held out; None: a map of so few sure pairs has none, and is provisional."""
    probability, right = map_.held_out_answers.probability, map_.held_out_answers.right
    if not len(probability):
        return None
    return AnswerReliability(
        answers=len(probability),
        bins=reliability_bins(probability, right),
        calibration_error=with_interval(expected_calibration_error, probability, right),
        brier=with_interval(brier_score, probability, right),
        thresholds={precision: threshold_for(precision, probability, right) for precision in _PRECISIONS},
    )


def reliability_figure(found: AnswerReliability) -> Figure:
    """The diagram, and below it the numbers."""
    from everplace.plots.canvas import new_axes
    from everplace.plots.reliability_diagram import draw_reliability

    figure, axes = new_axes(6.0, 5.2)
    draw_reliability(axes, found.bins, error=found.calibration_error.value)
    lines = [
        f"{name} {measured.value:.3f} ({measured.interval[0]:.3f} to {measured.interval[1]:.3f})"
        for name, measured in (("calibration error", found.calibration_error), ("Brier score", found.brier))
    ]
    lines += [
        f"{precision:.0%} right from a probability of {_said(threshold)} ({_said(low)} to {_said(high)})"
        for precision, (threshold, (low, high)) in found.thresholds.items()
    ]
    figure.supxlabel("\n".join(["    ".join(lines[:2]), *lines[2:], "in brackets: 95 % intervals"]), fontsize=8)
    return figure


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None


def _said(threshold: float) -> str:
    return f"{threshold:.3f}" if math.isfinite(threshold) else "none"
