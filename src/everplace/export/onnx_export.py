"""A run's encoder as an ONNX network, with the TOML that the method `onnx:` reads.

The network takes float32 images in [0, 1], any number of them, B×C×H×W, and gives the posterior mean of z_p (of all of
z for the plain VAE, the code for the CAE). What the encoder does to its input is part of it; so mean 0 and scale 1
stand in the TOML, and on a robot nothing is left to get wrong but the division by 255. The recipe, the remedies and the
stems that the run was trained on go along in the network's metadata, and are told wherever its scores stand.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from everplace.describe.describer import Describer
from everplace.describe.methods.onnx import OnnxDescriber
from everplace.describe.pretrained.onnx_metadata import write_provenance
from everplace.describe.pretrained.onnx_toml import OnnxToml, onnx_toml_path, onnx_toml_text, read_onnx_toml
from everplace.describe.registry import open_describer
from everplace.describe.runs.trained import TrainedDescriber
from everplace.errors import ConfigError, MachineError, MethodError, MissingExtraError
from everplace.files import readable, whole_file, write_text
from everplace.model.condition_vae import ConditionVAE

__all__ = ["TOLERANCE", "OnnxExport", "export_onnx"]

TOLERANCE = 1e-4
"""Largest difference between a number of the run's descriptor and of the exported network's."""

_TRIALS = 4


@dataclass(frozen=True, slots=True)
class OnnxExport:
    """What was written.

    Attributes:
        onnx: The network.
        toml: What images it wants.
        dimension: Numbers in a descriptor.
        bytes: Size of the network's file.
        difference: Largest difference from the run's own descriptors, measured on a few images.
    """

    onnx: Path
    toml: Path
    dimension: int
    bytes: int
    difference: float


class _PlaceEncoder(nn.Module):
    """Images in [0, 1], (B, C, H, W), to the place descriptor, (B, D)."""

    def __init__(self, model: ConditionVAE) -> None:
        super().__init__()
        self.model = model

    def forward(self, images: Tensor) -> Tensor:
        return self.model.descriptor(images)


def export_onnx(run: str | os.PathLike[str], out: Path) -> OnnxExport:
    """Writes FILE.onnx and FILE.toml, after the network has shown to give the run's own descriptors.

    Args:
        run: A run directory.
        out: The network's file; it ends in `.onnx`.

    Raises:
        CheckpointError: The run directory is damaged.
        MethodError: It is no run directory, or not that of a network.
        ConfigError: Where the TOML has to go lies one of another kind.
        MissingExtraError: The ONNX libraries are not installed.
        MachineError: The exported network gives other descriptors than the run; nothing is written.
        StorageError: Writing failed.
    """
    opened = open_describer(os.fspath(run))
    if opened.checkpoint is None:
        raise MethodError(
            f"{readable(run)} is no run of a network, but {opened.method}; export a vae, c-vae, cp-vae or cae"
        )
    model = opened.checkpoint.model
    config = model.config
    toml = OnnxToml(
        image_size=(config.height, config.width),
        colour="grey" if config.channels == 1 else "rgb",
        mean=(0.0,),
        scale=(1.0,),
        output="descriptor",
    )
    toml_path = onnx_toml_path(out)
    _require_free(toml_path)
    with whole_file(out) as network:
        _write(_PlaceEncoder(model), (config.channels, config.height, config.width), network)
        write_provenance(network, opened.checkpoint.about)
        describer = TrainedDescriber(opened.checkpoint, device="cpu")
        difference = _difference(describer, OnnxDescriber(network, toml))
        if not difference <= TOLERANCE:
            raise MachineError(
                f"the exported network gives other descriptors than {readable(run)}, by up to {difference:.2g}; "
                "nothing was written; update onnx, onnxscript and onnxruntime"
            )
        write_text(toml_path, onnx_toml_text(toml))
    return OnnxExport(out, toml_path, describer.dimension, out.stat().st_size, difference)


def _require_free(path: Path) -> None:
    """Refuses to replace a TOML file that is about something else, such as a run's config.toml."""
    if path.exists():
        try:
            read_onnx_toml(path)
        except ConfigError:
            raise ConfigError(
                f"the network's TOML would replace {readable(path)}, which is of another kind; choose another name"
            ) from None


def _write(encoder: nn.Module, shape: tuple[int, int, int], path: Path) -> None:
    try:
        import onnxruntime  # noqa: F401 - asked for before the work
        import onnxscript  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("everplace export", "export") from error
    images = torch.zeros(2, *shape)
    with _quiet():
        torch.onnx.export(
            encoder,
            (images,),
            str(path),
            dynamo=True,
            input_names=["images"],
            output_names=["descriptor"],
            dynamic_shapes={"images": {0: torch.export.Dim("batch")}},
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


def _difference(describer: Describer, exported: Describer) -> float:
    """The largest difference of a value, over smooth random images and a batch that the export did not see."""
    shape = (_TRIALS, 4, 4, describer.image.channels)
    coarse = list(np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8))
    return float(np.abs(describer.describe(coarse).values - exported.describe(coarse).values).max())
