"""Table 1's network on one frame, in 32, 16 and 8 bits: how fast it reads its weights, against only reading.

Each frame needs every weight once, so no frame takes less than reading them; nearly all are in the fully connected
layers, whose time alone is measured too. Memory's speed is that of an array four times as large as the last cache,
summed or multiplied by a vector in as many threads, whichever is faster; of a network that the last cache holds in part
the ratio can exceed 1. 32 and 16 bits are computed by torch, 16 alone not by everplace, which describes in 32; 8 are
what `everplace export --int8` writes, run by onnxruntime, whose own profile tells the time of its layers.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

import numpy as np
import onnxruntime
import torch

from benchmarks.ratio import Ratio
from benchmarks.turns import by_turns
from everplace.describe.registry import open_describer
from everplace.describe.runs.trained import TrainedDescriber
from everplace.export.onnx_export import export_onnx
from everplace.model.architecture import Encoder, flattened_size
from everplace.model.checkpoint import Checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.model.pixels import to_input

ROUNDS = 7
WARM, FRAMES = 3, 5
WANTED = 0.7
CALIBRATED = 8
_LAST_CACHE = Path("/sys/devices/system/cpu/cpu0/cache/index3/size")
_LEAST = 2**30
_COLUMNS = 2**14


def measure(scratch: Path) -> list[Ratio]:
    model = ConditionVAE(ModelConfig.model_validate({"kind": "c-vae", "conditions": ("a", "b")})).eval()
    describer = TrainedDescriber(Checkpoint(model), device="cpu")
    half = deepcopy(model).bfloat16()
    frames = np.random.default_rng(0).integers(0, 256, (CALIBRATED, 224, 224, 3), dtype=np.uint8)
    export_onnx(describer, scratch / "int8.onnx", list(frames))
    eight = open_describer(f"onnx:{scratch / 'int8.onnx'}")

    @torch.inference_mode()
    def sixteen() -> object:
        return half.descriptor(to_input(torch.from_numpy(frames[:1])).bfloat16())

    work: dict[str, Callable[[], object]] = {
        "fp32": lambda: describer.describe_batch(frames[:1]),
        "fp32, layers": _layers_of(model.encoder, torch.float32),
        "bf16, torch": sixteen,
        "bf16, torch, layers": _layers_of(half.encoder, torch.bfloat16),
        "int8, onnxruntime": lambda: eight.describe_batch(frames[:1]),
    }
    seconds = by_turns(work, ROUNDS, FRAMES, WARM)
    seconds["int8, onnxruntime, layers"] = _seconds_of_layers(scratch / "int8.onnx")
    numbers = sum(parameter.numel() for parameter in model.encoder.fully_connected.parameters())
    read = _read_speed()
    rows = []
    for name, size in (("fp32", 4), ("bf16, torch", 2), ("int8, onnxruntime", 1)):
        for what, kind in (("", name), (": fully connected layers alone", f"{name}, layers")):
            speed = size * numbers / seconds[kind] / 1e9
            rows.append(
                Ratio(
                    f"weights of Table 1, one frame, {name}{what}",
                    f"{speed:.1f} GB/s: {size * numbers / 1e6:.0f} MB in {1000 * seconds[kind]:.1f} ms",
                    f"{read:.1f} GB/s, only reading",
                    speed / read,
                    at_least=WANTED,
                )
            )
    return rows


def _layers_of(encoder: Encoder, numbers: torch.dtype) -> Callable[[], object]:
    """The fully connected chain on what the convolutions give."""
    features = torch.rand(1, flattened_size(224, 224)).to(numbers)

    @torch.inference_mode()
    def run() -> object:
        x = features
        for layer in encoder.fully_connected:
            x = layer(x)
        return x

    return run


def _seconds_of_layers(network: Path) -> float:
    """What onnxruntime's profile says of a frame's matrix products; medians, summed over the layers."""
    options = onnxruntime.SessionOptions()
    options.enable_profiling = True
    options.profile_file_prefix = str(network.with_suffix(""))
    session = onnxruntime.InferenceSession(str(network), options, providers=["CPUExecutionProvider"])
    for _ in range(WARM + ROUNDS * FRAMES):
        session.run(None, {"images": np.zeros((1, 3, 224, 224), np.float32)})
    taken: dict[str, list[float]] = defaultdict(list)
    for event in json.loads(Path(session.end_profiling()).read_text("utf-8")):
        if event.get("args", {}).get("op_name") == "QGemm":
            taken[event["name"]].append(event["dur"] / 1e6)
    return float(sum(np.median(of) for of in taken.values()))


def _read_speed() -> float:
    """GB a second that a program reads from memory."""
    array = torch.ones(max(_LEAST, 4 * _last_cache_bytes()) // (4 * _COLUMNS), _COLUMNS)
    vector = torch.ones(_COLUMNS)
    seconds = by_turns({"sum": array.sum, "product": lambda: torch.mv(array, vector)}, ROUNDS, warm=1)
    return array.nbytes / min(seconds.values()) / 1e9


def _last_cache_bytes() -> int:
    """0 where the system does not tell."""
    try:
        return 1024 * int(_LAST_CACHE.read_text("ascii").strip().removesuffix("K"))
    except (OSError, ValueError):
        return 0
