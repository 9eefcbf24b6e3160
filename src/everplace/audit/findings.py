"""What a leakage audit means: one sentence for each of its parts, computed from the measured numbers alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

from everplace.audit.leakage import Audit, Probe, SwapError

__all__ = ["Finding", "condition_finding", "divergence_finding", "place_finding", "swap_finding"]

_SLIGHT = 0.1
"""A share below this is not worth a word: of the way from chance to 1, of the other block's, of an error."""

_HALF = 0.5
"""A leak below this share is a slight one: of the way from chance to 1, of the other block's, of an error."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What one part of an audit means.

    Attributes:
        verdict: One or two words, like `healthy`, `slight leak`, `leak`, `shortcut` or `collapsed`.
        sentence: What was measured and what follows from it.
    """

    verdict: str
    sentence: str

    def __str__(self) -> str:
        return f"{self.verdict.capitalize()}: {self.sentence}"


def condition_finding(audit: Audit) -> Finding | None:
    """Where the condition is, by the better of the two probes; None where there is only one condition."""
    place, condition = audit.condition_from_z_p, audit.condition_from_z_c
    if place is None or condition is None:
        return None
    measured = (
        f"on places it has not seen, the better probe tells the condition from z_p for {_percent(_better(place))} of "
        f"the frames and from z_c for {_percent(_better(condition))} (chance: {_percent(place.chance)})"
    )
    in_z_p, in_z_c = (_above_chance(_better(probe), probe.chance, audit.frames) for probe in (place, condition))
    if in_z_p and not in_z_c:
        return Finding("wrong block", f"{measured}, so the condition is in z_p instead of z_c.")
    if in_z_p:
        if in_z_p < _HALF:
            how = "some of the condition leaks into z_p and the place descriptor changes a little with it"
            return Finding("slight leak", f"{measured}, so {how}.")
        how = "z_p holds the condition as well and the place descriptor changes with it"
        return Finding("leak", f"{measured}, so {how}.")
    if not in_z_c:
        return Finding("absent", f"{measured}, so neither block holds the condition.")
    if in_z_c < _HALF:
        return Finding("weak", f"{measured}, so z_p is free of the condition, but z_c holds only some of it.")
    return Finding("healthy", f"{measured}, so the condition is in z_c and not in z_p.")


def place_finding(audit: Audit) -> Finding:
    """Where the place is, by retrieval with each block alone."""
    z_p, z_c, z = (audit.recall_at_1[name] for name in ("z_p", "z_c", "z"))
    chance = audit.recall_chance
    measured = (
        f"retrieval between the traverses finds the place for {_percent(z_p)} of the frames by z_p, {_percent(z_c)} by "
        f"z_c and {_percent(z)} by both (chance: {_percent(chance)})"
    )
    noise = _noise(chance, audit.frames)
    by_z_p, by_z_c = (max(recall - chance, 0.0) for recall in (z_p, z_c))
    if max(by_z_p, by_z_c) <= noise:
        return Finding("absent", f"{measured}, so neither block alone holds the place.")
    if by_z_c >= by_z_p:
        rest = "z_p holds none of it" if by_z_p <= noise else "z_p holds no more of it"
        return Finding("shortcut", f"{measured}, so z_c carries the place and {rest}.")
    if by_z_c <= max(noise, _SLIGHT * by_z_p):
        return Finding("healthy", f"{measured}, so what is known of the place is in z_p and not in z_c.")
    verdict, part = ("leak", "much") if by_z_c >= _HALF * by_z_p else ("slight leak", "some")
    return Finding(verdict, f"{measured}, so the place is in z_p, but z_c carries {part} of it too.")


