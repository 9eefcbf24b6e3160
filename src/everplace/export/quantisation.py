"""An ONNX network in 8 bits: weights and what flows between layers, by static quantisation.

Jacob et al., "Quantization and Training of Neural Networks for Efficient Integer-Arithmetic-Only Inference", CVPR 2018,
as onnxruntime does it. The ranges are those that the numbers have on some images of the route (Nagel et al. 2021, "A
White Paper on Neural Network Quantization"). Weights take 7 bits, a scale for each output: 8 would overflow
on processors that sum products in 16 bits.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import MethodError

__all__ = ["quantise"]

_LAYERS = ["Conv", "Gemm", "MatMul"]


def quantise(network: Path, images: Sequence[NDArray[np.uint8]], *, learnt: Collection[str]) -> None:
    """Replaces a network in a file by the same in 8 bits.

    Args:
        network: The file; its input is named `images`.
        images: H×W×C, as the network wants them, at least one: the ranges are those of its numbers on these.
        learnt: Names of the parameters that were learnt; a layer without one of them, such as a fixed filter, stays in
            32 bits.

    Raises:
        MethodError: No layer was learnt.
    """
    import onnx
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

    class Reader(CalibrationDataReader):  # type: ignore[misc]
        def __init__(self) -> None:
            self._left: Iterator[NDArray[np.uint8]] = iter(images)

        def get_next(self) -> dict[str, NDArray[np.float32]] | None:
            image = next(self._left, None)
            if image is None:
                return None
            return {"images": image.transpose(2, 0, 1)[None].astype(np.float32) / np.float32(255)}

    nodes = onnx.load(str(network)).graph.node
    layers = [node.name for node in nodes if not frozenset(learnt).isdisjoint(node.input)]
    if not layers:  # which the library takes for all of them
        raise MethodError("no layer of this network was learnt, so none can be kept in 8 bits; export it in 32 bits")
    with _silent():
        quantize_static(
            str(network),
            str(network),
            Reader(),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=_LAYERS,
            nodes_to_quantize=layers,
            per_channel=True,
            reduce_range=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Its advice to run another tool first is of no use here."""
    root = logging.getLogger()
    level = root.level
    root.setLevel(logging.ERROR)
    try:
        yield
    finally:
        root.setLevel(level)
