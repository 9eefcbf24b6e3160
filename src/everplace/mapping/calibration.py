"""From the scores of a frame to the probability of every place of a map, and of being off the map.

A frame scores every place; z is a score in standard deviations above the mean of the frame's own scores, bent a little
upwards (`everplace.mapping.standard_scores`), so that neither the method nor the light of the frame changes its scale.
With P places, the weights exp(slope z_j) share out the probability of being on the map, whose log-odds are
offset + trust log(mean weight): the mean, not the sum, so that a map of 10^5 places is no surer than one of 10^3. With
a trust of 1 this is Bayes' rule for places that are alike beforehand; less than 1 says that a high score tells better
where a frame is than whether it is anywhere.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy.optimize
import scipy.special
from numpy.typing import NDArray

from everplace.errors import CheckpointError, DescriptorsError
from everplace.mapping.reliability import STRETCH, Interval, brier_score, expected_calibration_error, with_interval
from everplace.mapping.standard_scores import ScoreMoments, bent_scores, log_sum, near_values

__all__ = [
    "ON_MAP", "PROVISIONAL", "Calibration", "best_place", "fit_calibration", "hidden", "likelihood_ratios_of",
    "place_posterior",
]  # fmt: skip

ON_MAP = 10 / 11
"""Probability of being on the map before a frame is seen: that of `everplace.sequences.route_model.RouteModel`."""
_GUARD = 3
"""Reaches on either side of the true place that are hidden to make a frame one that is off the map."""
_DEVIATIONS = np.array([2.0, 0.3, 0.3])
"""How far offset, log slope and log trust may be expected to lie from the provisional ones."""


@dataclass(frozen=True)
class Calibration:
    """How the scores of a map are to be read.

    Attributes:
        offset: Log-odds of being on the map for a frame whose mean weight is 1.
        slope: Nats that one standard deviation of a frame's scores, near their mean, speaks for a place.
        trust: Exponent of the mean weight in the odds of being on the map.
        temper: Exponent of a frame's likelihood ratios where frames follow each other (`likelihood_ratios_of`).
        provisional: Whether it comes from other routes, because the map itself has no pairs of places.
        queries: Frames of known place that it was fitted to.
        expected_error: Expected calibration error on queries held out from the fit; None: not measured.
        expected_error_interval: Its 95 % interval.
        brier: Brier score of the same answers; None: not measured.
        brier_interval: Its 95 % interval.
    """

    offset: float
    slope: float
    trust: float
    temper: float
    provisional: bool
    queries: int
    expected_error: float | None = None
    expected_error_interval: Interval | None = None
    brier: float | None = None
    brier_interval: Interval | None = None

    def to_dict(self) -> dict[str, Any]:
        """What is written as JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Calibration:
        """Reads what `to_dict` gave, also after JSON has made lists of pairs.

        Raises:
            CheckpointError: A value is missing, of another kind, or impossible.
        """
        damaged = CheckpointError("the map's calibration is damaged; calibrate the map again")
        try:
            offset, slope, trust, temper = (float(values[name]) for name in ("offset", "slope", "trust", "temper"))
            error = _number(values["expected_error"]), _pair(values["expected_error_interval"])
            brier = _number(values["brier"]), _pair(values["brier_interval"])
            provisional, queries = bool(values["provisional"]), int(values["queries"])
        except (KeyError, TypeError, ValueError):
            raise damaged from None
        if not all(map(math.isfinite, (offset, slope, trust, temper))) or min(slope, trust, temper) <= 0:
            raise damaged
        return cls(offset, slope, trust, temper, provisional, queries, *error, *brier)


PROVISIONAL = Calibration(
    offset=-2.02,
    slope=2.955,
    trust=0.624,
    temper=0.4,
    provisional=True,
    queries=24_000,
    expected_error=0.013,
    expected_error_interval=(0.011, 0.017),
    brier=0.099,
    brier_interval=(0.095, 0.103),
)
"""Of maps of one drive, with `hog16` and the shipped prior, on rendered routes: `python -m studies calibration`."""


