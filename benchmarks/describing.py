"""Describing a directory of JPEGs end to end, against the sum of decoding alone and the network alone."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from benchmarks.ratio import Ratio
from everplace.describe.runs.trained import TrainedDescriber
from everplace.images.decoding import decode_images
from everplace.model.checkpoint import Checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.folder import open_traverse

ROUNDS = 5
BATCH = 32


def measure(scratch: Path) -> list[Ratio]:
    config = {"places": 160, "size": (480, 640), "conditions": ("summer",), "format": "jpg"}
    render_route(scratch / "route", render_config(config))
    traverse = open_traverse(scratch / "route" / "summer")
    describer = TrainedDescriber(Checkpoint(ConditionVAE(ModelConfig(kind="c-vae", conditions=("a", "b"))).eval()))
    images = np.stack(list(decode_images(traverse.paths, describer.image)))
    describer.describe(traverse, batch=BATCH)
    decoding, network, whole = [], [], []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for _image in decode_images(traverse.paths, describer.image):
            pass
        decoding.append(time.perf_counter() - start)
        start = time.perf_counter()
        for first in range(0, len(images), BATCH):
            describer.describe_batch(images[first : first + BATCH])
        network.append(time.perf_counter() - start)
        start = time.perf_counter()
        describer.describe(traverse, batch=BATCH)
        whole.append(time.perf_counter() - start)
    bound = float(np.median(decoding)) + float(np.median(network))
    taken = float(np.median(whole))
    return [
        Ratio(
            "describing JPEGs of 640×480, Table 1",
            f"{len(images) / taken:.0f} images/s end to end",
            f"{len(images) / bound:.0f} images/s, decoding {1000 * np.median(decoding) / len(images):.1f} ms + network "
            f"{1000 * np.median(network) / len(images):.1f} ms",
            bound / taken,
            at_least=0.9,
        )
    ]
