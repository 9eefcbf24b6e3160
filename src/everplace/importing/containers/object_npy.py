"""Arrays of Python objects in .npy files, read without running what a stranger put into them.

NumPy writes such an array as a pickle, and an ordinary unpickler calls whatever function the pickle names. The one here
knows the names of NumPy's array constructors and nothing else. What stands behind these names is our own, because
NumPy's take a stranger's word for how much memory to reserve.
"""

from __future__ import annotations

import io
import pickle
import pickletools
import re
import warnings
from typing import Any

import numpy as np

from everplace.errors import RouteError
from everplace.files import readable
from everplace.git_lfs import POINTER_BYTES, is_pointer, pointer_sentence
from everplace.importing.containers.file_trees import TreePath

__all__ = ["read_object_array"]

_LARGEST = 1 << 28
_DEEPEST = 4
_TYPES = re.compile("b1|[iuf][1248]|O[48]?")


def read_object_array(path: TreePath) -> list[Any]:
    """Reads an array of lists and numbers, of the object type or of plain numbers.

    Args:
        path: A .npy file of version 1, 2 or 3.

    Returns:
        The array as nested lists in row-major order; arrays inside it are lists too.

    Raises:
        RouteError: The file is missing, damaged, or holds more than arrays, lists and numbers.
    """
    try:
        with path.open() as file:
            data = file.read(_LARGEST + 1)
        if is_pointer(data[:POINTER_BYTES]):
            raise RouteError(pointer_sentence(readable(path)))
        if len(data) > _LARGEST:
            raise RouteError(f"{readable(path)} is larger than {_LARGEST} bytes; it is no list of matches")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy's advice to save again what Python 2 wrote
            array = _plain(_read(data), {})
    except pickle.UnpicklingError as error:
        raise RouteError(f"{readable(path)} is damaged or unsafe: {_one_line(error)}; get it again") from error
    except RouteError:
        raise
    except Exception as error:  # broken bytes make an unpickler raise nearly anything
        raise RouteError(f"{readable(path)} is not a whole .npy file ({_one_line(error)}); get it again") from error
    if not isinstance(array, list):
        raise RouteError(f"{readable(path)} holds a single value and no array; get the right file")
    return array


def _one_line(error: Exception) -> str:
    """Says what went wrong in at most 200 characters."""
    return (" ".join(str(error).split()) or type(error).__name__)[:200]


def _read(data: bytes) -> _Array:
    file = io.BytesIO(data)
    header = np.lib.format
    read_header = header.read_array_header_1_0 if header.read_magic(file) == (1, 0) else header.read_array_header_2_0
    shape, fortran, dtype = read_header(file)
    content = file.read()
    if not dtype.hasobject:
        return _Array().fill(shape, _Type(dtype.str[1:], dtype.str[0]), fortran, content)
    # A pickle that names a length or a place in the memo beyond its own size would cost memory. For lengths `genops`
    # raises ValueError.
    for opcode, argument, _ in pickletools.genops(content):
        if "PUT" in opcode.name and int(argument or 0) > len(data):
            raise pickle.UnpicklingError("it wants to remember more values than it holds")
    array = _Unpickler(io.BytesIO(content), encoding="latin1").load()  # what Python 2 wrote as str is bytes
    if not isinstance(array, _Array):
        raise pickle.UnpicklingError("what it holds is no array")
    return array


class _Type:
    """Stands for a numpy.dtype of numbers or objects."""

    def __init__(self, name: object, order: str = "=") -> None:
        if not isinstance(name, str) or not _TYPES.fullmatch(name):
            raise pickle.UnpicklingError(f"it holds values of the type {str(name)[:40]!r}")
        self.dtype = np.dtype(object if name[0] == "O" else order + name)

    def __setstate__(self, state: Any) -> None:
        self.dtype = self.dtype.newbyteorder(state[1])


class _Array:
    """Stands for a numpy.ndarray."""

    def fill(self, shape: Any, kind: Any, fortran: object, data: Any) -> _Array:
        """Takes values as a list of objects, row by row, or as the bytes of numbers; Python 2 made text of these."""
        if kind.dtype.hasobject:
            self.values = np.fromiter(data, dtype=object, count=len(data))
        else:
            self.values = np.frombuffer(data.encode("latin1") if isinstance(data, str) else data, kind.dtype)
        self.values = self.values.reshape(shape, order="F" if fortran and not kind.dtype.hasobject else "C")
        return self

    def __setstate__(self, state: Any) -> None:
        self.fill(*state[-4:])


class _Unpickler(pickle.Unpickler):
    """Builds arrays, lists and numbers, and refuses every other name that a pickle calls."""

    def find_class(self, module: str, name: str) -> Any:
        """Returns what stands for one of NumPy's array constructors, made anew: a pickle can set attributes on it.

        Raises:
            pickle.UnpicklingError: It is anything else; nothing was imported.
        """
        match module.replace("numpy._core.", "numpy.core."), name:
            case "numpy", "ndarray":
                return "ndarray"  # only ever handed to the next one
            case "numpy.core.multiarray", "_reconstruct":
                return lambda *_: _Array()
            case "numpy", "dtype":
                return lambda name, *_: _Type(name)
            case "numpy.core.multiarray", "scalar":
                return lambda kind, data: _Array().fill((), kind, False, data)
            case "numpy.core.numeric", "_frombuffer":
                return lambda data, kind, shape, order: _Array().fill(shape, kind, order == "F", data)
            case "_codecs", "encode":
                return lambda text, *_: text.encode("latin1")
        raise pickle.UnpicklingError(f"it wants to call {module[:60]}.{name[:60]}, which no array of numbers needs")


def _plain(value: Any, done: dict[int, Any], depth: int = 0) -> Any:
    """Makes lists of arrays and tuples; what occurs twice stays one object, so that nothing grows."""
    if isinstance(value, float) or (isinstance(value, int) and abs(value) < 1 << 64):
        return value
    if not isinstance(value, _Array | list | tuple) or depth > _DEEPEST:
        raise pickle.UnpicklingError("it holds more than lists of numbers")
    if id(value) not in done:
        items: Any = value
        if isinstance(value, _Array):
            items = value.values.tolist() if value.values.size else []
            if not isinstance(items, list):
                return _plain(items, done, depth + 1)
        # The value is kept with its list, so that no other object gets its id.
        done[id(value)] = value, [_plain(item, done, depth + 1) for item in items]
    return done[id(value)][1]
