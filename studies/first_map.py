"""The pictures of "Your first map in five minutes".

    python -m studies first_map --out docs/images

A rendered route of 200 places; the map is summer. The winter drive begins at place 30 and leaves the route for 25
frames at place 110. OUT/first-map-matches.png: frames of it with their matches; OUT/first-map-belief.png: where the
localizer believed to be; OUT/first-map-table.png: the places by condition once winter and night, which ends at place
140, are added.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from everplace.files import write_bytes
from everplace.images.decoding import ImageSpec, decode_image
from everplace.mapping.localizer import Localizer
from everplace.mapping.map_answer import MapAnswer
from everplace.mapping.route_map import Map
from everplace.plots.canvas import new_axes, new_figure, palette_png_bytes
from everplace.plots.match_gallery import Match, draw_matches
from everplace.plots.style import COLOURS, INK, SEQUENTIAL, styled
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import Route, open_route
from everplace.route.traverse import Traverse

_PLACES, _BEGIN, _AWAY, _AT = 200, 30, 25, 110
_SHOWN = (8, 45, 75, 130, 150, 175)
_DPI = 110


@dataclass(frozen=True)
class Seen:
    """What the map answered of the winter drive, frame by frame.

    Attributes:
        paths: The frames.
        true: The place each shows; -1: none of the map.
        answers: The answers.
        belief: M×P.
    """

    paths: Sequence[Path]
    true: NDArray[np.int64]
    answers: Sequence[MapAnswer]
    belief: NDArray[np.float64]


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies first_map", description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as directory:
        route, elsewhere = worlds(Path(directory))
        map_ = Map.create(Path(directory) / "map", route["summer"], method="hog16")
        seen = driven(map_, route["winter"], elsewhere["winter"])
        pictures = {"matches": matches(seen, route["summer"]), "belief": belief(seen)}
        map_.add(route["winter"][_BEGIN:])
        map_.add(route["night"][:140])
        pictures["table"] = table(map_)
    for name, figure in pictures.items():
        write_bytes(given.out / f"first-map-{name}.png", palette_png_bytes(figure, _DPI))


def worlds(directory: Path) -> tuple[Route, Route]:
    """The route, and another one."""
    found = []
    for seed, places, names in ((31, _PLACES, ("summer", "winter", "night")), (32, _AWAY, ("winter",))):
        path = directory / f"world{seed}"
        render_route(path, render_config({"places": places, "size": (96, 192), "seed": seed, "conditions": names}))
        found.append(open_route(path))
    return found[0], found[1]


def driven(map_: Map, winter: Traverse, elsewhere: Traverse) -> Seen:
    """Localises the winter drive, which begins late and leaves the route for a while."""
    parts = [(winter[_BEGIN:_AT], _BEGIN), (elsewhere, None), (winter[_AT:], _AT)]
    localizer = Localizer(map_)
    paths, true, answers, beliefs = [], [], [], []
    for drive, first in parts:
        for number, path in enumerate(drive.paths):
            seen = localizer.observe(decode_image(path, ImageSpec()))
            answers.append(seen.answer)
            beliefs.append(seen.belief)
            paths.append(path)
            true.append(-1 if first is None else first + number)
    return Seen(paths, np.array(true), answers, np.stack(beliefs))


def matches(seen: Seen, summer: Traverse) -> Figure:
    """Some frames with what the map proposed."""
    shown = []
    for number in _SHOWN:
        answer, place = seen.answers[number], int(seen.true[number])
        proposed = summer.paths[summer.stems.index(answer.database_frame)]
        shown.append(
            Match(
                query=decode_image(seen.paths[number], ImageSpec()),
                proposed=decode_image(proposed, ImageSpec()),
                true=decode_image(summer.paths[place], ImageSpec()),
                score=answer.probability,
                right=abs(answer.place - place) <= 1,
                query_name=f"winter, frame {number}",
                proposed_name=f"summer, place {answer.place}",
                true_name=f"place {place}",
            )
        )
    figure = new_figure(9.0)
    note = "Right: within one place of the true one. The number is the probability that the localizer gives."
    draw_matches(figure, shown, title="Winter frames on a map of summer", note=note)
    return figure


@styled()
def belief(seen: Seen) -> Figure:
    """The belief over the route, frame by frame, and the probability of being off the map."""
    figure = new_figure(9.0, 5.0)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    above.imshow(
        np.sqrt(seen.belief.T), origin="lower", aspect="auto", cmap=SEQUENTIAL, vmin=0, vmax=1, interpolation="none"
    )
    frames = np.arange(len(seen.true))
    known = seen.true >= 0
    above.plot(frames[known], seen.true[known], ".", color=COLOURS[1], markersize=1.5, label="the true place")
    above.set_ylabel("place of the map")
    above.set_title("Where a winter drive is believed to be (bright: likely)", loc="left")
    above.legend(loc="upper left", labelcolor="white", markerscale=5)
    below.plot(frames, [answer.probability for answer in seen.answers], color=COLOURS[0], label="the match is right")
    below.plot(frames, [answer.off_map for answer in seen.answers], "--", color=COLOURS[1], label="not on the map")
    away = frames[~known]
    below.axvspan(away[0] - 0.5, away[-1] + 0.5, color=INK, alpha=0.12, lw=0)
    below.set_ylim(-0.03, 1.03)
    below.set_ylabel("probability")
    below.set_xlabel("frame of the winter drive; grey: it is off the map")
    below.legend(loc="center left")
    below.set_xlim(-0.5, len(frames) - 0.5)
    return figure


@styled()
def table(map_: Map) -> Figure:
    """Which places the map has under which condition."""
    found = map_.frames("place")
    places = np.asarray(found["place"])
    condition = {one["name"]: one["condition"] for one in map_.document["drives"]}
    rows = np.array([map_.conditions.index(condition[name]) for name in found["drive"].to_pylist()])
    there = np.zeros((len(map_.conditions), int(places.max()) + 1), np.bool_)
    there[rows[places >= 0], places[places >= 0]] = True
    figure, axes = new_axes(9.0, 2.2)
    axes.imshow(there, aspect="auto", cmap=ListedColormap(["white", COLOURS[5]]), interpolation="none")
    axes.set_yticks(range(len(there)), map_.conditions)
    for row in range(1, len(there)):
        axes.axhline(row - 0.5, color=INK, lw=0.6)
    axes.set_xlabel("place of the map")
    axes.set_title("Places by condition (blue: the map has a frame of it, white: a hole)", loc="left")
    return figure
