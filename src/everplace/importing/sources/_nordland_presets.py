"""Published protocols on Nordland: which frames they use and how far a match may be off.

Sources: 27,592 frames, ±10: Hausler et al., "Patch-NetVLAD", CVPR 2021. 2,760 summer queries against 27,592 winter
frames, ±1: Zaffar et al., "VPR-Bench", IJCV 2021. Olid: Olid, Fácil and Civera, "Single-View Place Recognition under
Seasonal Changes", PPNIV 2018. `paper`: Oh and Eoh, Appl. Sci. 2021, 11(19), 8976.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from everplace.errors import RouteError
from everplace.route.natural_order import natural_sorted

__all__ = ["PRESETS", "Preset", "choose_frames", "paper_protocol"]

_FULL, _EVERY, _OLID_TEST, _PAPER_TRAIN, _PAPER_TEST = 27_592, 10, 3_450, 1_600, 6_400


@dataclass(frozen=True)
class Preset:
    """A published protocol.

    Attributes:
        protocol: Its name in results.
        tolerance: Frames by which a match may be off.
        note: What the user should know.
        wants_list: Whether the list of frames without tunnels and stops belongs to it.
    """

    protocol: str
    tolerance: int
    note: str
    wants_list: bool = True


PRESETS: Mapping[str, Preset] = {
    "27592": Preset(
        "Nordland 27,592 frames, ±10",
        10,
        "Protocol: 27,592 frames a season without tunnels and stops, a match may be 10 frames off.",
    ),
    "2760": Preset(
        "Nordland 2,760 summer queries against 27,592 winter frames, ±1",
        1,
        "Protocol: every 10th summer frame asks, all 27,592 winter frames are the map, a match may be 1 frame off.",
    ),
    "olid": Preset(
        "Nordland, Olid partition, 3,450 test frames, ±2",
        2,
        "Protocol: the 3,450 test frames a season of the Olid partition, a match may be 2 frames off.",
        wants_list=False,
    ),
    "paper": Preset(
        "Nordland 1,600 training and 6,400 test frames a season, ±1",
        1,
        "Protocol: 1,600 training and 6,400 test frames a season. The paper does not say which: here 8,000 are spread "
        "evenly over the frames that all seasons share. Train on the places 0:1600, test on 1600:8000. It "
        "does not say by how much a match may be off either: here 1 frame.",
    ),
}
"""The presets by the name that the user gives."""


def paper_protocol(stems: Mapping[str, Sequence[str]], listed: bool, unfiltered: bool) -> str:
    """Makes sure that the frames of preset `paper` come without tunnels and stops, and names the protocol.

    Args:
        stems: The frames of each season that the source and the list leave.
        listed: Whether a list of frames was used.
        unfiltered: Whether the user wants tunnels and stops to take part.

    Raises:
        RouteError: Nothing says which frames are tunnels and stops.
    """
    protocol = PRESETS["paper"].protocol
    if unfiltered:
        return f"{protocol}, tunnels and stops not left out"
    for season, names in stems.items():
        if len(names) == _FULL:
            continue
        if not listed:
            raise RouteError(
                f"preset paper needs the list of the {_FULL} frames without tunnels and stops, but there is none and "
                f"{season} has {len(names)}; name it with `list=FILE`, or take all with `unfiltered=true`"
            )
        return f"{protocol}, by a list of {len(names)} frames"
    return protocol


def choose_frames(preset: str, stems: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Returns the frames of a protocol.

    Args:
        preset: A key of `PRESETS`.
        stems: The frames of each season that the source and the list leave.

    Raises:
        RouteError: The source does not have the frames that the protocol needs.
    """
    if preset == "2760":
        return _queries_and_map(stems)
    if preset == "paper":
        return _spread(stems, _PAPER_TRAIN + _PAPER_TEST)
    needed = _OLID_TEST if preset == "olid" else _FULL
    for season, names in stems.items():
        if len(names) != needed:
            raise _wrong_count(preset, season, len(names), needed)
    return {season: list(names) for season, names in stems.items()}


def _queries_and_map(stems: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    if "summer" not in stems or "winter" not in stems:
        raise RouteError(f"preset 2760 needs summer and winter, but there is only {', '.join(stems)}; add the other")
    winter = natural_sorted(stems["winter"])
    if len(winter) != _FULL:
        raise _wrong_count("2760", "winter", len(winter), _FULL)
    queries = winter[::_EVERY]
    missing = set(queries).difference(stems["summer"])
    if missing:
        raise RouteError(f"preset 2760 asks for {min(missing)!r} of summer, which is not there; take a complete copy")
    return {"summer": queries, "winter": winter}


def _spread(stems: Mapping[str, Sequence[str]], count: int) -> dict[str, list[str]]:
    shared = natural_sorted(set.intersection(*map(set, stems.values())))
    if len(shared) < count:
        raise RouteError(f"preset paper needs {count} frames that all seasons share, but there are {len(shared)}")
    chosen = [shared[position * len(shared) // count] for position in range(count)]
    return dict.fromkeys(stems, chosen)


def _wrong_count(preset: str, season: str, count: int, needed: int) -> RouteError:
    remedy = (
        "give the whole test split"
        if preset == "olid"
        else "name the list of frames without tunnels and stops with `list=FILE`"
    )
    return RouteError(f"preset {preset} needs {needed} frames a season, but {season} has {count}; {remedy}")
