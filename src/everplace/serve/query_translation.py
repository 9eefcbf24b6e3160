"""A query shown in another condition of the map, where the map's method has a decoder (C-VAE, CP-VAE)."""

from __future__ import annotations

import threading

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.images.decoding import ImageSpec, convert_image, decode_encoded
from everplace.mapping.route_map import Map
from everplace.mapping.thumbnails import Thumbnails
from everplace.route.selection import spread
from everplace.serve.refusal import RefusedError

__all__ = ["QueryTranslation"]

_AVERAGED = 64
"""Frames of a condition whose z_c is averaged."""


class QueryTranslation:
    """{z_p of the query, mean z_c of a condition}, decoded."""

    def __init__(self, map_: Map, thumbnails: Thumbnails) -> None:
        """Looks whether the map's method can."""
        from everplace.model.model_config import LABELLED_KINDS

        model = map_.describer().latent_model
        self._model = model if model is not None and model.config.kind in LABELLED_KINDS else None
        self._thumbnails = thumbnails
        condition = {drive["name"]: drive["condition"] for drive in map_.document["drives"]}
        self._of_frames = np.array([condition[name] for name in map_.frames()["drive"].to_pylist()])
        self._means: dict[str, NDArray[np.float32]] = {}
        self._lock = threading.Lock()

    @property
    def possible(self) -> bool:
        """Whether the map's method decodes."""
        return self._model is not None

    def png(self, image: NDArray[np.uint8], condition: str) -> bytes:
        """The query in a condition, as a PNG file of the size that the model sees.

        Args:
            image: H×W×3 RGB uint8.
            condition: Of the map.

        Raises:
            RefusedError: The method cannot decode, or the map does not know the condition.
        """
        if self._model is None:
            raise RefusedError(404, "the method of this map cannot show a frame in another condition; a C-VAE can")
        if condition not in self._of_frames:
            raise RefusedError(404, "the map does not know this condition; GET /map names those that it knows")
        from everplace.audit.leakage import encode_frames
        from everplace.experiments.translations import decode_latents

        z_p = encode_frames(self._model, self._as_seen(image)[None]).z_p
        decoded = decode_latents(self._model, z_p, self._mean(condition)[None])[0]
        channels = decoded if decoded.shape[2] == 1 else decoded[:, :, ::-1]
        return cv2.imencode(".png", channels)[1].tobytes()

    def _mean(self, condition: str) -> NDArray[np.float32]:
        """The mean z_c of frames of a condition, which the map has as thumbnails."""
        with self._lock:
            if condition not in self._means:
                from everplace.audit.leakage import encode_frames

                rows = np.flatnonzero(self._of_frames == condition)
                rows = rows[spread(len(rows), min(_AVERAGED, len(rows)))]
                frames = [
                    decode_encoded("the thumbnail", self._thumbnails.read(row), ImageSpec()) for row in rows.tolist()
                ]
                assert self._model is not None
                z_c = encode_frames(self._model, np.stack([self._as_seen(frame) for frame in frames])).z_c
                self._means[condition] = z_c.mean(axis=0)
            return self._means[condition]

    def _as_seen(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        assert self._model is not None
        config = self._model.config
        return convert_image(image, ImageSpec((config.height, config.width), grey=config.channels == 1))
