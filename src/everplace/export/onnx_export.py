"""A method as an ONNX network, with the TOML that the method `onnx:` reads.

The network takes float32 images in [0, 1], any number of them, B×C×H×W, and gives the method's descriptors: of a run
the posterior mean of z_p (of all of z for the plain VAE, the code for the CAE), of an adapted one what it projects to.
What the method does to its input is part of it; so mean 0 and scale 1 stand in the TOML, and on a robot nothing is left
to get wrong but the division by 255. Size, colour, method and what identifies the descriptor go along in the network's
metadata, and so do the recipe, the remedies and the stems that the run was trained on, which are told wherever its
scores stand.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import logging
import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from everplace.describe.describer import Describer
from everplace.describe.methods.onnx import OnnxDescriber
from everplace.describe.pretrained.onnx_metadata import write_metadata
from everplace.describe.pretrained.onnx_toml import OnnxToml, onnx_toml_path, onnx_toml_text, read_onnx_toml
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, MachineError, MethodError, MissingExtraError
from everplace.export.quantisation import quantise
from everplace.files import readable, whole_file, write_text
from everplace.model.inference import on_device
from everplace.model.provenance import SEEN_IMAGES, TRAINED_STEMS

__all__ = ["TOLERANCE", "OnnxExport", "export_onnx"]

TOLERANCE = 1e-4
"""Largest difference between a number of the run's descriptor and of the exported network's."""

_TRIALS = 4
_CALIBRATION_TRIALS = 32


@dataclass(frozen=True, slots=True)
class OnnxExport:
    """What was written.

    Attributes:
        onnx: The network.
        toml: What images it wants.
        dimension: Numbers in a descriptor.
        bytes: Size of the network's file.
        difference: Largest difference of a number from the run's own descriptors, measured on a few images.
        cosine: The least cosine of a descriptor with the run's own, on the same.
    """

    onnx: Path
    toml: Path
    dimension: int
    bytes: int
    difference: float
    cosine: float


def export_onnx(
    run: str | os.PathLike[str] | Describer, out: Path, calibration: Sequence[NDArray[np.uint8]] | None = None
) -> OnnxExport:
    """Writes FILE.onnx and FILE.toml, after the network has shown to give the method's own descriptors.

    Args:
        run: A run directory, or a method that is opened.
        out: The network's file; it ends in `.onnx`.
        calibration: Images of the place where it is to be used, as the method takes them: the network then computes in
            8 bits, in the ranges that its numbers have on these; None: in 32 bits.

    Raises:
        CheckpointError: The run directory is damaged.
        MethodError: There is no such method, it is no network, or it is asked for in 8 bits and none of it was learnt.
        ConfigError: Where the TOML has to go lies one of another kind.
        MissingExtraError: The ONNX libraries are not installed.
        MachineError: The exported network gives other descriptors than the run; nothing is written.
        StorageError: Writing failed.
    """
    with on_device("cpu"):
        describer = run if isinstance(run, Describer) else open_describer(os.fspath(run))
    network = describer.network()
    if network is None or describer.image.size is None:
        name = describer.method if isinstance(run, Describer) else readable(run)
        raise MethodError(
            f"{name} cannot be exported: {describer.method} is no network; export a vae, c-vae, cp-vae or cae, hog16 "
            "or efficientnet, or what was adapted from them"
        )
    _require_libraries()
    height, width = describer.image.size
    colour: Literal["grey", "rgb"] = "grey" if describer.image.grey else "rgb"
    toml = OnnxToml(image_size=(height, width), colour=colour, mean=(0.0,), scale=(1.0,), output="descriptor")
    toml_path = onnx_toml_path(out)
    _require_free(toml_path)
    with whole_file(out) as file:
        _write(network, (describer.image.channels, height, width), file)
        _require_same(describer, OnnxDescriber(file, toml), run)
        if calibration is not None:
            quantise(file, calibration, learnt=[name for name, _ in network.named_parameters()])
        quantised = b"" if calibration is None else file.read_bytes()
        write_metadata(file, _about(describer), _identity(describer, toml, quantised))
        written = OnnxDescriber(file, toml)
        trials = _random_images(describer) if calibration is None else calibration[:_CALIBRATION_TRIALS]
        difference, cosine = _compared(describer, written, trials)
        write_text(toml_path, onnx_toml_text(toml))
    return OnnxExport(out, toml_path, describer.dimension, out.stat().st_size, difference, cosine)


def _about(describer: Describer) -> dict[str, Any]:
    """What is known of the making."""
    if describer.checkpoint is not None:
        return describer.checkpoint.about
    seen = {TRAINED_STEMS: sorted(describer.seen_stems), SEEN_IMAGES: sorted(describer.seen_images)}
    return {**describer.settings(), **seen}


def _identity(describer: Describer, toml: OnnxToml, quantised: bytes) -> dict[str, str]:
    """What a program without everplace has to know; descriptors of equal hashes can be compared.

    Args:
        describer: What was exported.
        toml: What images it wants.
        quantised: The network in 8 bits, whose numbers depend on the images it was calibrated on; empty: in 32 bits.
    """
    settings = json.dumps([describer.method, dict(describer.settings())], sort_keys=True).encode() + quantised
    return {
        "image_size": " ".join(map(str, toml.image_size)),
        "colour": toml.colour,
        "method": describer.method,
        "hash": hashlib.sha256(settings).hexdigest()[:16],
        "numbers": "int8" if quantised else "float32",
    }


def _require_free(path: Path) -> None:
    """Refuses to replace a TOML file that is about something else, such as a run's config.toml."""
    if path.exists():
        try:
            read_onnx_toml(path)
        except ConfigError:
            raise ConfigError(
                f"the network's TOML would replace {readable(path)}, which is of another kind; choose another name"
            ) from None


def _require_libraries() -> None:
    try:
        import onnxruntime  # noqa: F401 - asked for before the work
        import onnxscript  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("everplace export", "export") from error


def _write(network: nn.Module, shape: tuple[int, int, int], path: Path) -> None:
    images = torch.zeros(2, *shape)
    with _quiet():
        torch.onnx.export(
            network.eval(),
            (images,),
            str(path),
            dynamo=True,
            input_names=["images"],
            output_names=["descriptor"],
            dynamic_shapes=({0: torch.export.Dim("batch")},),
            external_data=False,
            verbose=False,
        )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """The exporter talks about its own workings, also on stdout, where results belong."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)


def _require_same(describer: Describer, exported: Describer, run: str | os.PathLike[str] | Describer) -> None:
    difference, _ = _compared(describer, exported, _random_images(describer))
    if not difference <= TOLERANCE:
        name = run.method if isinstance(run, Describer) else readable(run)
        raise MachineError(
            f"the exported network gives other descriptors than {name}, by up to {difference:.2g}; "
            "nothing was written; update onnx, onnxscript and onnxruntime"
        )


def _random_images(describer: Describer) -> list[NDArray[np.uint8]]:
    """Smooth random images, in a batch that the export did not see."""
    shape = (_TRIALS, 4, 4, describer.image.channels)
    return list(np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8))


def _compared(describer: Describer, exported: Describer, images: Sequence[NDArray[np.uint8]]) -> tuple[float, float]:
    """The largest difference of a value, and the least cosine."""
    ours, theirs = describer.describe(list(images)).values, exported.describe(list(images)).values
    lengths = np.linalg.norm(ours, axis=1) * np.linalg.norm(theirs, axis=1)
    cosines = (ours * theirs).sum(axis=1) / np.maximum(lengths, np.finfo(np.float32).tiny)
    return float(np.abs(ours - theirs).max()), float(cosines.min())
