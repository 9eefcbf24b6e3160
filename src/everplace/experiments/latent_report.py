"""What a report says of a model's latent: the leakage audit, and the pictures decoded from it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from everplace.audit.findings import (
    Finding,
    condition_finding,
    divergence_finding,
    place_finding,
    swap_finding,
)  # fmt: skip
from everplace.audit.leakage import Audit, Probe
from everplace.experiments.translations import constant_figure, swap_figure, translation_figure
from everplace.model.condition_vae import ConditionVAE
from everplace.model.posterior import ACTIVE_ABOVE
from everplace.plots.canvas import new_axes, save_figure
from everplace.plots.leakage_bars import draw_bars, draw_divergences
from everplace.plots.style import COLOURS, shortened, write_plainly
from everplace.report.html import Section
from everplace.route.route import Route

__all__ = ["LATENT_PICTURES", "audit_section", "latent_section"]

LATENT_PICTURES = ("swap.png", "constant.png", "translation.png")
"""What `latent_section` writes, less the prefix."""

_PLACE, _CONDITION, _BOTH, _FREE = COLOURS[0], COLOURS[1], COLOURS[2], COLOURS[6]
_TITLE_WIDTH = 5.0


def audit_section(section: Section, audits: dict[str, Audit]) -> None:
    """The leakage audit of one or more models: a table, then each part's picture with what it means."""
    within = ", ".join(sorted({f"±{audit.tolerance}" for audit in audits.values()}))
    section.paragraph(
        f"Measured on the tested frames; retrieval counts a match within {within} places as right. Wanted: the "
        "condition cannot be predicted from z_p (chance) but from z_c; retrieval works by z_p and not by z_c; the swap "
        "error is below both of its baselines."
    )
    measures: dict[str, Callable[[Audit], float | str | None]] = {
        "condition from z_p, linear / MLP probe": lambda a: _probe(a.condition_from_z_p),
        "condition from z_c, linear / MLP probe": lambda a: _probe(a.condition_from_z_c),
        "chance of a probe": lambda a: a.condition_from_z_p.chance if a.condition_from_z_p else None,
        "recall@1 by z_p": lambda a: a.recall_at_1["z_p"],
        "recall@1 by z_c": lambda a: a.recall_at_1["z_c"],
        "recall@1 by z": lambda a: a.recall_at_1["z"],
        "chance of retrieval": lambda a: a.recall_chance,
        "swap error, mean z_c": lambda a: a.swap.mean_z_c if a.swap else None,
        "swap error, z_c of the same place": lambda a: a.swap.same_place_z_c if a.swap else None,
        "swap error, z_c of another place": lambda a: a.swap.other_place_z_c if a.swap else None,
        "baseline: the frame unchanged": lambda a: a.swap.unchanged if a.swap else None,
        "baseline: the mean image": lambda a: a.swap.mean_image if a.swap else None,
        "active dimensions of z_p / z_c": lambda a: f"{a.active_dimensions['z_p']} / {a.active_dimensions['z_c']}",
        "KL of z_p / z_c (nats)": lambda a: f"{a.kl['z_p']:.1f} / {a.kl['z_c']:.1f}",
    }
    rows = [[name, *(read(one) for one in audits.values())] for name, read in measures.items()]
    section.table(["measure", *audits], rows, digits=4)
    for label, audit in audits.items():
        if not audit.divided:
            section.paragraph(
                f"{label} is a plain VAE, whose latent no label divides: its first 96 dimensions stand in for z_p and "
                "its last 32 for z_c, to show what an undivided latent gives."
            )
        for title, finding, draw in _PARTS:
            found = finding(audit)
            if found is not None:
                caption = str(found) if audit.divided else found.sentence[0].upper() + found.sentence[1:]
                section.figure(draw(audit, f"{label}: {title}"), alt=f"{label}: {title}. {caption}", caption=caption)