def place_posterior(
    scores: NDArray[Any], calibration: Calibration, whole: ScoreMoments | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The probability of every place, and that of being off the map, for each frame by itself.

    Args:
        scores: ...×P cosines, higher = more alike; NaN: none. A frame whose scores are all equal says nothing: every
            place is as likely as before.
        calibration: How to read them.
        whole: Where scores are given for the best places only, what all places score; None: all are given.

    Returns:
        ...×P probabilities, 0 where there is no score, and ... of being off the map; together they sum to 1.
    """
    z, log_places = bent_scores(scores, whole)
    evidence, _ = log_sum(z, calibration.slope)
    odds = calibration.offset + calibration.trust * (evidence - log_places)
    known = np.isfinite(evidence)
    says = known & (np.nanmax(np.abs(np.nan_to_num(z)), axis=-1, initial=0.0) > 0)
    odds = np.where(says, odds, np.where(known, math.log(ON_MAP / (1 - ON_MAP)), -np.inf))
    shares = np.exp(np.where(np.isnan(z), -np.inf, calibration.slope * z - np.where(known, evidence, 0.0)[..., None]))
    on, off = scipy.special.expit(odds), scipy.special.expit(-odds)
    return shares * on[..., None], off


def likelihood_ratios_of(
    scores: NDArray[Any], calibration: Calibration, whole: ScoreMoments | None = None
) -> NDArray[np.float64]:
    """How much likelier each frame is at every place than off the map, for frames that follow each other.

    Made for `everplace.sequences.route_filter.Belief.see`. The ratios are those of `place_posterior`, raised to the
    power of `Calibration.temper`: neighbouring frames show much the same and err together, so that ten of them say less
    than ten independent ones would.

    Args:
        scores: ...×P as there.
        calibration: How to read them.
        whole: As there.

    Returns:
        ...×P, positive; 1 where there is no score.
    """
    z, log_places = bent_scores(scores, whole)
    evidence, _ = log_sum(z, calibration.slope)
    trusted = calibration.offset - math.log(ON_MAP / (1 - ON_MAP)) + (calibration.trust - 1) * (evidence - log_places)
    ratios = calibration.slope * z + np.where(np.isfinite(evidence), trusted, 0.0)[..., None]
    says = np.isfinite(z) & (np.abs(np.nan_to_num(z)).max(axis=-1, keepdims=True, initial=0.0) > 0)
    result: NDArray[np.float64] = np.exp(np.where(says, calibration.temper * ratios, 0.0))
    return result


def best_place(probabilities: NDArray[np.float64], reach: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The most probable place of each frame, and the probability that the frame shows it or a neighbour.

    Args:
        probabilities: ...×P of `place_posterior`.
        reach: Neighbours on either side that count as the same place.

    Returns:
        The places and their probabilities, each of shape (...).
    """
    place = probabilities.argmax(axis=-1)
    return place, near_values(probabilities, place, reach, 0.0).sum(axis=-1).clip(0.0, 1.0)


def fit_calibration(
    scores: NDArray[Any], places: NDArray[np.integer[Any]], reach: int, provisional: bool = False
) -> Calibration:
    """Fits a calibration by maximum likelihood to frames whose place is known.

    Every frame counts twice: as it is, where the true place or a neighbour is right, and with the surroundings of its
    true place hidden, where "off the map" is right; the two as often as a robot is on the map and off it. The fewer
    frames there are, the more the provisional calibration speaks with them. The error is that of stretches of 24 frames
    whose neighbours alone were fitted.

    Args:
        scores: M×P, in the order of travel; higher = more alike, NaN: none. Maps of different sizes are stacked with
            NaN beyond the smaller.
        places: (M,) true places, positions among the P.
        reach: Neighbours on either side that count as the same place.
        provisional: Whether the frames are of other routes than those it will be used on.

    Raises:
        DescriptorsError: There is no frame, or a place lies outside the map.
    """
    S, true = np.asarray(scores), np.asarray(places, np.int64)
    if S.ndim != 2 or not len(S) or true.shape != (len(S),) or true.min() < 0 or true.max() >= S.shape[1]:
        raise DescriptorsError(
            f"scores of shape {S.shape} with {true.size} places are no calibration; give a row of scores for each "
            "frame, and its place on the map"
        )
    queries = _KnownQueries(S, true, reach)
    offset, slope, trust = _fitted(queries)
    fitted = Calibration(offset, slope, trust, PROVISIONAL.temper, provisional, len(S))
    stretches = np.arange(len(S)) // STRETCH
    if stretches[-1] < 1:
        return fitted
    probability, right = np.empty((2, len(S))), np.empty((2, len(S)), bool)
    for held in (stretches % 2 == 0, stretches % 2 == 1):
        part = Calibration(*_fitted(queries.rows(~held)), PROVISIONAL.temper, provisional, int((~held).sum()))
        for number, shown in enumerate((S[held], hidden(S[held], true[held], reach))):
            place, probability[number, held] = best_place(place_posterior(shown, part)[0], reach)
            right[number, held] = (np.abs(place - true[held]) <= reach) & (number == 0)
    weights = np.broadcast_to(np.array([[ON_MAP], [1 - ON_MAP]]), (2, len(S)))
    error, brier = (
        with_interval(measure, probability.T, right.T, weights.T)
        for measure in (expected_calibration_error, brier_score)
    )
    return Calibration(
        offset, slope, trust, PROVISIONAL.temper, provisional, len(S), error.value, error.interval, brier.value,
        brier.interval,
    )  # fmt: skip


class _KnownQueries:
    """Frames of known place as the fit sees them: standardised scores of all places, and of the right ones."""

    def __init__(self, scores: NDArray[Any], places: NDArray[np.int64], reach: int) -> None:
        self.on, self.on_places = bent_scores(scores)
        self.right = near_values(self.on, places, reach, np.nan)
        self.off, self.off_places = bent_scores(hidden(scores, places, reach))

    def rows(self, rows: NDArray[np.bool_]) -> _KnownQueries:
        """Some of them."""
        part = object.__new__(_KnownQueries)
        for name, values in vars(self).items():
            setattr(part, name, values[rows])
        return part

    def loss(self, parameters: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Negative log-likelihood with its gradient, by offset, log slope and log trust; with the prior's share."""
        offset, slope, trust = parameters[0], *np.exp(parameters[1:])
        all_places, all_slope = log_sum(self.on, slope)
        right, right_slope = log_sum(self.right, slope)
        evidence = all_places - self.on_places
        odds = offset + trust * evidence
        missed = -ON_MAP * scipy.special.expit(-odds)  # derivative of the loss by the odds
        loss = ON_MAP * (np.logaddexp(0, -odds) + all_places - right).sum()
        by_slope = (missed * trust * all_slope + ON_MAP * (all_slope - right_slope)).sum()
        by_offset, by_trust = missed.sum(), (missed * evidence).sum()

        hidden, hidden_slope = log_sum(self.off, slope)
        evidence = hidden - self.off_places
        odds = offset + trust * evidence
        taken = (1 - ON_MAP) * scipy.special.expit(odds)
        loss += (1 - ON_MAP) * np.logaddexp(0, odds).sum()
        by_slope += (taken * trust * hidden_slope).sum()
        by_offset, by_trust = by_offset + taken.sum(), by_trust + (taken * evidence).sum()

        away = (parameters - _START) / _DEVIATIONS
        gradient = np.array([by_offset, by_slope * slope, by_trust * trust]) + away / _DEVIATIONS
        return float(loss + 0.5 * away @ away), gradient


_START = np.array([PROVISIONAL.offset, math.log(PROVISIONAL.slope), math.log(PROVISIONAL.trust)])


def _fitted(queries: _KnownQueries) -> tuple[float, float, float]:
    # Without bounds a first step could leave the range of doubles.
    bounds = scipy.optimize.Bounds(_START - 5 * _DEVIATIONS, _START + 5 * _DEVIATIONS)
    found = scipy.optimize.minimize(queries.loss, _START, jac=True, method="L-BFGS-B", bounds=bounds).x
    return float(found[0]), float(np.exp(found[1])), float(np.exp(found[2]))


def hidden(scores: NDArray[Any], places: NDArray[np.int64], reach: int) -> NDArray[Any]:
    """The scores of frames that are made ones off the map: those around their true places are hidden.

    Args:
        scores: M×P.
        places: (M,) true places.
        reach: Neighbours that count as the same place; three times as many on either side are hidden.

    Returns:
        M×P, NaN where hidden.
    """
    distance = np.abs(np.arange(scores.shape[1]) - places[:, None])
    return np.where(distance <= _GUARD * reach, np.nan, scores)


def _number(value: Any) -> float | None:
    return None if value is None else float(value)


def _pair(value: Any) -> Interval | None:
    if value is None:
        return None
    low, high = value
    return float(low), float(high)
