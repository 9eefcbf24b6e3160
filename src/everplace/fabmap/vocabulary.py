"""Visual words: SIFT features of an image, and the nearest centre of a vocabulary for each.

Lowe, "Distinctive Image Features from Scale-Invariant Keypoints", IJCV 60, 2004; Sivic and Zisserman, "Video Google: A
Text Retrieval Approach to Object Matching in Videos", ICCV 2003. FAB-MAP used SURF, which is patented and absent from
OpenCV's wheels, so this is "FAB-MAP (SIFT)".
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["FEATURE_DIMENSIONS", "sift_features", "words_of"]

FEATURE_DIMENSIONS = 128
_MOST_ENLARGED = 8.0


def sift_features(image: NDArray[np.uint8], keypoints: int, smallest_side: int) -> NDArray[np.uint8]:
    """SIFT descriptors of a grey image at OpenCV's default thresholds.

    OpenCV finds next to nothing in images of few pixels: one whose short side is below `smallest_side` is enlarged to
    it first (cubic, aspect kept, at most eightfold).

    Args:
        image: H×W.
        keypoints: The strongest that are kept; 0: all.
        smallest_side: Pixels; 0: never enlarge.

    Returns:
        K×128 (OpenCV rounds them to 0 to 255); K = 0 for an image without structure.
    """
    short = min(image.shape)
    if short < smallest_side:
        scale = min(smallest_side / short, _MOST_ENLARGED)
        size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), np.uint8)
    _, found = cv2.SIFT.create(nfeatures=keypoints).detectAndCompute(image, None)
    if found is None or len(found) == 0:
        return np.zeros((0, FEATURE_DIMENSIONS), np.uint8)
    features: NDArray[np.uint8] = np.asarray(found)[: keypoints or None].astype(np.uint8)
    return features


def words_of(features: NDArray[np.uint8], vocabulary: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which words an image holds: for each feature the nearest centre, whatever its distance.

    Args:
        features: K×128.
        vocabulary: W×128 centres.

    Returns:
        (W,), True where a word is present at least once.
    """
    present = np.zeros(len(vocabulary), np.bool_)
    if len(features):
        # |f - c|² without |f|², which is the same for all centres.
        distance = np.einsum("wd,wd->w", vocabulary, vocabulary) - 2.0 * (features.astype(np.float32) @ vocabulary.T)
        present[distance.argmin(axis=1)] = True
    return present
