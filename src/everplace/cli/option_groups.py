"""Options that belong together: a command takes a group as one parameter, and hands it on as one thing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from everplace.cli import options
from everplace.errors import ConfigError

if TYPE_CHECKING:
    from everplace.match.matching import Matching
    from everplace.progress import Progress
    from everplace.route.route import Route
    from everplace.route.selection import Selection
    from everplace.scoring.retrieval import MatchRule, Retrieval

__all__ = [
    "MatchingOptions",
    "RetrievalOptions",
    "RouteOptions",
    "SelectionOptions",
    "TrainingOptions",
    "TruthOptions",
    "grouped",
]


@dataclass(frozen=True, kw_only=True)
class SelectionOptions:
    """Which places take part."""

    frames: options.Frames = ""
    drop_dark: options.DropDark = False
    drop_stationary: options.DropStationary = False

    def selection(self) -> Selection:
        """What they choose; a ConfigError if --frames is not A:B."""
        from everplace.route.selection import Selection, parse_frames

        return Selection(parse_frames(self.frames) if self.frames else None, self.drop_dark, self.drop_stationary)


@dataclass(frozen=True, kw_only=True)
class RouteOptions(SelectionOptions):
    """Which traverses of a route take part, and which of their places."""

    conditions: options.Conditions = ""

    @property
    def names(self) -> tuple[str, ...]:
        """The traverses or conditions; none: all."""
        return options.split_names(self.conditions, "--conditions")

    def chosen(self, route: Path) -> Route:
        """Opens the route and chooses its traverses."""
        from everplace.route.route import open_route

        opened = open_route(route)
        return opened.choose(self.names) if self.names else opened


@dataclass(frozen=True, kw_only=True)
class TruthOptions:
    """When a match is right."""

    tolerance: options.Tolerance = None
    radius: options.Radius = None

    def truth(self) -> MatchRule:
        """What is given of it."""
        from everplace.scoring.retrieval import MatchRule

        return MatchRule(self.tolerance, self.radius)


@dataclass(frozen=True, kw_only=True)
class MatchingOptions:
    """How descriptors are compared."""

    standardise: options.Standardise = None
    sequence: options.Sequence = 1
    sequence_method: options.SequenceSearch = "filter"

    def matching(self) -> Matching:
        """The options of the match."""
        from everplace.match.matching import Matching

        return Matching(self.standardise, self.sequence, self.sequence_method)


@dataclass(frozen=True, kw_only=True)
class RetrievalOptions(MatchingOptions, TruthOptions, SelectionOptions):  # fields of the last come first
    """One method on one pair of traverses."""

    method: options.Method
    database: options.Database
    query: options.Query
    query_frames: options.QueryFrames = ""

    def retrieve(self, route: Path, progress: Progress) -> Retrieval:
        """Does it; see `everplace.scoring.retrieval.retrieve`."""
        from everplace.route.route import open_route
        from everplace.route.selection import parse_frames
        from everplace.scoring.retrieval import retrieve

        asking = parse_frames(self.query_frames, "--query-frames") if self.query_frames else None
        return retrieve(
            open_route(route), self.query, self.database, self.method, tolerance=self.tolerance, radius=self.radius,
            selection=self.selection(), matching=self.matching(), query_frames=asking, progress=progress,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """How methods are fitted."""

    image_size: options.ImageSize = None
    grey: options.Grey = False
    epochs: options.Epochs = None
    minutes: options.Minutes = None
    seed: options.Seed = None

    def __post_init__(self) -> None:
        """Refuses both options that say how long to train.

        Raises:
            ConfigError: Both are given.
        """
        if self.epochs is not None and self.minutes is not None:
            raise ConfigError("--epochs and --minutes exclude each other; give one of them")

    def given(self) -> dict[str, Any]:
        """Those that were given."""
        return options.only_given(**{field.name: getattr(self, field.name) for field in fields(self)})


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Lets a command take groups: a parameter whose type is one of these classes becomes an option for each field."""
    groups: dict[str, Any] = {}
    parameters: list[Parameter] = []
    for parameter in signature(command, eval_str=True).parameters.values():
        group = parameter.annotation
        if not is_dataclass(group):
            parameters.append(parameter)
            continue
        groups[parameter.name] = group
        types = get_type_hints(group, include_extras=True)
        for field in fields(group):
            default = Parameter.empty if field.default is MISSING else field.default
            parameters.append(
                Parameter(field.name, Parameter.KEYWORD_ONLY, default=default, annotation=types[field.name])
            )

    @wraps(command)
    def ungrouped(**given: Any) -> None:
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        command(**given)

    # The help names first what a command cannot do without.
    required_first = sorted(parameters, key=lambda one: (one.kind, one.default is not Parameter.empty))
    ungrouped.__signature__ = Signature(required_first)  # type: ignore[attr-defined]
    ungrouped.__annotations__ = {one.name: one.annotation for one in required_first}
    return ungrouped
