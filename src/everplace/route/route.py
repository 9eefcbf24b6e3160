"""A route: the same way driven several times, and how frames of its traverses belong together."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from everplace.errors import RouteError
from everplace.files import readable
from everplace.route.folder import read_traverses
from everplace.route.natural_order import natural_key
from everplace.route.route_toml import ROUTE_TOML, read_route_toml
from everplace.route.spelling import spelling_hint
from everplace.route.traverse import Frame, Pose, Traverse
from everplace.route.truth import TruthTable

__all__ = ["Frame", "Pose", "Route", "Traverse", "natural_key", "open_route"]


@dataclass(frozen=True, eq=False, slots=True)
class Route:
    """Traverses of one way.

    Attributes:
        root: The route's directory.
        traverses: In natural order of their names.
        stems_are_places: Whether equal stems in two traverses are the same place; route.toml can deny it.
        tolerance: Frames by which a match may be off, if route.toml says so.
        radius: Metres by which a match may be off, if route.toml says so.
        truth: Which frames show the same place, if route.toml names a file of pairs.
        protocol: The published protocol that chose the frames, if route.toml names one.
        truth_origin: Where the knowledge of which frames show the same place comes from, if route.toml says so; a part
            of a sentence, such as "positions by GPS within 10 m".
        aligned_by: The method on whose descriptors equal stems were found to be the same place, if route.toml names
            one; None: the stems do not come from an alignment by images. Stems are not the truth everywhere (see
            `matched_by_stem`).
    """

    root: Path
    traverses: tuple[Traverse, ...]
    stems_are_places: bool = True
    tolerance: int | None = None
    radius: float | None = None
    truth: TruthTable | None = None
    protocol: str | None = None
    truth_origin: str | None = None
    aligned_by: str | None = None

    @property
    def name(self) -> str:
        """The name of the route's directory."""
        return self.root.absolute().name

    @property
    def title(self) -> str:
        """The name, and the protocol that chose the frames where there is one: what results are headed by."""
        return self.name if self.protocol is None else f"{self.name} ({self.protocol})"

    @property
    def conditions(self) -> tuple[str, ...]:
        """The distinct conditions, in the order in which the traverses come."""
        return tuple(dict.fromkeys(traverse.condition for traverse in self.traverses))

    @property
    def aligned(self) -> bool:
        """Whether the traverses share at least one place, which they tell by its stem."""
        return bool(self._common())

    @property
    def why_not_aligned(self) -> str:
        """What to say of traverses that are not aligned: "<the traverses> ..."."""
        if self.stems_are_places:
            first, *others = (traverse.stems for traverse in self.traverses)
            hints = (spelling_hint(first, stems, " (") for stems in others)
            hint = next(filter(None, hints), "")
            return f"share no stem{hint})" if hint else "share no stem"
        return f"are not aligned, as {ROUTE_TOML} says (aligned = false)"

    @property
    def matched_by_stem(self) -> bool:
        """Whether frames are the same place by their stems, and neither by their poses nor by a file of pairs."""
        return self.radius is None and self.truth is None

    def __repr__(self) -> str:
        traverses = ", ".join(f"{readable(one.name)} ({len(one)})" for one in self.traverses)
        return f"Route({readable(self.root)}: {traverses})"

    def __iter__(self) -> Iterator[str]:
        """Yields the names of the traverses, by each of which the route gives one."""
        return (traverse.name for traverse in self.traverses)

    def __len__(self) -> int:
        """Returns the number of traverses."""
        return len(self.traverses)

    def __contains__(self, name: object) -> bool:
        """Whether a traverse has this name or condition."""
        return any(name in (traverse.name, traverse.condition) for traverse in self.traverses)

    def __getitem__(self, name: str) -> Traverse:
        """Returns the traverse of this name, or else the only one under this condition.

        Raises:
            RouteError: There is none, or the condition has several.
        """
        named = [traverse for traverse in self.traverses if traverse.name == name]
        found = named or [traverse for traverse in self.traverses if traverse.condition == name]
        if len(found) > 1:
            names = ", ".join(readable(traverse.name) for traverse in found)
            raise RouteError(f"the condition {name!r} has several traverses ({names}); name one of them")
        if not found:
            raise self._unknown(name)
        return found[0]

    def choose(self, names: Sequence[str]) -> Route:
        """Returns the route of the traverses whose name or condition is among `names`, in the route's order.

        Raises:
            RouteError: A name is neither a traverse's nor a condition's, or there are no names.
        """
        for name in names:
            if all(name not in (traverse.name, traverse.condition) for traverse in self.traverses):
                raise self._unknown(name)
        return self._of(
            traverse for traverse in self.traverses if traverse.name in names or traverse.condition in names
        )

    def only(self, names: Sequence[str]) -> Route:
        """Returns the route of the traverses with exactly these names, in the route's order; conditions do not count.

        Raises:
            RouteError: A name is not a traverse's, or there are no names.
        """
        for name in names:
            if all(name != traverse.name for traverse in self.traverses):
                raise RouteError(f"{readable(self.root)} has no traverse {name!r}; {self._offer()}")
        return self._of(traverse for traverse in self.traverses if traverse.name in names)

    def shared_stems(self) -> tuple[str, ...]:
        """Returns the stems that every traverse has, in natural order; empty when there is none, or none is a place."""
        first, *others = self.traverses
        if not others or (self.stems_are_places and all(traverse.stems == first.stems for traverse in others)):
            return first.stems
        common = self._common()
        return tuple(stem for stem in self.traverses[0].stems if stem in common)

    def at(self, stems: Collection[str]) -> Route:
        """Returns the route with only these stems in every traverse, each in its own order.

        Raises:
            RouteError: A traverse lacks one of the stems.
        """
        wanted = frozenset(stems)
        return replace(self, traverses=tuple(_restrict(traverse, wanted) for traverse in self.traverses))

    def _of(self, chosen: Iterable[Traverse]) -> Route:
        traverses = tuple(chosen)
        if not traverses:
            raise RouteError(f"no traverse of {readable(self.root)} was chosen; {self._offer()}")
        return replace(self, traverses=traverses)

    def _common(self) -> frozenset[str]:
        """Returns the stems that every traverse has and that are places."""
        first, *others = self.traverses
        if others and not self.stems_are_places:
            return frozenset()
        return frozenset(first.stems).intersection(*(traverse.stems for traverse in others))

    def _unknown(self, name: str) -> RouteError:
        known = (word for traverse in self.traverses for word in (traverse.name, traverse.condition))
        hint = spelling_hint([name], known)
        return RouteError(f"{readable(self.root)} has no traverse or condition {name!r}; {self._offer()}{hint}")

    def _offer(self) -> str:
        """Says what can be chosen."""
        names = [
            traverse.name if traverse.name == traverse.condition else f"{traverse.name} ({traverse.condition})"
            for traverse in self.traverses
        ]
        return f"there are: {', '.join(map(readable, names))}"


