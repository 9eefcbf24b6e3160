"""What lens, weather and sensor do to the light that arrives: vignette, rain, drops, exposure, noise."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.render.look import Look

__all__ = ["add_rain", "expose"]

Image = NDArray[np.float32]


def add_rain(image: Image, rng: np.random.Generator) -> Image:
    """Adds falling streaks, and drops on the glass that blur and turn over what lies behind them."""
    height, width = image.shape[:2]
    streaks = np.zeros((height, width), np.float32)
    slant = float(rng.normal(0, 0.08))
    for _ in range(int(rng.integers(70, 110))):
        x, y = rng.uniform(-0.1, 1.1) * width, rng.uniform(-0.1, 1) * height
        length = rng.uniform(0.02, 0.09) * height
        end = (int((x + slant * length) * 16), int((y + length) * 16))
        strength = float(rng.uniform(0.06, 0.22))
        cv2.line(streaks, (int(x * 16), int(y * 16)), end, strength, max(1, width // 400), cv2.LINE_8, 4)
    falling = cv2.blur(streaks, (1, max(1, height // 60)))
    wet = image + (205 - image) * falling[..., None]
    soft = np.asarray(cv2.blur(wet, (max(1, width // 24),) * 2), np.float32)
    for _ in range(int(rng.integers(10, 22))):
        radius = float(rng.gamma(2.5, 0.006)) * width + 1
        x, y = int(rng.uniform(0, width)), int(rng.uniform(0, height))
        _drop(wet, soft, (x, y), radius)
    return wet


def _drop(wet: Image, soft: Image, centre: tuple[int, int], radius: float) -> None:
    """One drop: a small upside-down picture of its surroundings, dark at the top and bright at the bottom."""
    height, width = wet.shape[:2]
    (x, y), reach = centre, int(radius) + 1
    x0, x1, y0, y1 = max(0, x - reach), min(width, x + reach), max(0, y - reach), min(height, y + reach)
    rows, columns = np.mgrid[y0:y1, x0:x1]
    distance = np.hypot(rows - y, (columns - x) * 1.15) / radius
    share = np.clip((1 - distance) * radius / 2, 0, 1)[..., None] * 0.85
    source_rows = np.clip(2 * y - rows + (y - rows) * 4, 0, height - 1)
    inside = soft[source_rows, np.clip(columns + (x - columns) * 3, 0, width - 1)]
    shaded = inside * (1 - 0.22 * ((y - rows) / radius)[..., None]) * (1.05 - 0.3 * distance[..., None] ** 4)
    wet[y0:y1, x0:x1] += (shaded - wet[y0:y1, x0:x1]) * share.astype(np.float32)


def expose(image: Image, look: Look, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Takes the picture: white balance, automatic exposure, vignette, a soft shoulder and noise.

    Args:
        image: H × W × 3, RGB light of 0 to 255 and above.
        look: The appearance of the drive.
        rng: Source of the sensor's noise.

    Returns:
        H × W × 3, uint8, RGB.
    """
    height, width = image.shape[:2]
    gain = np.array((look.warmth, 1.0, 1 / look.warmth), np.float32)
    grey, power, low, high = (46, 0.4, 0.8, 1.6) if look.dark else (118, 0.35, 0.75, 1.35)
    automatic = float(np.clip((grey / max(float(image.mean()), 1.0)) ** power, low, high))
    rows = (np.arange(height, dtype=np.float32)[:, None] + 0.5) / height - 0.5
    columns = (np.arange(width, dtype=np.float32)[None, :] + 0.5) / width - 0.5
    vignette = 1 - np.float32(0.5) * (rows**2 + columns**2) ** 1.5
    light = image * (gain * np.float32(look.exposure * automatic)) * vignette[..., None] / 255
    # Linear up to 0.75, then a shoulder that reaches 1 for light twice as bright as white.
    bright = np.maximum(light - 0.75, 0)
    light = np.minimum(light, 0.75) + 0.25 * (1 - np.exp(-bright / 0.3))
    noisy = light * 255 + rng.standard_normal(image.shape, np.float32) * np.float32(look.noise)
    return np.asarray(np.clip(noisy + 0.5, 0, 255), np.uint8)
