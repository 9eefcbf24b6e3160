"""`NAME.toml` beside `NAME.onnx`: what the network's file cannot say about the images it wants.

    image_size = [224, 224]             # height, width
    colour = "rgb"                      # rgb, bgr or grey
    mean = [0.485, 0.456, 0.406]        # input = (pixel / 255 - mean) / scale; one number, or one a channel
    scale = [0.229, 0.224, 0.225]

Optional:

    layout = "nchw"                     # or nhwc
    output = "descriptor"               # needed where the network has several outputs
    l2 = false                          # divide each descriptor by its length

`mean` and `scale` are left out where the network takes the pixels themselves, as uint8.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

import tomli_w
from pydantic import Field, model_validator

from everplace.errors import ConfigError
from everplace.files import readable
from everplace.settings import Settings, read_settings

__all__ = ["OnnxToml", "onnx_toml_path", "onnx_toml_text", "read_onnx_toml"]

_Number = Annotated[float, Field(allow_inf_nan=False)]
_Channels = Annotated[tuple[_Number, ...], Field(min_length=1, max_length=3, strict=False)]
_Side = Annotated[int, Field(gt=0)]


class OnnxToml(Settings, strict=True):
    """What the TOML file says."""

    image_size: Annotated[tuple[_Side, _Side], Field(strict=False)]
    """(H, W) in pixels."""
    colour: Literal["rgb", "bgr", "grey"]
    """Order of the channels, or one grey channel."""
    mean: _Channels | None = None
    """Subtracted from values in [0, 1]; one number, or one a channel in the order of `colour`."""
    scale: _Channels | None = None
    """What the rest is divided by, the standard deviation; not 0."""
    layout: Literal["nchw", "nhwc"] = "nchw"
    """Order of the axes of the input."""
    output: Annotated[str, Field(min_length=1)] | None = None
    """Name of the output that is the descriptor; None: the only one."""
    l2: bool = False
    """Divide each descriptor by its length."""

    @model_validator(mode="after")
    def _check(self) -> OnnxToml:
        if (self.mean is None) != (self.scale is None):
            raise ValueError("mean and scale belong together; give both, or none for a network that takes uint8 pixels")
        for name, values in (("mean", self.mean), ("scale", self.scale)):
            if values is not None and len(values) not in {1, self.channels}:
                raise ValueError(f"{name} has {len(values)} numbers for {self.channels} channels")
        if self.scale is not None and 0 in self.scale:
            raise ValueError("scale may not be 0")
        return self

    @property
    def channels(self) -> int:
        """1 for grey, else 3."""
        return 1 if self.colour == "grey" else 3


def onnx_toml_path(network: Path) -> Path:
    """Returns where the TOML of a network lies: `NAME.toml` beside `NAME.onnx`."""
    return network.with_suffix(".toml")


def read_onnx_toml(path: Path) -> OnnxToml:
    """Reads the TOML of a network.

    Raises:
        ConfigError: It is missing, cannot be read, is no TOML, or holds an unknown key or a value that cannot be.
    """
    if not os.path.lexists(path):
        raise ConfigError(
            f"{readable(path)} is missing; write image_size, colour, mean and scale of the network into it"
        )
    return read_settings(path, OnnxToml)


def onnx_toml_text(toml: OnnxToml) -> str:
    """Returns the content of the file."""
    return tomli_w.dumps(toml.model_dump(mode="json", exclude_none=True))
