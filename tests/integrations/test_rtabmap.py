"""RTAB-Map's descriptor, called as RTAB-Map's PyDescriptor calls it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.mapping.drives import image_files, images_of

import everplace
from everplace.match.similarity import directions

SCRIPT = Path(__file__).parents[2] / "integrations" / "rtabmap" / "everplace_descriptor.py"

# What PyDescriptor.cpp does: the script's directory is appended to the path, the module imported by its name, and its
# functions called by the C API; images are arrays of NPY_BYTE (signed) around the pixels of an OpenCV image (BGR).
CALLER = """
import ctypes, sys
import cv2, numpy as np
call = ctypes.pythonapi.PyObject_CallFunction
call.restype, call.argtypes = ctypes.py_object, [ctypes.py_object, ctypes.c_char_p]
sys.path.append(sys.argv[1])
module = __import__("everplace_descriptor")
call(module.init, b"i", int(sys.argv[2]))
rows = []
for path in sys.argv[4:]:
    pixels = cv2.imread(path, cv2.IMREAD_UNCHANGED)
    pixels = pixels[:, :, np.newaxis] if pixels.ndim == 2 else pixels
    found = call(module.extract, b"O", ctypes.py_object(np.ndarray(pixels.shape, np.byte, pixels.data)))
    assert type(found) is np.ndarray and found.dtype == np.float32 and found.ndim == 2 and len(found) == 1
    rows.append(np.ctypeslib.as_array(found.ctypes.data_as(ctypes.POINTER(ctypes.c_float)), found.shape)[0].copy())
np.save(sys.argv[3], rows)
"""


def called(
    tmp_path: Path, dimension: int, *images: Path, method: str | None = None
) -> tuple[subprocess.CompletedProcess[str], Path]:
    environment = {name: value for name, value in os.environ.items() if name != "EVERPLACE_METHOD"}
    if method is not None:
        environment["EVERPLACE_METHOD"] = method
    out = tmp_path / "rows.npy"
    command = [sys.executable, "-c", CALLER, str(SCRIPT.parent), str(dimension), str(out), *map(str, images)]
    return subprocess.run(command, capture_output=True, text=True, env=environment), out


def test_descriptors_are_those_of_the_method_at_length_one(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    drive = unchanged_rendered_route / "summer"
    done, out = called(tmp_path, 2048, *image_files(drive)[:3])
    assert done.returncode == 0, done.stderr
    expected = directions(everplace.load("hog16").describe(images_of(drive)[:3]).values)
    np.testing.assert_allclose(np.load(out), expected, atol=1e-6)


@pytest.mark.slow
def test_colours_are_not_swapped_and_grey_is_read(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    import cv2

    everplace.adapt("hog16", everplace.open_route(unchanged_rendered_route), tmp_path / "run", dimensions=16)
    pixels = np.zeros((64, 128, 3), np.uint8)
    pixels[:, :64, 0], pixels[:32, :, 2] = 255, 90  # red left, blue above: grey values differ when they are swapped
    cv2.imwrite(str(tmp_path / "colour.png"), pixels[:, :, ::-1])
    cv2.imwrite(str(tmp_path / "grey.png"), pixels[:, :, 0])
    done, out = called(tmp_path, 16, tmp_path / "colour.png", tmp_path / "grey.png", method=str(tmp_path / "run"))
    assert done.returncode == 0, done.stderr
    run = everplace.load(tmp_path / "run")
    np.testing.assert_allclose(np.load(out), directions(run.describe([pixels, pixels[:, :, 0]]).values), atol=1e-5)
    swapped = directions(run.describe(np.ascontiguousarray(pixels[:, :, ::-1])).values)
    assert np.abs(np.load(out)[0] - swapped).max() > 1e-3


@pytest.mark.parametrize(
    ("method", "dimension", "told"),
    [
        (
            "hog16",
            4096,
            "EVERPLACE_METHOD=hog16 has 2048 numbers, but RTAB-Map expects 4096; give it --Py",
        ),
        ("sad", 2048, "compares descriptors by their scalar product, which sad is not made for"),
        ("runs/none", 96, "there is no method or run directory 'runs/none'"),
    ],
)
def test_what_is_wrong_is_printed_by_init_and_raised_by_extract(
    unchanged_rendered_route: Path, tmp_path: Path, method: str, dimension: int, told: str
) -> None:
    """RTAB-Map survives an exception of extract(), which it prints, but not one of init()."""
    done, _ = called(tmp_path, dimension, *image_files(unchanged_rendered_route / "summer")[:1], method=method)
    assert done.returncode == 1
    assert told in done.stderr.splitlines()[0]
    assert f"RuntimeError: {done.stderr.splitlines()[0].removeprefix('everplace: ')}" in done.stderr
