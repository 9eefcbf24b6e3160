"""Any descriptor network in an ONNX file: `onnx:NAME.onnx`, with `NAME.toml` beside it.

The TOML says which images the network wants (`everplace.describe.pretrained.onnx_toml`); the network has one input, of
a fixed or free number of images, and gives B×D numbers, 4 D bytes a descriptor, compared by cosine. `everplace export`
writes such a pair for a trained model, and says in the network how it was trained. ONNX (https://onnx.ai) is a file of
operators and numbers: opening one runs no code of its maker. It runs in onnxruntime, without torch.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.describe.pretrained.network_input import Normalisation, network_input
from everplace.describe.pretrained.onnx_metadata import read_provenance
from everplace.describe.pretrained.onnx_toml import OnnxToml, onnx_toml_path, read_onnx_toml
from everplace.describe.pretrained.trial import first_line, measured_dimension
from everplace.downloads import sha256_of
from everplace.errors import ConfigError, MethodError, MissingExtraError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer
from everplace.images.decoding import ImageSpec
from everplace.model.provenance import images_seen, plain_values, stems_seen
from everplace.threads import usable_cores

if TYPE_CHECKING:
    import onnxruntime

__all__ = ["OnnxDescriber", "open_method"]

NOTES = (
    (
        "onnx:FILE.onnx",
        "any descriptor network in an ONNX file, such as everplace export writes; of MixVPR, which torch.hub cannot "
        "load, export one yourself",
        "pip install 'everplace[onnx]', and FILE.toml beside the network",
        None,
    ),
)

_INPUT_TYPES: dict[str, type[np.generic]] = {
    "tensor(uint8)": np.uint8,
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
}
_OUTPUT_TYPES = {"tensor(float)", "tensor(float16)", "tensor(double)"}
_FATAL_ONLY = 4  # what fails is raised, and said once


class OnnxDescriber(Describer):
    """An ONNX network, opened as its TOML says."""

    batch = 8

    def __init__(self, path: Path, toml: OnnxToml) -> None:
        self.method = f"onnx:{path.stem}"
        self.image = ImageSpec(toml.image_size, grey=toml.colour == "grey")
        self._toml = toml
        self._weights = _weights_hash(path)
        self._session = _session(path)
        self._provenance = read_provenance(path, self._session.get_modelmeta().custom_metadata_map)
        self.seen_stems = stems_seen(self._provenance)
        self.seen_images = images_seen(self._provenance)
        self._input = _checked_input(path, self._session, toml)
        self._output = _output_name(path, self._session, toml)
        self._fixed_batch = self._input.shape[0] if isinstance(self._input.shape[0], int) else None
        self.batch = self._fixed_batch or self.batch
        self.dimension = measured_dimension(
            self, readable(path), f"correct image_size or layout in {readable(onnx_toml_path(path))}"
        )

    def settings(self) -> Settings:
        """Returns how an exported run was trained, what the TOML says and the hash of the network's file."""
        told = self._toml.model_dump(mode="json", exclude_none=True)
        flat = {key: " ".join(map(str, value)) if isinstance(value, list) else value for key, value in told.items()}
        return {**plain_values(self._provenance), **flat, "weights": self._weights[:16]}

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes B×H×W×C images by B×D numbers.

        Raises:
            MethodError: The network returned something else.
        """
        step = self._fixed_batch or len(images)
        parts = [self._run(images[start : start + step]) for start in range(0, len(images), step)]
        values: NDArray[np.float32] = np.concatenate(parts, dtype=np.float32, casting="same_kind")
        if self._toml.l2:
            lengths = np.linalg.norm(values, axis=1, keepdims=True)
            np.divide(values, lengths, out=values, where=lengths > 0)
        return values

    def _run(self, images: NDArray[np.uint8]) -> NDArray[Any]:
        """Describes at most as many images as the network takes; a fixed batch is filled up."""
        count = len(images)
        if self._fixed_batch is not None:
            images = np.pad(images, ((0, self._fixed_batch - count), (0, 0), (0, 0), (0, 0)))
        fed = {self._input.name: self._prepared(images)}
        output = np.asarray(self._session.run([self._output], fed)[0])
        if output.ndim != 2 or len(output) != len(images):
            raise MethodError(
                f"{self.method} returned an array of shape {output.shape} for {len(images)} images instead of one row "
                "an image; name an `output` of B×D in its TOML"
            )
        return output[:count]

    def _prepared(self, images: NDArray[np.uint8]) -> NDArray[Any]:
        toml = self._toml
        if toml.colour == "bgr":
            images = images[..., ::-1]
        if toml.mean is None or toml.scale is None:
            prepared: NDArray[Any] = images.transpose(0, 3, 1, 2)
        else:
            prepared = network_input(images, Normalisation(toml.mean, toml.scale))
        laid = prepared if toml.layout == "nchw" else prepared.transpose(0, 2, 3, 1)
        return np.ascontiguousarray(laid, _INPUT_TYPES[self._input.type])


def open_method(argument: str) -> OnnxDescriber:
    """Opens an ONNX file and the TOML beside it.

    Raises:
        MethodError: The file is missing, is no ONNX network, or does not take or give what is wanted.
        MissingExtraError: onnx or onnxruntime is not installed.
        ConfigError: The TOML is missing or wrong.
    """
    if not argument:
        raise ConfigError("onnx needs a file; write onnx:FILE.onnx")
    path = Path(argument).expanduser()
    if not path.is_file():
        raise MethodError(f"there is no ONNX file {readable(path)}; check the path after onnx:")
    try:
        import onnx  # noqa: F401
        import onnxruntime  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("the method onnx", "onnx") from error
    return OnnxDescriber(path, read_onnx_toml(onnx_toml_path(path)))


def _session(path: Path) -> onnxruntime.InferenceSession:
    import onnxruntime

    refuse_pointer(path, MethodError)
    options = onnxruntime.SessionOptions()
    options.log_severity_level = _FATAL_ONLY
    options.intra_op_num_threads = usable_cores()  # its own choice is all cores of the machine
    wanted = ("CUDAExecutionProvider", "CPUExecutionProvider")
    providers = [name for name in wanted if name in onnxruntime.get_available_providers()]
    try:
        return onnxruntime.InferenceSession(str(path), options, providers)
    except Exception as error:  # onnxruntime's own kinds derive from nothing more special
        raise MethodError(
            f"{readable(path)} is no ONNX network that runs here: {first_line(error)}; export it again"
        ) from error


def _checked_input(path: Path, session: onnxruntime.InferenceSession, toml: OnnxToml) -> onnxruntime.NodeArg:
    inputs = session.get_inputs()
    if len(inputs) != 1:
        names = ", ".join(one.name for one in inputs)
        raise MethodError(
            f"{readable(path)} has {len(inputs)} inputs ({names}); export a network that takes images alone"
        )
    (only,) = inputs
    toml_path = readable(onnx_toml_path(path))
    height, width = toml.image_size
    wanted = (toml.channels, height, width) if toml.layout == "nchw" else (height, width, toml.channels)
    fits = len(only.shape) == 4 and all(
        not isinstance(has, int) or has == want for has, want in zip(only.shape[1:], wanted, strict=True)
    )
    if not fits:
        raise MethodError(
            f"{readable(path)} takes images of shape {only.shape}, but its TOML says B×{'×'.join(map(str, wanted))}; "
            f"correct image_size, colour or layout in {toml_path}"
        )
    if only.type not in _INPUT_TYPES:
        raise MethodError(f"{readable(path)} takes {only.type}; export it for one of {', '.join(_INPUT_TYPES)}")
    takes_pixels = only.type == "tensor(uint8)"
    if takes_pixels != (toml.mean is None):
        pixels, numbers = "the pixels themselves; leave out mean and scale", "prepared numbers; state mean and scale"
        raise ConfigError(
            f"{readable(path)} takes {only.type}, so it wants {pixels if takes_pixels else numbers} in {toml_path}"
        )
    return only


def _output_name(path: Path, session: onnxruntime.InferenceSession, toml: OnnxToml) -> str:
    outputs = {one.name: one.type for one in session.get_outputs()}
    toml_path = readable(onnx_toml_path(path))
    if toml.output is None and len(outputs) > 1:
        raise ConfigError(f"{readable(path)} has the outputs {', '.join(outputs)}; name one as `output` in {toml_path}")
    name = toml.output or next(iter(outputs))
    if name not in outputs:
        raise ConfigError(
            f"{toml_path} names the output {name!r}, but the network has {', '.join(outputs)}; correct it"
        )
    if outputs[name] not in _OUTPUT_TYPES:
        raise MethodError(f"the output {name!r} of {readable(path)} is {outputs[name]}, not floating-point numbers")
    return name


def _weights_hash(path: Path) -> str:
    """SHA-256 of the file, and of those that it keeps large tensors in."""
    import onnx
    from onnx.external_data_helper import ExternalDataInfo, uses_external_data

    try:
        model = onnx.load(str(path), load_external_data=False)
        names = {ExternalDataInfo(one).location for one in model.graph.initializer if uses_external_data(one)}
        hashes = [sha256_of(one) for one in (path, *(path.parent / name for name in sorted(names)))]
    except OSError as error:
        raise MethodError(
            f"cannot read {readable(error.filename or path)}: {error.strerror or error}; "
            "copy the network with all its files"
        ) from error
    except Exception as error:  # protobuf's own kind, which lies in another module for each of its versions
        raise MethodError(f"{readable(path)} is no ONNX file: {first_line(error)}; export it again") from error
    return hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