def latent_section(
    section: Section, model: ConditionVAE, route: Route, out: Path, label: str, *, prefix: str = ""
) -> list[str]:
    """Figures 6 to 9 of the paper and a translation strip for a model and a route; the pictures also go into `out`.

    Args:
        section: Gets the pictures.
        model: The network, in evaluation mode.
        route: Aligned traverses.
        out: Gets the files.
        label: The model's name in the titles.
        prefix: Of the files' names.

    Returns:
        The names of the files in `out`, each with the prefix; none for a plain VAE.
    """
    if not model.config.labelled:
        section.paragraph(
            f"The latent of a {model.config.kind} has no z_p and z_c, so there is nothing to put together anew."
        )
        return []
    route = route.at(route.shared_stems())
    figures = [draw(model, route, label=label) for draw in (swap_figure, constant_figure, translation_figure)]
    swap, constant, translation = figures
    files = {f"{prefix}{name}": figure for name, figure in zip(LATENT_PICTURES, figures, strict=True)}
    for file, figure in files.items():
        save_figure(figure, out / file)
    section.figure(
        swap,
        alt=f"Images that {label} decodes from z_p of one frame and z_c of another.",
        caption="As Figures 6 and 7 of Oh and Eoh (2021): in each row the place of the frame at its left, in each "
        "column the condition of the frame at its top; all frames show one place, so all rows should look alike.",
        photos=True,
    )
    section.figure(
        constant,
        alt=f"Images that {label} decodes with one constant z_c.",
        caption="As Figures 8 and 9 of Oh and Eoh (2021): frames of all conditions, and below each what is decoded "
        "from its z_p and one z_c; below each other, the decoded images of a place should look alike.",
        photos=True,
    )
    section.figure(
        translation,
        alt=f"A frame that {label} decodes in every condition, with the true frames of these conditions below.",
        caption="A frame translated into every condition by its z_p and the condition's mean z_c, above the true "
        "frames of the same place.",
        photos=True,
    )
    return list(files)


def _condition_figure(audit: Audit, title: str) -> Figure:
    blocks = {"z_p": (audit.condition_from_z_p, _PLACE), "z_c": (audit.condition_from_z_c, _CONDITION)}
    bars: dict[str, float] = {}
    colours = []
    chance = 0.0
    for name, (probe, colour) in blocks.items():
        if probe is not None:
            bars |= {f"{name}, linear": probe.linear, f"{name}, MLP": probe.mlp}
            colours += [colour, colour]
            chance = probe.chance
    figure, axes = new_axes(6.0, 2.3)
    draw_bars(axes, bars, colours=colours, line=("chance", chance), label="accuracy of the probe", upper=1.0)
    _title(axes, title)
    return figure


def _place_figure(audit: Audit, title: str) -> Figure:
    figure, axes = new_axes(6.0, 2.0)
    draw_bars(
        axes, audit.recall_at_1, colours=(_PLACE, _CONDITION, _BOTH), line=("chance", audit.recall_chance),
        label="recall@1", upper=1.0, digits=3,
    )  # fmt: skip
    _title(axes, title)
    return figure


def _divergence_figure(audit: Audit, title: str) -> Figure:
    figure, axes = new_axes(6.0, 2.6)
    draw_divergences(axes, audit.kl_per_dimension, active_above=ACTIVE_ABOVE)
    _title(axes, title)
    return figure


def _swap_figure(audit: Audit, title: str) -> Figure:
    assert audit.swap is not None
    swap = audit.swap
    bars = {
        "z_p, mean z_c": swap.mean_z_c,
        "z_p, z_c of the same place": swap.same_place_z_c,
        "z_p, z_c of another place": swap.other_place_z_c,
        "the frame unchanged": swap.unchanged,
        "the mean image": swap.mean_image,
    }
    figure, axes = new_axes(6.0, 2.6)
    draw_bars(
        axes, bars, colours=(*(_BOTH,) * 3, _FREE, _FREE),
        line=("better baseline", min(swap.unchanged, swap.mean_image)), label="mean squared error a pixel", digits=4,
    )  # fmt: skip
    _title(axes, title)
    return figure


def _title(axes: Axes, title: str) -> None:
    write_plainly(axes.set_title(shortened(title, _TITLE_WIDTH, 10.0), loc="left"))


_PARTS: tuple[tuple[str, Callable[[Audit], Finding | None], Callable[[Audit, str], Figure]], ...] = (
    ("where the condition is", condition_finding, _condition_figure),
    ("where the place is", place_finding, _place_figure),
    ("whether the latent is alive", divergence_finding, _divergence_figure),
    ("swap reconstruction", swap_finding, _swap_figure),
)


def _probe(probe: Probe | None) -> str | None:
    return None if probe is None else f"{probe.linear:.3f} / {probe.mlp:.3f}"
