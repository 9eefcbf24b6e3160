"""The forward recursion of `RouteModel`: the probability of every state, frame by frame.

A frame that shows something new is a motion and then evidence. A frame that repeats the last new one is no evidence of
the place, since it has been heard, but of the motion: either the robot stands, as it mostly does where the frame shows
its place, or it drives on through what looks the same (`everplace.sequences.evidence.repeat_likelihoods`). Both are
followed until the next new frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from everplace.sequences.evidence import repeat_likelihoods
from everplace.sequences.route_model import GAITS, RouteModel

__all__ = ["Belief", "Course", "Repeats"]


@dataclass(slots=True, eq=False)
class Belief:
    """The probability of every state of B robots that know nothing of each other.

    Attributes:
        on: B×3×N: driving in one of the gaits (`everplace.sequences.route_model.GAITS`), at each place.
        off: B: not on the map.
    """

    on: NDArray[np.float64]
    off: NDArray[np.float64]

    @classmethod
    def start(cls, model: RouteModel, robots: int, places: int) -> Belief:
        """Before the first frame: anywhere, in any gait."""
        on = np.broadcast_to(model.start * model.anywhere(places), (robots, len(GAITS), places))
        return cls(on.copy(), np.full(robots, 1 - model.start))

    def __getitem__(self, rows: slice) -> Belief:
        """The same probabilities of some of the robots, not copied."""
        return Belief(self.on[rows], self.off[rows])

    def copy(self) -> Belief:
        """The same probabilities, for a recursion of their own."""
        return Belief(self.on.copy(), self.off.copy())

    @property
    def places(self) -> NDArray[np.float64]:
        """B×N: the probability of every place, in whatever gait."""
        both: NDArray[np.float64] = self.on.sum(axis=1)
        return both

    @property
    def total(self) -> NDArray[np.float64]:
        """B: the sum of all probabilities."""
        everything: NDArray[np.float64] = self.on.sum(axis=(1, 2)) + self.off
        return everything

    def move(self, model: RouteModel) -> None:
        """Lets the time of one frame pass."""
        places = self.on.shape[-1]
        total = self.on.sum(axis=(1, 2))
        somewhere = model.jump * total + model.enter * self.off
        self.off *= 1 - model.enter
        self.off += model.leave * total
        headed = np.einsum("bgn,gh->bhn", self.on, model.stay * model.changes)
        for gait, way in enumerate(GAITS):
            moves = model.moves(gait)
            before, after = headed[:, gait], self.on[:, gait]
            np.multiply(before, moves[0], out=after)
            for offset, probability in enumerate(moves[1:], start=1):
                inside = max(places - offset, 0)
                if way > 0:
                    after[:, offset:] += probability * before[:, :inside]
                    self.off += probability * before[:, inside:].sum(axis=1)  # past an end
                else:
                    after[:, :inside] += probability * before[:, offset:]
                    self.off += probability * before[:, :offset].sum(axis=1)
        self.on += somewhere[:, None, None] * model.anywhere(places)

    def see(self, ratios: NDArray[np.float64]) -> None:
        """Weighs the places by one frame, the same for all robots.

        Args:
            ratios: N, of `everplace.sequences.evidence.likelihood_ratios`.
        """
        self.on *= ratios
        total = self.total
        self.on /= total[:, None, None]
        self.off /= total


@dataclass(slots=True, eq=False)
class Repeats:
    """The two ways in which B robots may have come to the last new frame again; their probabilities sum to 1 together.

    Attributes:
        standing: At the place where the frame came first.
        going: Driving on.
    """

    standing: Belief
    going: Belief

    @classmethod
    def of(cls, belief: Belief, ratios: NDArray[np.float64], model: RouteModel) -> Repeats:
        """Before the first repetition of a frame.

        Args:
            belief: After the frame.
            ratios: N or B×N, what the frame said of the places.
            model: The assumptions.
        """
        stands, goes = repeat_likelihoods(ratios, model)
        # Off the map nothing is told of the motion.
        standing = Belief(belief.on * stands, belief.off * model.repeats)
        return cls(standing, Belief(belief.on * goes, np.zeros_like(belief.off)))

    def __getitem__(self, rows: slice) -> Repeats:
        """The same probabilities of some of the robots, not copied."""
        return Repeats(self.standing[rows], self.going[rows])

    def go_on(self, model: RouteModel) -> None:
        """Lets the frame come again."""
        self.going.move(model)
        total = self.standing.total + self.going.total
        for way in (self.standing, self.going):
            way.on /= total[:, None, None]
            way.off /= total

    def either(self) -> Belief:
        """The probability of every state, standing or not."""
        return Belief(self.standing.on + self.going.on, self.standing.off + self.going.off)

    def copy(self) -> Repeats:
        """The same probabilities, for a recursion of their own."""
        return Repeats(self.standing.copy(), self.going.copy())


@dataclass(slots=True, eq=False)
class Course:
    """One robot's belief from frame to frame.

    Attributes:
        belief: After the last frame.
        repeats: Since the last new frame; None: it did not come again.
    """

    belief: Belief
    repeats: Repeats | None = None

    @classmethod
    def begin(cls, ratios: NDArray[np.float64], model: RouteModel) -> Course:
        """Takes the first frame of a drive: N ratios."""
        belief = Belief.start(model, 1, len(ratios))
        belief.see(ratios)
        return cls(belief)

    def follow(self, ratios: NDArray[np.float64], new: bool, model: RouteModel) -> None:
        """Takes the next frame.

        Args:
            ratios: N, what the last new frame says of the places, this one or that which it repeats.
            new: Whether it is new.
            model: The assumptions.
        """
        if new:
            self.repeats = None
            self.belief.move(model)
            self.belief.see(ratios)
        else:
            if self.repeats is None:
                self.repeats = Repeats.of(self.belief, ratios, model)
            self.repeats.go_on(model)
            self.belief = self.repeats.either()

    def copy(self) -> Course:
        """The same, for a recursion of its own."""
        return Course(self.belief.copy(), None if self.repeats is None else self.repeats.copy())