def divergence_finding(audit: Audit) -> Finding:
    """Whether the blocks are alive.

    The mean KL divergence of a block bounds from above what a sample of it can tell about the frame, so that P places
    cannot be told apart with fewer than ln P nats of z_p (the mutual information of Hoffman and Johnson 2016, ELBO
    surgery). In the same way conditions, of which the most frequent has a share s of the frames, cannot be told apart
    with fewer than -ln s nats of z_c: their entropy is no less.
    """
    sizes = {name: len(values) for name, values in audit.kl_per_dimension.items()}
    active, kl = audit.active_dimensions, audit.kl
    measured = (
        f"{active['z_p']} of the {sizes['z_p']} dimensions of z_p are active and hold {kl['z_p']:.1f} nats a frame, "
        f"{active['z_c']} of the {sizes['z_c']} of z_c hold {kl['z_c']:.1f}"
    )
    needed = math.log(audit.places)
    if active["z_p"] == active["z_c"] == 0:
        return Finding("collapsed", f"{measured}, so both blocks are empty.")
    place, condition = _lost_place(audit, needed), _lost_condition(audit)
    if place:
        return Finding("collapsed", f"{measured}, so {place}{f', and {condition}' if condition else ''}.")
    if condition:
        return Finding("collapsed", f"{measured}, so z_p is alive, but z_c has collapsed: {condition}.")
    if active["z_p"] < _SLIGHT * sizes["z_p"]:
        return Finding("narrow", f"{measured}, so z_p is alive, but most of it is unused.")
    return Finding(
        "healthy",
        f"{measured}, so z_p is alive: telling {audit.places} places apart takes {needed:.1f} nats at least.",
    )


def _lost_place(audit: Audit, needed: float) -> str:
    """Why z_p cannot tell the places apart, which takes `needed` nats; empty where it may."""
    if audit.active_dimensions["z_p"] == 0:
        return "z_p is empty and cannot hold the place"
    if audit.kl["z_p"] < needed:
        return f"z_p cannot tell {audit.places} places apart, which takes {needed:.1f} nats at least"
    return ""


def _lost_condition(audit: Audit) -> str:
    """Why z_c cannot tell the conditions apart; empty where it may, or where there is one condition only."""
    if audit.active_dimensions["z_c"] == 0:
        return "z_c is empty and cannot hold the condition"
    needed = -math.log(audit.condition_from_z_c.chance) if audit.condition_from_z_c is not None else 0.0
    if audit.kl["z_c"] < needed:
        return f"z_c cannot tell the conditions apart, which takes {needed:.1f} nats at least"
    return ""


def swap_finding(audit: Audit) -> Finding | None:
    """Where a decoded picture has its place from; None where there is only one condition."""
    swap = audit.swap
    if swap is None:
        return None
    free = swap.mean_z_c < min(swap.unchanged, swap.mean_image)
    helped = swap.same_place_z_c < min(swap.unchanged, swap.mean_image)
    # What z_c of another place spoils is what z_c of the same place gave.
    spoilt = swap.other_place_z_c > (1.0 + _SLIGHT) * swap.same_place_z_c
    measured = (
        f"a frame drawn in another condition is off by {swap.mean_z_c:.4f} with that condition's mean z_c, by "
        f"{swap.same_place_z_c:.4f} with z_c of the same place and by {swap.other_place_z_c:.4f} with z_c of another "
        f"(the frame unchanged: {swap.unchanged:.4f}, the mean image: {swap.mean_image:.4f})"
    )
    if free and not spoilt:
        return Finding("healthy", f"{measured}, so the place in the picture comes from z_p whatever z_c is.")
    if free:
        much = swap.other_place_z_c > (1.0 + _HALF) * swap.same_place_z_c
        verdict, part = ("leak", "much") if much else ("slight leak", "some")
        return Finding(verdict, f"{measured}, so the place in the picture comes from z_p, but {part} of it from z_c.")
    if helped and spoilt:
        return Finding("shortcut", f"{measured}, so the place in the picture comes from z_c and not from z_p.")
    return Finding("no translation", f"{measured}, so {_lost(swap, spoilt=spoilt)}.")


def _lost(swap: SwapError, *, spoilt: bool) -> str:
    """What it means that z_p draws no better than what costs nothing."""
    nearer = "the mean image" if swap.mean_image <= swap.unchanged else "the frame unchanged"
    carried = ", and what place there is in it comes from z_c too" if spoilt else ""
    return f"{nearer} comes at least as near as what is drawn from z_p{carried}"


def _better(probe: Probe) -> float:
    return max(probe.linear, probe.mlp)


def _above_chance(accuracy: float, chance: float, frames: int) -> float:
    """The share of the way from chance to 1; 0 where it is slight or no more than the noise of so few frames."""
    share = (accuracy - chance) / (1.0 - chance)
    return share if share > max(_SLIGHT, _noise(chance, frames) / (1.0 - chance)) else 0.0


def _noise(chance: float, frames: int) -> float:
    """Two standard errors of a share that is really `chance`."""
    return 2.0 * math.sqrt(chance * (1.0 - chance) / frames)


def _percent(share: float) -> str:
    return f"{share:.1%}".replace("%", " %")
