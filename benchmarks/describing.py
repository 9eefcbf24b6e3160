"""Describing: files end to end against decoding and network alone; one frame at a time against OpenCV's HOG.

One frame is an array of 224×224 in colour, its descriptor comes out: resizing and grey count, decoding does not. The
weights are random where only time is measured.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import nn

from benchmarks.ratio import Ratio
from benchmarks.turns import by_turns
from everplace.adaptation.oriented_gradients import OrientedGradients
from everplace.describe.describer import Describer
from everplace.describe.methods.alexnet import alexnet_features
from everplace.describe.methods.hog import HOG
from everplace.describe.methods.vgg19 import vgg19_features
from everplace.describe.registry import open_describer
from everplace.describe.runs.trained import TrainedDescriber
from everplace.images.decoding import convert_image, decode_images
from everplace.model.checkpoint import Checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.model.pixels import to_input
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.folder import open_traverse
from everplace.route.traverse import Traverse

ROUNDS = 5
ONE_FRAME_ROUNDS = 11
WARM = 4
BATCH = 32
PLACES = 96


def measure(scratch: Path) -> list[Ratio]:
    return [*_one_frame(), _files(scratch), *_decoding_bound(scratch)]


def _one_frame() -> list[Ratio]:
    """`best` and its oriented gradients at batch 1 against HOG, and how much longer the large networks take."""
    frame = np.random.default_rng(0).integers(0, 256, (224, 224, 3), dtype=np.uint8)
    hog, gradients = HOG(), OrientedGradients(224, 224)
    best = _describer(kind="cp-vae", places=100, fully_connected=False, oriented_gradients=True)
    table_1 = _describer(kind="c-vae")
    alexnet, vgg19 = alexnet_features()[:8].eval(), vgg19_features()[:28].eval()

    def by(network: nn.Module) -> object:
        with torch.inference_mode():
            return network(to_input(torch.from_numpy(frame[None])))

    work: dict[str, Callable[[], object]] = {
        "OpenCV's HOG": lambda: hog.describe_batch(convert_image(frame, hog.image)[None]),
        "best": lambda: best.describe_batch(frame[None]),
        "oriented gradients": lambda: by(gradients),
        "Table 1": lambda: table_1.describe_batch(frame[None]),
        "AlexNet conv3": lambda: by(alexnet),
        "VGG19 pool4": lambda: by(vgg19),
    }
    seconds = by_turns(work, ONE_FRAME_ROUNDS, WARM, WARM)
    took = {name: 1000 * of for name, of in seconds.items()}

    def row(what: str, against: str, at_least: float | None = None, at_most: float | None = None) -> Ratio:
        figures = (f"{what} {took[what]:.2f} ms", f"{against} {took[against]:.2f} ms", took[what] / took[against])
        return Ratio(f"one frame of 224×224: {what}", *figures, at_least, at_most)

    return [
        row("best", "OpenCV's HOG", at_most=2.0),
        row("oriented gradients", "OpenCV's HOG", at_most=2.0),
        row("AlexNet conv3", "best", at_least=18.0),
        row("VGG19 pool4", "best", at_least=600.0),
        row("Table 1", "best", at_least=1.0),
    ]


def _describer(**config: object) -> TrainedDescriber:
    model = ConditionVAE(ModelConfig.model_validate({"conditions": ("a", "b"), **config}))
    return TrainedDescriber(Checkpoint(model.eval()), device="cpu")


def _files(scratch: Path) -> Ratio:
    config = {"places": 160, "size": (480, 640), "conditions": ("summer",), "format": "jpg"}
    render_route(scratch / "route", render_config(config))
    traverse = open_traverse(scratch / "route" / "summer")
    describer = _describer(kind="c-vae")
    images = np.stack(list(decode_images(traverse.paths, describer.image)))

    def network() -> None:
        for first in range(0, len(images), BATCH):
            describer.describe_batch(images[first : first + BATCH])

    work: dict[str, Callable[[], object]] = {
        "decoding": partial(_decode, traverse, describer),
        "network": network,
        "both": partial(describer.describe, traverse, batch=BATCH),
    }
    decoding, alone, taken = by_turns(work, ROUNDS).values()
    return Ratio(
        "describing JPEGs of 640×480, Table 1",
        f"{len(images) / taken:.0f} images/s end to end",
        f"{len(images) / (decoding + alone):.0f} images/s, decoding {1000 * decoding / len(images):.1f} ms + network "
        f"{1000 * alone / len(images):.1f} ms",
        (decoding + alone) / taken,
        at_least=0.9,
    )


def _decoding_bound(scratch: Path) -> list[Ratio]:
    """Light methods take little beside decoding JPEGs of a camera's size to that of the method."""
    rows = []
    best = _describer(kind="cp-vae", places=100, fully_connected=False, oriented_gradients=True)
    config = {"places": PLACES, "size": (480, 640), "conditions": ("summer",), "format": "jpg"}
    render_route(scratch / "camera", render_config(config))
    camera = open_traverse(scratch / "camera" / "summer")
    for height, width in ((480, 640), (1080, 1920)):
        drive = scratch / f"drive{height}"
        drive.mkdir()
        for path in camera.paths:
            Image.open(path).resize((width, height)).save(drive / path.name, quality=90)
        traverse = open_traverse(drive)
        for name, describer in (("hog16", open_describer("hog16")), ("best", best)):
            kinds: dict[str, Callable[[], object]] = {
                "decoding": partial(_decode, traverse, describer),
                "both": partial(describer.describe, traverse),
            }
            alone, taken = by_turns(kinds, ROUNDS).values()
            rows.append(
                Ratio(
                    f"describing JPEGs of {width}×{height}, {name}",
                    f"{PLACES / taken:.0f} images/s end to end",
                    f"{PLACES / alone:.0f} images/s decoded",
                    alone / taken,
                    at_least=0.9,
                )
            )
    return rows


def _decode(traverse: Traverse, describer: Describer) -> None:
    for _image in decode_images(traverse.paths, describer.image):
        pass
