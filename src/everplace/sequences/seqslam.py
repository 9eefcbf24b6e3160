"""SeqSLAM's search for sequences: local contrast enhancement, then straight trajectories of several velocities.

Milford and Wyeth, "SeqSLAM: Visual Route-Based Navigation for Sunny Summer Days and Stormy Winter Nights", ICRA
2012; constants as in OpenSeqSLAM (Sünderhauf, Neubert and Protzel 2013). Scores stand where the paper has
differences, so signs are turned, and trajectories end at the query instead of being centred on it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError
from everplace.sequences.route_model import checked_scores

__all__ = ["VELOCITIES", "enhance_contrast", "seqslam"]

VELOCITIES = (0.8, 0.9, 1.0, 1.1, 1.2)
"""Places a frame: v_min to v_max in steps of v_step."""

_BLOCK = 1 << 20  # matrix elements handled at once


def seqslam(
    S: NDArray[Any], length: int, *, velocities: tuple[float, ...] = VELOCITIES, window: int = 10
) -> NDArray[np.float32]:
    """Scores every place by the best straight trajectory that ends there.

    out[i, j] = max over v of the mean of Ŝ[i-k, j-round(v k)] over k = 0 .. length-1, as far as these frames and
    places exist; Ŝ is S with enhanced contrast. So the answer at frame i uses the frames i-length+1 to i, fewer at
    the start. With the one velocity 1 and no enhancement it is `everplace.sequences.sequence_search.average_sequences`.

    Args:
        S: M×N scores; rows and columns in the order of travel; NaN counts in no mean.
        length: Number of frames L, at least 1.
        velocities: Places a frame; at least one, none negative.
        window: R of `enhance_contrast`; 0: no enhancement.

    Returns:
        M×N; -inf where nothing is known.

    Raises:
        ConfigError: `length` is below 1, `window` is negative, or there is no velocity or a negative one.
        DescriptorsError: S is no matrix of numbers.
    """
    S = checked_scores(S, length)
    if window < 0 or not velocities or not all(0 <= v < np.inf for v in velocities):
        raise ConfigError(f"velocities {velocities} with a window of {window} are not possible; give 0 or more")
    out = np.empty(S.shape, np.float32)
    size = max(1, _BLOCK // S.shape[1])
    for start in range(0, len(S), size):
        rows = slice(start, min(start + size, len(S)))
        first = max(start - length + 1, 0)
        enhanced = enhance_contrast(S[first : rows.stop], window)
        known = np.isfinite(enhanced)
        enhanced[~known] = 0
        best = np.full((rows.stop - start, S.shape[1]), -np.inf)
        for velocity in velocities:
            np.maximum(best, _mean_along(enhanced, known, start - first, length, velocity), out=best)
        out[rows] = best
    return out


def enhance_contrast(S: NDArray[Any], window: int) -> NDArray[np.float64]:
    """Subtracts from every score the mean of its neighbours in the row, and divides by their standard deviation.

    Ŝ[i, j] = (S[i, j] - m) / s with the mean m and the deviation s of S[i, j-R//2 .. j+R//2], fewer at the ends.

    Args:
        S: M×N scores; what is not finite is left out of m and s.
        window: R in places; 0 returns a copy of S.

    Returns:
        M×N; 0 where the neighbours are all equal.
    """
    S = np.array(S, np.float64)
    if window == 0:
        return S
    columns = np.arange(S.shape[1])
    low, high = np.maximum(columns - window // 2, 0), np.minimum(columns + window // 2 + 1, S.shape[1])
    known = np.isfinite(S)
    centred = np.where(known, S, 0.0)
    # Sums of what is near 0 lose no digits when running sums are subtracted.
    centred -= np.where(known, centred.sum(axis=1, keepdims=True) / np.maximum(known.sum(axis=1, keepdims=True), 1), 0)
    sums = [np.pad(np.cumsum(values, axis=1), ((0, 0), (1, 0))) for values in (known, centred, np.square(centred))]
    count, mean, square = (values[:, high] - values[:, low] for values in sums)
    count = np.maximum(count, 1)
    mean = mean / count
    deviation = np.sqrt(np.maximum(square / count - np.square(mean), 0.0))
    varies = deviation > 1e-7 * np.abs(centred).max(axis=1, keepdims=True)  # less is rounding
    enhanced = np.divide(centred - mean, deviation, out=np.zeros_like(mean), where=varies)
    return np.where(known, enhanced, S)


def _mean_along(
    S: NDArray[np.float64], known: NDArray[np.bool_], halo: int, length: int, velocity: float
) -> NDArray[np.float64]:
    """The mean along one velocity for every row after the first `halo`, which only precede them."""
    rows, places = len(S) - halo, S.shape[1]
    total = np.zeros((rows, places))
    count = np.zeros((rows, places))
    for k in range(min(length, len(S))):
        offset = int(np.floor(velocity * k + 0.5))
        if offset >= places:
            break
        begun = max(k - halo, 0)
        past = slice(halo + begun - k, len(S) - k)
        total[begun:, offset:] += S[past, : places - offset]
        count[begun:, offset:] += known[past, : places - offset]
    return np.divide(total, count, out=np.full_like(total, -np.inf), where=count > 0)
