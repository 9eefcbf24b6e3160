"""The sky of a drive: gradient, sun or moon, stars, and clouds that drift while the vehicle moves."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.render.camera import Camera
from everplace.render.look import Look
from everplace.render.noise import TILE, ramp, sample

__all__ = ["paint_sky"]


def paint_sky(camera: Camera, look: Look, grain: NDArray[np.float32], rows: int) -> NDArray[np.float32]:
    """Paints the sky of the upper image rows.

    Args:
        camera: Where it looks.
        look: The appearance.
        grain: Noise tile for the clouds.
        rows: Number of image rows from the top.

    Returns:
        rows × W × 3, RGB in 0 to 255.
    """
    # Clouds and gradients are smooth: half the resolution is enough.
    u, v = camera.column_slopes()[::2], camera.row_slopes()[:rows:2]
    up = np.repeat(np.maximum(v, 0.0)[:, None], len(u), axis=1).astype(np.float32)
    (fx, fy), (rx, ry) = camera.forward, camera.right
    norm = np.sqrt(1 + u[None, :] ** 2 + v[:, None] ** 2)
    height = ramp(up / norm, -0.05, 0.75)[..., None]
    zenith, horizon = np.array(look.zenith, np.float32), np.array(look.horizon, np.float32)
    sky = horizon + (zenith - horizon) * np.sqrt(height)

    dx, dy = (fx + u * rx)[None, :], (fy + u * ry)[None, :]
    sun = np.array([*look.sunward, np.tan(look.sun_elevation)], np.float32)
    sun /= np.linalg.norm(sun)
    cosine = np.clip((dx * sun[0] + dy * sun[1] + v[:, None] * sun[2]) / norm, 0, 1)
    if look.sun:
        glow = look.sun * (0.5 * cosine**10 + 0.6 * cosine**120)
        sky += glow[..., None] * np.array((110, 95, 60), np.float32)
    if look.dark:  # the moon stands where the sun would
        moon = ramp(cosine, 0.99955, 0.99975) * 190 + 14 * cosine**60
        sky += moon[..., None]

    drift = 0.12 * camera.x  # texels of the cloud pattern
    reach = 26 / (up + np.float32(0.09))
    a, b = (
        np.asarray(axis * reach + np.float32(start * TILE + drift), np.float32)
        for axis, start in zip((dx, dy), look.cloud_offset, strict=True)
    )
    thick = sample(grain, a, b, 1.0) + 0.35 * sample(grain, b, a, 0.37)
    edge = 0.55 - 1.1 * look.clouds
    # Haze swallows the clouds near the horizon, and the more of them the thicker it is.
    cover = ramp(thick, edge, edge + 0.4) * ramp(up, 0.0, 0.05 + min(0.3, 80 / look.haze))
    depth = ramp(thick, edge + 0.15, edge + 0.85)[..., None]
    bright, dark = np.array(look.cloud_bright, np.float32), np.array(look.cloud_dark, np.float32)
    sky += (bright + (dark - bright) * depth - sky) * cover[..., None]
    full = np.asarray(cv2.resize(sky, (camera.width, rows), interpolation=cv2.INTER_LINEAR), np.float32)
    if look.dark:
        _stars(full, camera, look)
    return full


def _stars(sky: NDArray[np.float32], camera: Camera, look: Look) -> None:
    """Adds the fixed stars, in place."""
    rng = np.random.default_rng(7)
    azimuth, up = rng.uniform(-np.pi, np.pi, 900), rng.uniform(0.02, 1.2, 900)
    brightness = rng.gamma(1.0, 26.0, 900) * (1 - 0.6 * look.clouds)
    angle = camera.heading - azimuth
    ahead = np.cos(angle) > 0.2
    u, v = np.tan(angle[ahead]), up[ahead] / np.cos(angle[ahead])
    column = (camera.width / 2 + camera.focal * u).astype(int)
    row = (camera.centre_row - camera.focal * v).astype(int)
    inside = (column >= 0) & (column < sky.shape[1]) & (row >= 0) & (row < sky.shape[0])
    sky[row[inside], column[inside]] += brightness[ahead][inside, None]
