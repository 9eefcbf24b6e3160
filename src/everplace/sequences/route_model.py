"""The hidden Markov model of a drive along a known route: where the robot is, how it moves, what it sees.

States are (place, gait) for N places and three gaits, and one state "not on the map". The gaits are driving at the
map's pace, driving at another pace, and driving against the order of the map. Each frame brings N scores, of any
method. The idea of a state off the map beside the places of a route is that of Xu, Fischer, Sünderhauf and Milford,
"Probabilistic Appearance-Invariant Topometric Localization with New Place Awareness", IEEE RA-L 6(4), 2021; motion and
emission here need no odometry and no training.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError, DescriptorsError

__all__ = ["GAITS", "RouteModel", "beside", "checked_scores"]

GAITS = (1, 1, -1)
"""Which way each gait goes: at the map's pace, at another pace, against the order of the map."""


@dataclass(frozen=True)
class RouteModel:
    """What is assumed of a drive; probabilities are for one frame to the next.

    Attributes:
        even: Probability of moving by 0, 1, 2, ... places where frames are as far apart as those of the map; they sum
            to 1.
        steps: The same at any other pace, and against the order of the map.
        pace: Probability of changing between the map's pace and another.
        evenly: Of the time that the robot drives in the order of the map, the share at the map's pace.
        forward: Probability of driving in the order of the database where nothing is known of it.
        turn: Probability of turning round.
        jump: Probability of being somewhere else on the map, anywhere: a kidnapped robot, a gap in the recording.
        leave: Probability of leaving the map. Who drives past its first or last place leaves it as well.
        enter: Probability of coming onto the map, anywhere, for a robot that is not on it.
        separation: By how many standard deviations of a frame's scores its true place scores above their mean.
        spread: Standard deviation of that from frame to frame: fog, snow and darkness make it small.
        outlier: Share of frames whose scores say nothing about the true place: glare, a lorry, a wiper.
        doubt: Share of what a frame says by which it counts against being on the map. Neighbouring frames look alike,
            so that along some path frames agree by chance more often than the model's independent frames would.
        repeat: Share of the change that a step along the map brings, below which a frame shows the last one again
            (`everplace.sequences.frame_change`).
        stand: Probability that a frame which shows its place comes again because the robot stands.
        blank: Probability that a frame which says nothing of its place comes again while the robot drives on: fog, a
            tunnel, a blinded camera.
        beside: What an answer next to the true place is worth, where the true place is worth 1. Among places that look
            alike the one in their middle then is the answer, not one at their edge that is a little more probable.
    """

    even: tuple[float, ...] = (0.01, 0.98, 0.01)
    steps: tuple[float, ...] = (0.15, 0.55, 0.3)
    pace: float = 0.04
    evenly: float = 0.67
    forward: float = 0.9
    turn: float = 0.015
    jump: float = 0.003
    leave: float = 0.01
    enter: float = 0.1
    separation: float = 2.0
    spread: float = 0.6
    outlier: float = 0.15
    doubt: float = 0.3
    repeat: float = 0.015
    stand: float = 0.3
    blank: float = 0.5
    beside: float = 0.75

    def __post_init__(self) -> None:
        """Refuses values that are no probabilities.

        Raises:
            ConfigError: A probability is outside (0, 1), `even` or `steps` do not sum to 1, `separation` or `repeat`
                is not positive, `spread` or `doubt` is negative, or `beside` is outside [0, 1].
        """
        for name in ("pace", "evenly", "forward", "turn", "jump", "leave", "enter", "outlier", "stand", "blank"):
            if not 0 < getattr(self, name) < 1:
                raise ConfigError(f"{name} = {getattr(self, name)} of the route model must lie between 0 and 1")
        for one, other in (("jump", "leave"), ("pace", "turn")):
            if getattr(self, one) + getattr(self, other) >= 1:
                raise ConfigError(f"{one} and {other} of the route model must sum to less than 1")
        for name in ("even", "steps"):
            steps = getattr(self, name)
            if min(steps, default=-1) < 0 or not abs(sum(steps) - 1) < 1e-9:
                raise ConfigError(f"{name} = {steps} of the route model must be probabilities that sum to 1")
        for name in ("separation", "repeat"):
            if not 0 < getattr(self, name) < np.inf:
                raise ConfigError(f"{name} = {getattr(self, name)} of the route model must be a positive number")
        for name in ("spread", "doubt"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ConfigError(f"{name} = {getattr(self, name)} of the route model must be 0 or a positive number")
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

    @property
    def repeats(self) -> float:
        """Probability that a frame of unknown worth comes again, on the map or off it."""
        return self.stand * (1 - self.outlier) + self.blank * self.outlier

    @cached_property
    def gaits(self) -> NDArray[np.float64]:
        """Probability of every gait where nothing is known of it."""
        return np.array([self.forward * self.evenly, self.forward * (1 - self.evenly), 1 - self.forward])

    @cached_property
    def changes(self) -> NDArray[np.float64]:
        """Probability of going from one gait (row) to another (column)."""
        keep, back = 1 - self.pace - self.turn, self.turn
        return np.array([[keep, self.pace, back], [self.pace, keep, back], [back / 2, back / 2, 1 - back]])

    def moves(self, gait: int) -> tuple[float, ...]:
        """Probability of moving by 0, 1, 2, ... places in the direction of a gait."""
        return self.steps if gait else self.even

    def anywhere(self, places: int) -> NDArray[np.float64]:
        """Returns 3×1: the probability of every place, by gait, of a robot that is on the map, no more known."""
        known: NDArray[np.float64] = self.gaits[:, None] / places
        return known

    def worth(self, probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns ...×N: what every place is worth as an answer, given the probabilities that it is the true one."""
        worth: NDArray[np.float64] = probabilities + self.beside * beside(probabilities)
        return worth

    def exits(self, places: int) -> NDArray[np.float64]:
        """Returns 3×N: the probability of leaving the map from every state, by `leave` or past an end."""
        beyond = np.zeros((len(GAITS), places))
        for gait, way in enumerate(GAITS):
            for offset, probability in enumerate(self.moves(gait)):
                beyond[gait, max(places - offset, 0) :] += probability if way > 0 else 0
                beyond[gait, :offset] += probability if way < 0 else 0
        exits: NDArray[np.float64] = self.leave + self.stay * (self.changes @ beyond)
        return exits


def beside(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns ...×N: the sum of the values of the places before and after each."""
    both = np.zeros_like(values)
    both[..., 1:] += values[..., :-1]
    both[..., :-1] += values[..., 1:]
    return both


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
