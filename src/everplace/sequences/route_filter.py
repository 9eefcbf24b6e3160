"""Where on the route the robot is, from the frames so far: the forward recursion of `RouteModel`.

`RouteFilter` takes one frame after the other and remembers all; `filter_windows` answers every frame of a traverse
from the last L frames alone. Both skip frames that merely repeat the last new one (`everplace.sequences.frame_change`).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError, DescriptorsError
from everplace.sequences.frame_change import View, change_in_steps, new_frames
from everplace.sequences.route_model import RouteModel, beside, checked_scores, likelihood_ratios
from everplace.threads import usable_cores

__all__ = ["Answer", "Belief", "RouteFilter", "answer", "filter_windows"]

_BLOCK = 1 << 16  # states handled at once: half a MiB, which stays in a core's cache


@dataclass(frozen=True, slots=True)
class Answer:
    """Where one frame was taken.

    Attributes:
        place: The place that is worth most as an answer (`RouteModel.worth`), an index into the database.
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
        on = np.broadcast_to(model.start * model.anywhere(places), (robots, 2, places))
        return cls(on.copy(), np.full(robots, 1 - model.start))

    def __getitem__(self, rows: slice) -> Belief:
        """The same probabilities of some of the robots, not copied."""
        return Belief(self.on[rows], self.off[rows])

    @property
    def places(self) -> NDArray[np.float64]:
        """B×N: the probability of every place, in whatever direction."""
        both: NDArray[np.float64] = self.on.sum(axis=1)
        return both

    def move(self, model: RouteModel) -> None:
        """Lets the time of one frame pass."""
        places = self.on.shape[-1]
        total = 1 - self.off
        somewhere = model.jump * total + model.enter * self.off
        self.off *= 1 - model.enter
        self.off += model.leave * total
        headed = self.on * (model.stay * (1 - model.turn))
        headed += self.on[:, ::-1] * (model.stay * model.turn)
        np.multiply(headed, model.steps[0], out=self.on)
        for offset, probability in enumerate(model.steps[1:], start=1):
            moved = headed * probability
            inside = max(places - offset, 0)
            self.on[:, 0, offset:] += moved[:, 0, :inside]
            self.on[:, 1, :inside] += moved[:, 1, offset:]
            self.off += moved[:, 0, inside:].sum(axis=1) + moved[:, 1, :offset].sum(axis=1)  # past an end
        self.on += somewhere[:, None, None] * model.anywhere(places)

    def see(self, ratios: NDArray[np.float64]) -> NDArray[np.float64]:
        """Weighs the places by one frame each.

        Args:
            ratios: B×N, of `likelihood_ratios`.

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
        self._last: View | None = None

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
        ratios = likelihood_ratios(scores, self.model)
        view = View.of(ratios)
        if self._last is None or change_in_steps(self._last, view) >= self.model.repeat:
            if self._last is not None:
                self._belief.move(self.model)
            self._belief.see(ratios[None])
            self._last = view
        return answer(self.probabilities, self.model, self.reach)

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """N: the probability of every place after the last frame; what is missing to 1 is "not on the map"."""
        known: NDArray[np.float64] = self._belief.places[0]
        return known


def answer(probabilities: NDArray[np.float64], model: RouteModel, reach: int) -> Answer:
    """Reads an answer off the probabilities of the N places."""
    place = int(model.worth(probabilities).argmax())
    near = probabilities[max(place - reach, 0) : place + reach + 1].sum()
    return Answer(place, min(float(near), 1.0), min(float(probabilities.sum()), 1.0))


def filter_windows(S: NDArray[Any], length: int, model: RouteModel | None = None) -> NDArray[np.float32]:
    """Scores every place by the last L frames alone.

    Each query has a filter of its own that knows nothing before its L frames: fewer frames at the start. They are the
    frames i-L+1 to i, unless the robot stood: frames that show the last one again (`RouteModel.repeat`) count as one
    with it, so that the window holds L different views. With L of at least M it is `RouteFilter`.

    Args:
        S: M×N scores; rows and columns in the order of travel; NaN: none.
        length: Number of frames L, at least 1.
        model: The assumptions; None: the defaults.

    Returns:
        M×N: log-odds log(w / (1 - w)) of w = p_j + `RouteModel.beside` (p_(j-1) + p_(j+1)), finite, where p_j = P(the
        robot is at place j | the last L frames).

    Raises:
        ConfigError: `length` is below 1.
        DescriptorsError: S is no matrix of numbers.
    """
    S = checked_scores(S, length)
    known = RouteModel() if model is None else model
    new = new_frames(S, known)
    stands = np.diff(np.append(new, len(S)))  # how many frames show what each new one does
    out = np.empty(S.shape, np.float32)
    if length >= len(new):  # every window begins with the drive: one robot answers all frames
        belief = Belief.start(known, 1, S.shape[1])
        for frame, stay in zip(new, stands, strict=True):
            if frame:
                belief.move(known)
            belief.see(likelihood_ratios(S[frame : frame + 1], known))
            out[frame : frame + stay] = log_odds(belief, known)
        return out
    size = max(1, _BLOCK // S.shape[1])

    def fill(start: int) -> None:
        rows = slice(start, min(start + size, len(new)))
        first = max(start - length + 1, 0)
        ratios = likelihood_ratios(S[new[first : rows.stop]], known)
        odds = log_odds(_last_frames(ratios, start - first, length, known), known)
        out[new[start] : new[rows.stop - 1] + stands[rows.stop - 1]] = odds.repeat(stands[rows], axis=0)

    with ThreadPoolExecutor(usable_cores(), "everplace-sequence") as pool:
        for _ in pool.map(fill, range(0, len(new), size)):
            pass
    return out


def log_odds(belief: Belief, model: RouteModel) -> NDArray[np.float64]:
    """Returns B×N log(w / (1 - w)) of what every place is worth as an answer (`RouteModel.worth`).

    1 - w is summed up from the other states, so that certainty keeps its digits.
    """
    p = belief.places
    rest = np.zeros_like(p)
    np.cumsum(p[:, :-2], axis=1, out=rest[:, 2:])
    rest[:, :-2] += np.cumsum(p[:, :1:-1], axis=1)[:, ::-1]
    rest += (1 - model.beside) * beside(p)
    rest += belief.off[:, None]
    odds: NDArray[np.float64] = np.log(model.worth(p)) - np.log(rest)
    return odds


def _last_frames(ratios: NDArray[np.float64], before: int, length: int, model: RouteModel) -> Belief:
    """The belief of every row after the first `before`, which only precede them, from its last `length` frames."""
    robots, places = len(ratios) - before, ratios.shape[1]
    belief = Belief.start(model, robots, places)
    for ago in range(length - 1, -1, -1):
        frame = before - ago  # of the first robot
        begun = min(max(-frame, 0), robots)  # the robots before it have no frame so long ago
        moved = robots if ago == length - 1 else min(max(1 - frame, 0), robots)  # and those before it none before that
        belief[begun:moved].see(ratios[frame + begun : frame + moved])
        rest = belief[moved:]
        rest.move(model)
        rest.see(ratios[frame + moved : len(ratios) - ago])
    return belief
