"""How honestly a descriptor teaches itself: later drives and maps made difficult, and what is learnt from them.

    python -m studies teaching --data DATA --out OUT

Nordland's places 0-999 alone: summer 0-799 is the map, winter 0-399 teaches, winter 420-799 is tested; winter 820-999
is a drive of elsewhere.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.adaptation.discriminant import Projection
from everplace.adaptation.moments import Moments
from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Descriptors
from everplace.describe.registry import open_describer
from everplace.files import write_json, write_text
from everplace.images.decoding import ImageSpec, decode_images
from everplace.mapping.route_learning import Learning, drive_statistics, light_moments
from everplace.mapping.self_teaching import SurePairs
from everplace.match.similarity import similarity
from everplace.route.route import open_route
from everplace.route.selection import Selection, select
from everplace.route.traverse import Traverse
from studies.resample import resample_drive

__all__ = ["Trial", "Views", "measure", "trials", "views_of"]

DEGREES = (2, 4, 6)
_FIELD_OF_VIEW = 60  # degrees that a frame is taken to show
_STANDING = 500
_ELSEWHERE = -10


@dataclass(frozen=True, eq=False)
class Views:
    """What is described of a route.

    Attributes:
        map_drive: N×F.
        later: N×F, the same places on a later drive.
        turned: The same with the camera turned, by degrees.
        elsewhere: M×F, frames of places that are not on the map.
        light: See `light_moments`, of the map.
        taught: Places before this one teach.
        tested: Places from this one on are tested.
    """

    map_drive: NDArray[np.float32]
    later: NDArray[np.float32]
    turned: Mapping[int, NDArray[np.float32]]
    elsewhere: NDArray[np.float32]
    light: Moments
    taught: int
    tested: int

    def reduced(self, features: int) -> Views:
        """The same by fewer numbers, a fixed random projection, for what has to be fast."""
        into = np.random.default_rng(0).standard_normal((self.map_drive.shape[1], features)).astype(np.float32)
        into /= np.sqrt(np.float32(features))
        light = Moments(self.light.weight, self.light.total @ into, into.T @ self.light.products @ into)
        turned = {degrees: values @ into for degrees, values in self.turned.items()}
        return Views(
            self.map_drive @ into, self.later @ into, turned, self.elsewhere @ into, light, self.taught, self.tested
        )


@dataclass(frozen=True, eq=False)
class Drive:
    """A later drive.

    Attributes:
        values: K×F.
        places: (K,) what each frame shows; far below 0: nothing of the map.
    """

    values: NDArray[np.float32]
    places: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Trial:
    """A map and the drives that it learns from.

    Attributes:
        what: In the words of the table.
        drives: The later drives.
        map_drive: The map, if it is not the route's own.
    """

    what: str
    drives: tuple[Drive, ...]
    map_drive: Drive | None = None


def views_of(
    describer: Describer, map_drive: Traverse, later: Traverse, elsewhere: Traverse, taught: int, tested: int
) -> Views:
    """Describes all that `Views` has; the two first show the same places."""
    turned = {degrees: describer.describe(_turned(later[:taught], degrees)).values for degrees in DEGREES}
    described = (describer.describe(drive).values for drive in (map_drive, later, elsewhere))
    first, second, third = described
    return Views(first, second, turned, third, light_moments(describer, map_drive), taught, tested)


def trials(views: Views) -> list[Trial]:
    """All drives and maps."""
    count, places = views.taught, np.arange(len(views.map_drive))
    ahead = np.arange(count)

    def along(rows: NDArray[np.int64]) -> Drive:
        return Drive(views.later[rows], rows)

    def resampled(**options: Any) -> Drive:
        return along(resample_drive(count, 0, **{"stop": 0.0, **options}))

    def mapped(rows: NDArray[np.int64], noise: float = 0.0) -> Drive:
        values = views.map_drive[rows]
        spread = noise * views.map_drive.std(axis=0)
        drawn = np.random.default_rng(1).standard_normal(values.shape).astype(np.float32)
        return Drive(values + spread * drawn, rows)

    third, fifth, quarter, half = count // 3, count // 5, len(places) // 4, len(places) // 2
    off = views.elsewhere[:fifth]
    elsewhere = Drive(views.elsewhere, np.full(len(views.elsewhere), _ELSEWHERE))
    detour = Drive(
        np.concatenate([views.later[: 2 * fifth], off, views.later[2 * fifth : count]]),
        np.concatenate([ahead[: 2 * fifth], np.full(len(off), _ELSEWHERE), ahead[2 * fifth :]]),
    )
    backwards = np.concatenate([ahead[:third], ahead[third : 2 * third][::-1], ahead[2 * third :]])
    standing = np.insert(places, half // 2, np.full(_STANDING, half // 2))
    driven = (along(ahead),)
    return [
        Trial("as driven", driven),
        Trial("0.5 to 2 times as fast", (resampled(speeds=(0.5, 2.0)),)),
        Trial("with stops", (resampled(speeds=(1.0, 1.0), stop=0.05, stop_frames=(5, 40)),)),
        Trial("a third in reverse", (along(backwards),)),
        Trial("with a detour of a fifth", (detour,)),
        *(
            Trial(f"camera turned by {degrees} degrees", (Drive(values[:count], ahead),))
            for degrees, values in views.turned.items()
        ),
        Trial("the same drive twice", driven * 2),
        Trial("map with a loop", driven, mapped(np.concatenate([places, places[:quarter]]))),
        Trial("map there and back", driven, mapped(np.concatenate([places, places[::-1]]))),
        Trial("map with a stop of 500 frames", driven, mapped(standing)),
        Trial("the same with the noise of a camera", driven, mapped(standing, 0.1)),
        Trial("a drive of elsewhere", (elsewhere,)),
        Trial("one along the route, one of elsewhere", (*driven, elsewhere)),
    ]


def measure(trial: Trial, views: Views, dimensions: int) -> dict[str, Any]:
    """What the drives of a trial teach, and how often the tested frames are found before and after.

    Returns:
        The `frames` of the drives and the `pairs` among them; `precision`: share of the pairs within one place of the
        true one, None where there is no pair; `recall`: share of the frames on the map that are in such a pair;
        recall@1 of the later drive's tested frames within one place, `alone` with the map only and `taught`.
    """
    mapped = trial.map_drive or Drive(views.map_drive, np.arange(len(views.map_drive)))
    drives = [_described(drive.values) for drive in trial.drives]
    base = drive_statistics(mapped.values, views.light)
    learning = Learning(base, _described(mapped.values), drives, dimensions, None)
    pairs = learning.matched()
    right = [_right(found, drive, mapped) for found, drive in zip(pairs, trial.drives, strict=True)]
    learnt = sum(len(found.frames) for found in pairs)
    known = sum(int((drive.places >= 0).sum()) for drive in trial.drives)
    tested = Drive(views.later[views.tested :], np.arange(views.tested, len(views.later)))
    alone = _found(learning.solved([])[0], tested, mapped)
    return {
        "drive": trial.what,
        "frames": sum(len(drive.places) for drive in trial.drives),
        "pairs": learnt,
        "precision": sum(right) / learnt if learnt else None,
        "recall": sum(right) / known if known else None,
        "alone": alone,
        "taught": _found(learning.solved(pairs)[0], tested, mapped) if learnt else alone,
    }


def _described(values: NDArray[np.float32]) -> Descriptors:
    return Descriptors(values, tuple(map(str, range(len(values)))), "views")


def _right(pairs: SurePairs, drive: Drive, mapped: Drive) -> int:
    return int((np.abs(drive.places[pairs.frames] - mapped.places[pairs.places]) <= 1).sum())


def _found(projection: Projection, tested: Drive, mapped: Drive) -> float:
    query, database = (_described(_projected(projection, drive.values)) for drive in (tested, mapped))
    best = similarity(query, database).argmax(axis=1)
    return float((np.abs(mapped.places[best] - tested.places) <= 1).mean())


def _projected(projection: Projection, values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(values @ projection.weight.T + projection.bias, np.float32)


def _turned(drive: Traverse, degrees: float) -> list[NDArray[np.uint8]]:
    """The frames of a camera that looks further to the right; its edge is mirrored where nothing was seen."""
    frames = []
    for image in decode_images(drive.paths, ImageSpec()):
        height, width = image.shape[:2]
        moved = np.array([[1, 0, -degrees / _FIELD_OF_VIEW * width], [0, 1, 0]], np.float32)
        turned = cv2.warpAffine(image, moved, (width, height), borderMode=cv2.BORDER_REFLECT_101)
        frames.append(np.asarray(turned, np.uint8))
    return frames


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies teaching", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="directory that holds nordland64")
    parser.add_argument("--out", type=Path, required=True, help="directory for metrics.json and table.md")
    parser.add_argument("--method", default="hog16")
    parser.add_argument("--dimensions", type=int, default=96)
    parser.add_argument("--only", default="", help="rows to make: those with this in their name (default: all)")
    given = parser.parse_args(arguments)
    places = Selection(slice(0, 1000), drop_dark=True, drop_stationary=True)
    route = select(open_route(given.data / "nordland64"), places)
    summer, winter = route["summer"], route["winter"]
    views = views_of(open_describer(given.method), summer[:800], winter[:800], winter[820:], 400, 420)
    rows = []
    for trial in (one for one in trials(views) if given.only in one.what):
        rows.append(measure(trial, views, given.dimensions))
        print(_line(rows[-1]), flush=True)
    write_json(given.out / "metrics.json", rows)
    write_text(given.out / "table.md", "\n".join([*_HEAD, *map(_line, rows), ""]))


_HEAD = (
    "| drive, map | frames | pairs | precision of pairs | recall of frames | recall@1, one drive | self-taught |",
    "|---|---|---|---|---|---|---|",
)


def _line(row: Mapping[str, Any]) -> str:
    shares = (
        "none" if row[name] is None else f"{row[name]:.3f}" for name in ("precision", "recall", "alone", "taught")
    )
    return "| " + " | ".join([row["drive"], str(row["frames"]), str(row["pairs"]), *shares]) + " |"