def open_route(path: str | os.PathLike[str]) -> Route:
    """Opens a route: lists its directories and reads its route.toml, but opens no image.

    Args:
        path: `ROUTE`, with one sub-directory for each traverse: `ROUTE/<traverse>/<frame>.<png|jpg|...>`.

    Returns:
        The route, its traverses in natural order of their names, their frames in natural order of their
        stems.

    Raises:
        RouteError: The directory is not a route (see `sources.folder.read_traverses`), or lacks the file of
            pairs that its route.toml names.
        ConfigError: Its route.toml is wrong.
    """
    root = Path(path)
    settings = read_route_toml(root)
    traverses = read_traverses(root, settings)
    truth = None if settings.truth is None else TruthTable(root / settings.truth, traverses)
    return Route(
        root,
        traverses,
        stems_are_places=settings.aligned,
        tolerance=settings.tolerance,
        radius=settings.radius,
        truth=truth,
        protocol=settings.protocol,
        truth_origin=settings.truth_from,
        aligned_by=settings.aligned_by,
    )


def _restrict(traverse: Traverse, wanted: frozenset[str]) -> Traverse:
    """Returns the traverse of the wanted stems, in its order."""
    positions = [position for position, stem in enumerate(traverse.stems) if stem in wanted]
    if len(positions) != len(wanted):
        missing = min(wanted.difference(traverse.stems), key=natural_key)
        raise RouteError(f"the traverse {traverse.name!r} lacks the frame {missing!r}; restrict to shared stems")
    return traverse.take(positions)
