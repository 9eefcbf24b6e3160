"""What a method costs: the time for one image, and the memory that a robot needs which runs only this method.

Peak memory is measured in a process of its own, which opens the method, describes some images and says how much of it
was in main memory at its highest: Python, the libraries and the weights count, memory of a GPU does not. In the process
of a comparison the figure would be that of all methods together: libraries once imported and weights once loaded stay.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from everplace.describe.batches import gather_batches
from everplace.describe.describer import Describer
from everplace.describe.registry import open_describer
from everplace.errors import MethodError, RouteError
from everplace.images.decoding import decode_images

__all__ = ["COST_DEFINITIONS", "ImageTime", "peak_memory", "time_describer"]

COST_DEFINITIONS = {
    "dimension": "Numbers in a descriptor.",
    "bytes": "Bytes of a descriptor, as float32.",
    "ms/image": "Median milliseconds to describe one decoded image alone, over 32; opening the method is not counted.",
    "peak MB": "Largest resident memory, in 10^6 bytes, of a process of its own that opens the method and describes 64 "
    "images in batches: Python, libraries and weights count, memory of a GPU does not.",
}
"""One sentence for every cost, by its column in the tables."""

_MEGABYTE = 10**6
_PROCESSOR_TIMES = Path("/proc/stat")
_WATCHED_SECONDS = 0.2
_MUCH_WORK = 0.2
"""Of all processors; on two that is less than half of one."""


@dataclass(frozen=True, slots=True)
class ImageTime:
    """How long a method takes for one image.

    Attributes:
        ms: Milliseconds.
        beside_other_work: Whether other processes kept the machine busy meanwhile, so that it may take less.
    """

    ms: float
    beside_other_work: bool


def time_describer(describer: Describer, paths: Sequence[Path], *, frames: int = 32) -> ImageTime:
    """Measures how long a method takes for one image as it comes from a camera, alone.

    Args:
        describer: The method, opened; neither that nor decoding is counted.
        paths: Images to choose from; the first `frames` are used.
        frames: Number of images to time.

    Returns:
        The median over the images.

    Raises:
        RouteError: There are no images.
        ImageError: An image cannot be decoded.
    """
    images = list(decode_images(paths[:frames], describer.image))
    if not images:
        raise RouteError("there are no images to time a method on; choose a directory or frames that hold some")
    others = _other_work()
    describer.describe_batch(images[0][None])  # the first call also allocates and chooses kernels
    elapsed = []
    for image in images:
        start = time.perf_counter()
        describer.describe_batch(image[None])
        elapsed.append(time.perf_counter() - start)
    return ImageTime(1000 * float(np.median(elapsed)), max(others, _other_work()) > _MUCH_WORK)


def _other_work() -> float:
    """The share of the machine's processors that others use while this process waits; 0 where nobody tells."""
    before = _processor_time()
    time.sleep(_WATCHED_SECONDS)
    after = _processor_time()
    if before is None or after is None or after[1] == before[1]:
        return 0.0
    return (after[0] - before[0]) / (after[1] - before[1])


def _processor_time() -> tuple[int, int] | None:
    """How long all processors together were busy since the machine started, and how long there was to be so."""
    try:
        first = _PROCESSOR_TIMES.read_text("ascii").splitlines()[0]
    except (OSError, IndexError):  # no Linux
        return None
    # user, nice, system, idle, waiting for a disk, interrupts (2), stolen; guests are in the first two once more
    times = [int(part) for part in first.split()[1:9]]
    return sum(times) - sum(times[3:5]), sum(times)


def peak_memory(method: str, paths: Sequence[Path], *, frames: int = 64) -> float | None:
    """Measures the largest resident memory of a process that opens a method and describes images with it.

    Args:
        method: As `everplace.describe.registry.open_describer` takes it.
        paths: Images to choose from; the first `frames` are described, in the method's batches.
        frames: Number of images; the default is two of the usual batches, after which only the descriptors grow.

    Returns:
        Megabytes (10⁶ bytes); None where the system does not tell (Windows).

    Raises:
        MethodError: The process failed; the message holds its last line.
    """
    order = json.dumps({"method": method, "paths": [os.fspath(path) for path in paths[:frames]]})
    # What this process can import the other one can, and nothing from the current directory besides.
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PYTHONSAFEPATH": "1"}
    done = subprocess.run(
        [sys.executable, "-m", __name__], input=order, capture_output=True, text=True, check=False, env=environment
    )
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise MethodError(f"the peak memory of {method} could not be measured: {said[-1]}")
    measured = json.loads(done.stdout.splitlines()[-1])
    return None if measured is None else float(measured)


def _main() -> None:
    order = json.load(sys.stdin)
    describer = open_describer(order["method"])
    for images in gather_batches(decode_images([*map(Path, order["paths"])], describer.image), describer.batch):
        describer.describe_batch(images)
    print("\n" + json.dumps(_peak_of_this_process()))


def _peak_of_this_process() -> float | None:
    status = Path("/proc/self/status")
    if status.exists():
        # Not ru_maxrss: on Linux that begins with the memory of the process that started this one.
        lines = status.read_text("ascii", "replace").splitlines()
        return next(1024 * int(line.split()[1]) / _MEGABYTE for line in lines if line.startswith("VmHWM:"))
    if sys.platform == "win32":
        return None
    import resource

    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return largest * (1 if sys.platform == "darwin" else 1024) / _MEGABYTE


if __name__ == "__main__":
    _main()
