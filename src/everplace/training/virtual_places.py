"""Virtual places: pairs of frames of one place, changed alike, so that they show a place that nobody drove past.

A route has few places to learn from. Mirroring, cutting out, or joining the left of one place to the right of another
gives new ones, in both conditions at once. What it shows has no place label any more.
"""

from __future__ import annotations

from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

__all__ = ["VirtualPlaces", "virtual_pairs"]

_Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
_NARROWEST = 0.15
"""Share of the width that either part of two joined places has at least."""


class VirtualPlaces(BaseModel):
    """How much the places of a batch are changed; 0 leaves them as they are.

    Attributes:
        crop: Largest fraction of height and width cut away; what is left is enlarged to the whole.
        mirror: Share of the places that are seen in a mirror.
        join: Share of the places whose one side comes from the next place of the batch (CutMix, Yun et al. 2019).
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    crop: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] = 0.0
    mirror: _Share = 0.0
    join: _Share = 0.0


def virtual_pairs(pairs: NDArray[np.uint8], virtual: VirtualPlaces, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Changes the two frames of each place alike.

    Args:
        pairs: P×2×H×W×C uint8, the two frames of each of P places; left as it is.
        virtual: How much may change.
        rng: Random numbers; six a place are always drawn.

    Returns:
        P×2×H×W×C uint8.
    """
    places, _, height, width, _ = pairs.shape
    joined, seam, mirrored, cut, top, left = rng.random((6, places))
    result = pairs.copy()
    others = np.roll(pairs, -1, axis=0)
    for place in range(places):
        if joined[place] < virtual.join:
            column = round(width * (_NARROWEST + (1.0 - 2.0 * _NARROWEST) * seam[place]))
            result[place, :, :, column:] = others[place, :, :, column:]
        mirror = mirrored[place] < virtual.mirror
        if not (virtual.crop or mirror):
            continue
        kept = 1.0 - virtual.crop * cut[place]
        # Maps each pixel of the result to one of the source; the half pixels keep centres centred.
        x = (1.0 - kept) * left[place] * width + 0.5 * kept - 0.5
        y = (1.0 - kept) * top[place] * height + 0.5 * kept - 0.5
        across = [-kept, 0.0, width - 1 - x] if mirror else [kept, 0.0, x]
        for frame in result[place]:
            warped = cv2.warpAffine(
                frame,
                np.array([across, [0.0, kept, y]]),
                (width, height),
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_REFLECT_101,
            )
            frame[...] = np.asarray(warped, dtype=np.uint8).reshape(frame.shape)
    return result
