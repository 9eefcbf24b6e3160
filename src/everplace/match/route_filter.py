"""Where on the route the robot is, from the frames so far: the forward recursion of `RouteModel`.

`RouteFilter` takes one frame after the other and remembers all; `filter_windows` answers every frame of a traverse
from the last L frames, taken against the background of the places so far.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.data.images import usable_cores
from everplace.errors import ConfigError, DescriptorsError
from everplace.match.route_evidence import RouteEvidence
from everplace.match.route_model import RouteModel, checked_scores

__all__ = ["Answer", "Belief", "RouteFilter", "answer", "filter_windows"]

_BLOCK = 1 << 16  # states handled at once: half a MiB, which stays in a core's cache
_EVIDENCE = 1 << 21  # likelihood ratios held at once, beside those of the L-1 frames before


@dataclass(frozen=True, slots=True)
class Answer:
    """Where one frame was taken.

    Attributes:
        place: The most probable place, an index into the database.
        probability: That the frame shows this place or one of its `reach` neighbours on either side, in [0, 1].
        on_map: Probability that the robot is on the map at all, in [0, 1].
    """

    place: int
    probability: float
    on_map: float

    @property
    def lost(self) -> bool:
        """Whether the robot is more probably not on the map."""
        return self.on_map < 0.5


@dataclass(slots=True, eq=False)
class Belief:
    """The probability of every state of B robots that know nothing of each other; it sums to 1 for each.

    Attributes:
        on: B×2×N: driving along (0) or against (1) the order of the database, at each place.
        off: B: not on the map.
    """

    on: NDArray[np.float64]
    off: NDArray[np.float64]

    @classmethod
    def start(cls, model: RouteModel, robots: int, places: int) -> Belief:
        """Before the first frame: anywhere, in either direction."""
        return cls(np.full((robots, 2, places), model.start / (2 * places)), np.full(robots, 1 - model.start))

    def __getitem__(self, rows: slice) -> Belief:
        """The same probabilities of some of the robots, not copied."""
        return Belief(self.on[rows], self.off[rows])

    @property
    def places(self) -> NDArray[np.float64]:
        """B×N: the probability of every place, in whatever direction."""
        both: NDArray[np.float64] = self.on.sum(axis=1)
        return both

    def move(self, model: RouteModel, exits: NDArray[np.float64], new: NDArray[np.float64]) -> None:
        """Lets the time of one frame pass, as far as the frame is new: with probability 1 - w nothing moves.

        Args:
            model: The motion.
            exits: `model.exits(N)`.
            new: B: w of the next frame of each robot, in [0, 1], see `RouteEvidence`.
        """
        slow = np.flatnonzero(new < 1)
        if len(slow):
            share, on, off = new[slow], self.on[slow], self.off[slow]
        self._move(model, exits)
        if len(slow):
            self.on[slow] = on + share[:, None, None] * (self.on[slow] - on)
            self.off[slow] = off + share * (self.off[slow] - off)

    def _move(self, model: RouteModel, exits: NDArray[np.float64]) -> None:
        places = self.on.shape[-1]
        total = self.on.sum(axis=(1, 2))
        anywhere = (model.jump * total + model.enter * self.off) / (2 * places)
        self.off[:] = (1 - model.enter) * self.off + np.einsum("bdn,dn->b", self.on, exits)
        headed = model.turned(self.on)
        headed *= model.stay
        np.multiply(headed, model.steps[0], out=self.on)
        for offset, probability in enumerate(model.steps[1:places], start=1):
            moved = headed * probability
            self.on[:, 0, offset:] += moved[:, 0, :-offset]
            self.on[:, 1, :-offset] += moved[:, 1, offset:]
        self.on += anywhere[:, None, None]

    def see(self, ratios: NDArray[np.float64]) -> NDArray[np.float64]:
        """Weighs the places by one frame each.

        Args:
            ratios: B×N, of `RouteEvidence`, to the power of w.

        Returns:
            B: the log-likelihood ratio of the frame, given those before, to a frame off the map.
        """
        self.on *= ratios[:, None, :]
        total: NDArray[np.float64] = self.on.sum(axis=(1, 2)) + self.off
        self.on /= total[:, None, None]
        self.off /= total
        return np.log(total)


class RouteFilter:
    """Answers frame by frame, from all frames so far.

    Memory is that of a few numbers a place; a frame costs time in proportion to the number of places.
    """

    def __init__(self, places: int, model: RouteModel | None = None, *, reach: int = 1) -> None:
        """Starts anywhere on the map or off it.

        Args:
            places: N, the number of database frames, in the order of travel.
            model: The assumptions; None: the defaults.
            reach: Neighbours on either side that `Answer.probability` counts as the same place.

        Raises:
            ConfigError: There is no place, or `reach` is negative.
        """
        if places < 1 or reach < 0:
            raise ConfigError(
                f"a route of {places} places with a reach of {reach} is not possible; give 1 and 0 or more"
            )
        self.model = RouteModel() if model is None else model
        self.reach = reach
        self._belief = Belief.start(self.model, 1, places)
        self._exits = self.model.exits(places)
        self._evidence = RouteEvidence(places, self.model)
        self._frames = 0

    def update(self, scores: NDArray[Any]) -> Answer:
        """Takes the next frame.

        Args:
            scores: N scores of the frame against the database, higher = more alike; NaN: none.

        Returns:
            Where it was taken.

        Raises:
            DescriptorsError: There are not N scores.
        """
        places = self._belief.on.shape[-1]
        if np.shape(scores) != (places,):
            raise DescriptorsError(
                f"a frame of scores of shape {np.shape(scores)} does not fit a map of {places} places"
            )
        ratios, new = self._evidence.weigh(scores)
        if self._frames:
            self._belief.move(self.model, self._exits, np.array([new]))
        self._belief.see(ratios[None] ** new)
        self._frames += 1
        return answer(self.probabilities, self.reach)

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """N: the probability of every place after the last frame; what is missing to 1 is "not on the map"."""
        known: NDArray[np.float64] = self._belief.places[0]
        return known


def answer(probabilities: NDArray[np.float64], reach: int) -> Answer:
    """Reads an answer off the probabilities of the N places."""
    place = int(probabilities.argmax())
    near = probabilities[max(place - reach, 0) : place + reach + 1].sum()
    return Answer(place, min(float(near), 1.0), min(float(probabilities.sum()), 1.0))


def filter_windows(S: NDArray[Any], length: int, model: RouteModel | None = None) -> NDArray[np.float32]:
    """Scores every place by the last L frames.

    Each query has a filter of its own that is nowhere before frame i-L+1: fewer frames at the start. Only the
    background of the places and the usual change, which say nothing of where the robot is, are learnt from all frames
    so far (`RouteEvidence`). With L of at least M it is `RouteFilter`.

    Args:
        S: M×N scores; rows and columns in the order of travel; NaN: none.
        length: Number of frames L, at least 1.
        model: The assumptions; None: the defaults.

    Returns:
        M×N: log-odds log(p / (1 - p)) of p = P(the robot is at place j | frames i-L+1 to i), finite.

    Raises:
        ConfigError: `length` is below 1.
        DescriptorsError: S is no matrix of numbers.
    """
    if length < 1:
        raise ConfigError(f"--sequence {length} is not possible; give a number of frames of at least 1")
    S = checked_scores(S)
    known = RouteModel() if model is None else model
    length = min(length, len(S))
    out = np.empty(S.shape, np.float32)
    exits = known.exits(S.shape[1])
    size, many = max(1, _BLOCK // S.shape[1]), max(1, _EVIDENCE // S.shape[1])
    evidence = RouteEvidence(S.shape[1], known)
    frames = _Frames.none(S.shape[1])

    def fill(start: int) -> None:
        rows = slice(start, min(start + size, frames.end))
        out[rows] = log_odds(_last_frames(frames, rows, length, known, exits))

    with ThreadPoolExecutor(usable_cores(), "everplace-sequence") as pool:
        for start in range(0, len(S), many):
            frames = frames.last(length - 1).followed_by(*evidence.weigh_all(S[start : start + many]))
            for _ in pool.map(fill, range(start, frames.end, size)):
                pass
    return out


@dataclass(frozen=True, slots=True, eq=False)
class _Frames:
    """The evidence of F frames of a traverse.

    Attributes:
        begin: Row of the first.
        alone: F×N likelihood ratios of each frame for those who have seen none before.
        ratios: F×N, to the power of `new`: for those who have seen the frame before.
        new: F: what is new to them.
    """

    begin: int
    alone: NDArray[np.float64]
    ratios: NDArray[np.float64]
    new: NDArray[np.float64]

    @classmethod
    def none(cls, places: int) -> _Frames:
        return cls(0, np.empty((0, places)), np.empty((0, places)), np.empty(0))

    @property
    def end(self) -> int:
        """Row after the last frame."""
        return self.begin + len(self.new)

    def last(self, count: int) -> _Frames:
        cut = max(len(self.new) - count, 0)
        return _Frames(self.begin + cut, self.alone[cut:], self.ratios[cut:], self.new[cut:])

    def followed_by(self, alone: NDArray[np.float64], new: NDArray[np.float64]) -> _Frames:
        ratios = alone.copy()
        partly = new < 1  # powers are slow
        ratios[partly] **= new[partly, None]
        return _Frames(
            self.begin,
            np.concatenate([self.alone, alone]),
            np.concatenate([self.ratios, ratios]),
            np.concatenate([self.new, new]),
        )


def log_odds(belief: Belief) -> NDArray[np.float64]:
    """Returns B×N log(p / (1 - p)); 1 - p is summed up from the other states, so that certainty keeps its digits."""
    p = belief.places
    rest = np.zeros_like(p)
    np.cumsum(p[:, :-1], axis=1, out=rest[:, 1:])
    rest[:, :-1] += np.cumsum(p[:, :0:-1], axis=1)[:, ::-1]
    rest += belief.off[:, None]
    odds: NDArray[np.float64] = np.log(p) - np.log(rest)
    return odds


def _last_frames(frames: _Frames, rows: slice, length: int, model: RouteModel, exits: NDArray[np.float64]) -> Belief:
    """The belief of every row from its last `length` frames."""
    belief = Belief.start(model, rows.stop - rows.start, frames.ratios.shape[1])
    for ago in range(length - 1, -1, -1):
        begun = max(ago - rows.start, 0)  # the robots before it have no frame so long ago
        if begun >= rows.stop - rows.start:
            continue
        moved = max(ago + 1 - rows.start, 0)
        seen = slice(rows.start + begun - ago - frames.begin, rows.stop - ago - frames.begin)
        if ago == length - 1:
            belief[begun:].see(frames.alone[seen])
        else:
            belief[moved:].move(model, exits, frames.new[seen][moved - begun :])
            belief[begun:].see(frames.ratios[seen])
    return belief
