"""The hidden Markov model of a drive along a known route: where the robot is, how it moves, what it sees.

States are (place, direction of travel) for N places and two directions, and one state "not on the map". Each frame
brings N scores, of any method. The idea of a state off the map beside the places of a route is that of Xu,
Fischer, Sünderhauf and Milford, "Probabilistic Appearance-Invariant Topometric Localization with New Place
Awareness", IEEE RA-L 6(4), 2021; motion and emission here need no odometry and no training.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError, DescriptorsError

__all__ = ["RouteModel", "beside", "checked_scores", "likelihood_ratios"]

_LARGEST = 50.0  # nats a score may speak for a place before the others are heard: the sum of e^50 stays a double


@dataclass(frozen=True)
class RouteModel:
    """What is assumed of a drive; probabilities are for one frame to the next.

    Attributes:
        steps: Probability of moving by 0, 1, 2, ... places in the direction of travel; they sum to 1.
        forward: Probability of driving in the order of the database where nothing is known of it.
        turn: Probability of turning round.
        jump: Probability of being somewhere else on the map, anywhere: a kidnapped robot, a gap in the recording.
        leave: Probability of leaving the map. Who drives past its first or last place leaves it as well.
        enter: Probability of coming onto the map, anywhere, for a robot that is not on it.
        separation: By how many standard deviations of a frame's scores its true place scores above their mean.
        outlier: Share of frames whose scores say nothing about the true place: glare, a lorry, a wiper.
        doubt: Nats by which each frame counts against being on the map. Neighbouring frames look alike, so that along
            some path frames agree by chance more often than the model's independent frames would. On a map of two or
            three places no frame can make up for it.
        repeat: Share of the change that a step along the map brings, below which a frame shows the last one again and
            does not count (`everplace.sequences.frame_change`).
        beside: What an answer next to the true place is worth, where the true place is worth 1. Among places that look
            alike the one in their middle then is the answer, not one at their edge that is a little more probable.
    """

    steps: tuple[float, ...] = (0.08, 0.74, 0.18)
    forward: float = 0.9
    turn: float = 0.01
    jump: float = 0.001
    leave: float = 0.01
    enter: float = 0.1
    separation: float = 2.5
    outlier: float = 0.2
    doubt: float = 0.75
    repeat: float = 0.015
    beside: float = 0.75

    def __post_init__(self) -> None:
        """Refuses values that are no probabilities.

        Raises:
            ConfigError: A probability is outside (0, 1), `steps` do not sum to 1, `separation` or `repeat` is
                not positive, `doubt` is negative, or `beside` is outside [0, 1].
        """
        for name in ("forward", "turn", "jump", "leave", "enter", "outlier"):
            if not 0 < getattr(self, name) < 1:
                raise ConfigError(f"{name} = {getattr(self, name)} of the route model must lie between 0 and 1")
        if self.jump + self.leave >= 1:
            raise ConfigError("jump and leave of the route model must sum to less than 1")
        if min(self.steps, default=-1) < 0 or not abs(sum(self.steps) - 1) < 1e-9:
            raise ConfigError(f"steps = {self.steps} of the route model must be probabilities that sum to 1")
        for name in ("separation", "repeat"):
            if not 0 < getattr(self, name) < np.inf:
                raise ConfigError(f"{name} = {getattr(self, name)} of the route model must be a positive number")
        if not 0 <= self.doubt < np.inf:
            raise ConfigError(f"doubt = {self.doubt} of the route model must be 0 or a positive number")
        if not 0 <= self.beside <= 1:
            raise ConfigError(f"beside = {self.beside} of the route model must lie between 0 and 1")

    @property
    def stay(self) -> float:
        """Probability of going on along the route: neither jumping nor leaving."""
        return 1 - self.jump - self.leave

    @property
    def start(self) -> float:
        """Probability of being on the map before the first frame: the share of time that entering and leaving give."""
        return self.enter / (self.enter + self.leave)

    def anywhere(self, places: int) -> NDArray[np.float64]:
        """Returns 2×1: the probability of every place, by direction, of a robot that is on the map, no more known."""
        return np.array([[self.forward], [1 - self.forward]]) / places

    def turned(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mixes the directions (axis -2) by the probability of turning round."""
        mixed = values * (1 - self.turn)
        mixed += values[..., ::-1, :] * self.turn
        return mixed

    def worth(self, probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns ...×N: what every place is worth as an answer, given the probabilities that it is the true one."""
        worth: NDArray[np.float64] = probabilities + self.beside * beside(probabilities)
        return worth

    def exits(self, places: int) -> NDArray[np.float64]:
        """Returns 2×N: the probability of leaving the map from every state, by `leave` or past an end."""
        beyond = np.zeros((2, places))
        for offset, probability in enumerate(self.steps):
            beyond[0, max(places - offset, 0) :] += probability
            beyond[1, :offset] += probability
        exits: NDArray[np.float64] = self.leave + self.stay * self.turned(beyond)
        return exits


def beside(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns ...×N: the sum of the values of the places before and after each."""
    both = np.zeros_like(values)
    both[..., 1:] += values[..., :-1]
    both[..., :-1] += values[..., 1:]
    return both


def likelihood_ratios(scores: NDArray[Any], model: RouteModel) -> NDArray[np.float64]:
    """Says how much likelier each frame's scores are if it shows the place than if it is not on the map.

    With z = (score - mean) / standard deviation over the frame's own scores, background places are taken as
    N(0, 1) and the true place as N(d, 1), d = `separation`; a share ε = `outlier` of frames says nothing. Place j then
    has the likelihood w_j = (1 - ε) exp(d z_j - d²/2) + ε, in units of that of background alone. A frame off the map is
    taken to score as frames of a random place do, whatever the method's scores are like: its likelihood is the mean w.
    So one frame by itself never speaks for the map, and only frames that agree on a path do:
    ratio_j = w_j / mean(w) exp(-`doubt`). The ratios do not change when scores are shifted or scaled by a positive
    number, and no method needs a temperature of its own. "Not on the map" has the ratio 1.

    Args:
        scores: ...×N, higher = more alike. NaN: the place has no score, and is as likely as a random place.
            Infinities do not count for mean and deviation of the scores. A frame whose scores are all equal says
            nothing: all its ratios are 1.
        model: The assumptions.

    Returns:
        ...×N, positive, at most N exp(-`doubt`), or 1 where the frame says nothing.
    """
    S = np.asarray(scores, np.float64)
    known = np.isfinite(S)
    complete = bool(known.all())
    count = max(S.shape[-1], 1) if complete else np.maximum(known.sum(axis=-1, keepdims=True), 1)
    where: Any = True if complete else known  # sums over a mask are slow
    mean = S.sum(axis=-1, keepdims=True, where=where) / count
    z = S - mean
    spread = np.sqrt(np.square(z).sum(axis=-1, keepdims=True, where=where) / count)
    d = model.separation
    varies = spread > 1e-12 * np.abs(mean)  # less is rounding
    z *= np.divide(d, spread, out=np.full_like(spread, np.nan), where=varies)
    z -= d * d / 2
    ratios: NDArray[np.float64] = np.exp(np.minimum(z, _LARGEST, out=z), out=z)
    scored: Any = True
    if not (complete and varies.all()):
        scored = ~np.isnan(ratios)
        count = np.maximum(scored.sum(axis=-1, keepdims=True), 1)
    # In units of background alone, as the ratios here.
    random_place = (1 - model.outlier) * ratios.sum(axis=-1, keepdims=True, where=scored) / count + model.outlier
    doubted = np.exp(-model.doubt) / random_place
    ratios *= (1 - model.outlier) * doubted
    ratios += model.outlier * doubted
    if scored is not True:
        unscored = np.where(varies, np.exp(-model.doubt), 1.0)
        ratios[~scored] = np.broadcast_to(unscored, ratios.shape)[~scored]
    return ratios


def checked_scores(S: NDArray[Any], length: int = 1) -> NDArray[Any]:
    """Returns the scores of a traverse as an array, after a look at its shape and at the length of its sequences.

    Raises:
        ConfigError: `length` is below 1.
        DescriptorsError: S is not a matrix of numbers with at least one row and one column.
    """
    if length < 1:
        raise ConfigError(f"a sequence of {length} frames is not possible; give at least 1")
    S = np.asarray(S)
    if S.ndim != 2 or 0 in S.shape or S.dtype.kind not in "biuf":
        raise DescriptorsError(
            f"scores of shape {S.shape} and type {S.dtype} are no traverse; give a matrix of numbers, "
            "a row for each query and a column for each place"
        )
    return S
