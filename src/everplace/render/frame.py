"""One frame: from a pose in the world to an image under a condition."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError
from everplace.render.camera import Camera
from everplace.render.ground import paint_ground
from everplace.render.lens import add_rain, expose
from everplace.render.light import add_haze, add_reflections, cast_shadows, light_night
from everplace.render.look import look_of_drive
from everplace.render.painter import Layers, draw_scene, visible_faces, visible_plants
from everplace.render.render_config import CONDITIONS
from everplace.render.road import Column
from everplace.render.sky import paint_sky
from everplace.render.sprites import Nursery
from everplace.render.terrain import FAR, view_terrain
from everplace.render.world import World

__all__ = ["Drive", "Pose", "camera_at", "open_drive"]

Pose = tuple[float, float, float]
"""x and y in metres, heading in radians counter-clockwise from the x axis."""

_EYE = 1.9
_DRAWN_PIXELS = 96 * 192


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive through a world under one condition.

    Attributes:
        world: The world.
        condition: Name of the condition.
        nursery: Has the condition's look on this drive, and the pictures of the plants under it.
    """

    world: World
    condition: str
    nursery: Nursery

    def frame(self, pose: Pose, size: tuple[int, int]) -> NDArray[np.uint8]:
        """Takes the picture at a pose.

        Args:
            pose: Where the camera is and looks.
            size: Height and width in pixels.

        Returns:
            H × W × 3, uint8, RGB; always the same for the same arguments.
        """
        height, width = size
        # Small images are drawn larger, so that fine things do not flicker.
        scale = float(np.clip(np.sqrt(_DRAWN_PIXELS / (height * width)), 1, 8))
        drawn = round(height * scale), round(width * scale)
        light = self.layers(camera_at(self.world, pose, drawn)).light
        # The noise follows from the pose in steps of 0.1 mm and 0.1 mrad.
        digits = [round(value * 1e4) % 2**32 for value in pose]
        rng = np.random.default_rng([self.world.seed, 2, CONDITIONS.index(self.condition), *digits])
        if self.nursery.look.wet:
            light = add_rain(light, rng)
        if drawn != size:
            light = np.asarray(cv2.resize(light, (width, height), interpolation=cv2.INTER_AREA))
        return expose(light, self.nursery.look, rng)

    def layers(self, camera: Camera) -> Layers:
        """Draws the scene in front of a camera."""
        world, look = self.world, self.nursery.look
        land = view_terrain(world.terrain, camera)
        shadow = cast_shadows(world, camera, look)
        ground, gloss = paint_ground(world, land, look, shadow[land.top :], camera.focal)
        image = np.empty((camera.height, camera.width, 3), np.float32)
        rows = min(camera.height, land.top + int(np.argmax(land.seen, axis=0).max()) + 1)
        image[:rows] = paint_sky(camera, look, world.grain, rows)
        cv2.copyTo(ground, land.seen.view(np.uint8), image[land.top :])
        depth = np.full((camera.height, camera.width), FAR, np.float32)
        depth[land.top :] = land.depth
        plants, faces = visible_plants(world.plants, camera), visible_faces(world.mesh, camera)
        scene = draw_scene(Layers(image, depth), camera, plants, faces, self.nursery)
        # Soft edges reach a pixel into the sky: they belong to the object, or they would shine at night.
        nearest = cv2.erode(scene.depth, np.ones((3, 3), np.uint8))
        reach = np.where(scene.depth < FAR, scene.depth, nearest).astype(np.float32)
        light = light_night(scene.light, reach, camera, faces) if look.dark else scene.light
        add_haze(light, reach, look)
        mirror = np.zeros_like(depth)
        mirror[land.top :] = np.where(land.seen, gloss, 0)
        mirror[scene.depth != depth] = 0
        add_reflections(light, mirror, camera, look)
        return Layers(light, scene.depth)


def open_drive(world: World, condition: str) -> Drive:
    """Prepares a drive: its sun, its clouds and its plants.

    Raises:
        ConfigError: There is no such condition.
    """
    if condition not in CONDITIONS:
        raise ConfigError(f"cannot render the condition {condition!r}: choose from {', '.join(CONDITIONS)}")
    look = look_of_drive(condition, np.random.default_rng([world.seed, 1, CONDITIONS.index(condition)]))
    return Drive(world, condition, Nursery(look))


def camera_at(world: World, pose: Pose, size: tuple[int, int]) -> Camera:
    """Puts the camera on the road at a pose; it follows the road's slope."""
    x, y, heading = pose
    here, ahead = (world.road.at(position, Column.HEIGHT) for position in (x, x + 14.0))
    height, width = size
    return Camera(x, y, here + _EYE, heading, 0.8 * (ahead - here) / 14.0, height, width)
