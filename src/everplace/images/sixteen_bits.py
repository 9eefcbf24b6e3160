"""How the 16-bit values of a drive's frames become 8 bits: one scale for all of them.

Thermal cameras and sensors of 10, 12 or 14 bits use a part of the 16. A scale of each frame's own would hide how bright
a frame is, so a drive has one.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

__all__ = ["SixteenBits", "used_range"]

_VALUES = 2**16
# A hot or a dead pixel is no range, and neither is a lamp that one frame shows.
_OUTSIDE = 0.001
_MOST_CUT_OFF = 0.01


class SixteenBits:
    """The scale of one drive, and what the frames it was used on hold.

    Attributes:
        low: The value that becomes 0.
        high: The value from which on 255 is given.
        frames: How many frames had 16 bits.
    """

    def __init__(self, low: int = 0, high: int = _VALUES) -> None:
        """Defines low ≤ value < high as what is spread over 0 to 255; all 16 bits by default."""
        self.low, self.high = low, high
        self.frames = 0
        self._narrow: list[tuple[int, int]] = []
        self._cut_off = 0

    @property
    def is_whole(self) -> bool:
        """Whether the scale takes all 16 bits: 8-bit values are then the upper halves."""
        return (self.low, self.high) == (0, _VALUES)

    def add(self, other: SixteenBits) -> None:
        """Counts what another of the same scale has counted: no frame is counted in two threads at once."""
        self.frames += other.frames
        self._narrow += other._narrow
        self._cut_off += other._cut_off

    def unused(self) -> SixteenBits:
        """The same scale, which has counted nothing: for pictures that are looked at beside the frames."""
        return SixteenBits(self.low, self.high)

    def to_8_bits(self, values: NDArray[np.uint16]) -> NDArray[np.uint8]:
        """Scales the values of a frame, of any shape, and counts the frame."""
        self._look_at(values)
        if self.is_whole:
            return (values >> 8).astype(np.uint8)
        scaled = (values.astype(np.int64) - self.low) * 256 // (self.high - self.low)
        return np.clip(scaled, 0, 255).astype(np.uint8)

    def notes(self, drive: str) -> list[str]:
        """Returns sentences that the user should read once the frames of a drive were scaled."""
        if not self.frames:
            return [] if self.is_whole else [f"No frame of {drive} has 16 bits, so `range` and `bits` change nothing."]
        notes = []
        if self._cut_off:
            notes.append(
                f"{self._cut_off} of {self.frames} 16-bit frames of {drive} have more than {_MOST_CUT_OFF:.0%} of "
                f"their values outside {self.low}:{self.high}, where they become black or white."
            )
        if self._narrow:
            low, high = min(low for low, _ in self._narrow), max(high for _, high in self._narrow)
            notes.append(
                f"{len(self._narrow)} of {self.frames} 16-bit frames of {drive} use less than a sixteenth of their "
                f"range (values {low} to {high}), so few grey levels are left; import all drives with one scale, such "
                f"as `range={low}:{high + 1}`, or `bits=N` for a camera of N bits."
            )
        return notes

    def _look_at(self, values: NDArray[np.uint16]) -> None:
        self.frames += 1
        low, high = used_range([values])
        if high - low < (self.high - self.low) // 16:
            self._narrow.append((low, high))
        if ((values < self.low) | (values > self.high)).mean() > _MOST_CUT_OFF:
            self._cut_off += 1


def used_range(frames: Iterable[NDArray[np.uint16]]) -> tuple[int, int]:
    """Returns the lowest and the highest value of frames together, but for a thousandth of the pixels at each end.

    Raises:
        ValueError: There is no frame.
    """
    counts = np.zeros(_VALUES, dtype=np.int64)
    for values in frames:
        counts += np.bincount(values.reshape(-1), minlength=_VALUES)
    if not counts.any():
        raise ValueError("there is no 16-bit frame")
    shares = np.cumsum(counts) / counts.sum()
    low = int(np.searchsorted(shares, _OUTSIDE, side="right"))
    return low, max(low, int(np.searchsorted(shares, 1 - _OUTSIDE)))
