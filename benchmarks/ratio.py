"""One row of the table."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Ratio:
    """Two figures of one run and what is wanted of their ratio.

    Attributes:
        what: What is measured.
        measured: The figure of everplace, with its unit.
        against: The figure it is compared with.
        ratio: Their ratio.
        at_least: Smallest ratio wanted; None: `at_most` counts.
        at_most: Largest ratio wanted.
    """

    what: str
    measured: str
    against: str
    ratio: float
    at_least: float | None = None
    at_most: float | None = None

    @property
    def met(self) -> bool:
        if self.at_least is not None:
            return self.ratio >= self.at_least
        return self.at_most is None or self.ratio <= self.at_most

    @property
    def wanted(self) -> str:
        return f"≥ {self.at_least}" if self.at_least is not None else f"≤ {self.at_most}"

    def to_dict(self) -> dict[str, Any]:
        return {**asdict(self), "met": self.met}
