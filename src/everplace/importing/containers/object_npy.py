"""Arrays of Python objects in .npy files, read without running what a stranger put into them.

NumPy writes such an array as a pickle, and an ordinary unpickler calls whatever function the pickle names. The
one here knows the names of NumPy's array constructors and nothing else, and puts its own plain functions in
their place, which build lists of numbers: not even NumPy's own constructors run on a stranger's bytes.
"""

from __future__ import annotations

import io
import math
import pickle
import pickletools
import warnings
from collections.abc import Callable
from typing import IO, Any

import numpy as np

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.file_trees import AnyPath

__all__ = ["read_object_array"]

_LARGEST = 1 << 28
_DEEPEST = 4
_NUMBERS = frozenset(["b1", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8"])
_OBJECTS = frozenset({"O", "O4", "O8"})
_PUTS = frozenset({"PUT", "BINPUT", "LONG_BINPUT"})


def read_object_array(path: AnyPath) -> list[Any]:
    """Reads an array of lists and numbers, of the object type or of plain numbers.

    Args:
        path: A .npy file of version 1, 2 or 3.

    Returns:
        The array as nested lists in row-major order; arrays inside it are lists too.

    Raises:
        RouteError: The file is missing, damaged, or holds more than arrays, lists and numbers.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST + 1)
        if len(data) > _LARGEST:
            raise RouteError(f"{readable(path)} is larger than {_LARGEST} bytes; it is no list of matches")
        # From memory: there a length that a file only claims to have costs nothing.
        content = io.BytesIO(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy's advice to save again what Python 2 wrote
            return _read(path, content)
    except OSError as error:
        raise RouteError(
            f"cannot read {readable(path)}: {error.strerror or error}; check that the data set is whole"
        ) from error
    except pickle.UnpicklingError as error:
        raise RouteError(f"{readable(path)} is damaged or unsafe: {_one_line(error)}; get it again") from error
    except RouteError:
        raise
    except Exception as error:  # broken bytes make an unpickler raise nearly anything
        raise RouteError(f"{readable(path)} is not a whole .npy file ({_one_line(error)}); get it again") from error


def _one_line(error: Exception) -> str:
    """Says what went wrong in at most 200 characters."""
    return (" ".join(str(error).split()) or type(error).__name__)[:200]


def _read(path: AnyPath, file: IO[bytes]) -> list[Any]:
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
    else:
        shape, fortran, dtype = np.lib.format.read_array_header_2_0(file)
    array = _Array()
    if dtype.hasobject:
        _require_modest(file)
        loaded = _Unpickler(file).load()
        if not isinstance(loaded, _Array):
            raise pickle.UnpicklingError("what it holds is no array")
        array = loaded
    else:
        kind = _Dtype(dtype.str[1:])
        kind.__setstate__((3, dtype.str[0]))
        array.__setstate__((1, tuple(shape), kind, fortran, file.read()))
    plain = _plain(array, {})
    if not isinstance(plain, list):
        raise RouteError(f"{readable(path)} holds a single value and no array; get the right file")
    return plain


class _Dtype:
    """Stands for a numpy.dtype of numbers or objects."""

    __slots__ = ("name", "order")

    def __init__(self, name: object) -> None:
        if not isinstance(name, str) or name not in _NUMBERS | _OBJECTS:
            raise pickle.UnpicklingError(f"it holds values of the type {str(name)[:40]!r}")
        self.name = name
        self.order = "<"

    def __setstate__(self, state: Any) -> None:
        if state[1] not in {"<", ">", "|", "="}:
            raise pickle.UnpicklingError("it holds a byte order that does not exist")
        self.order = state[1]

    def numbers(self, data: object) -> list[Any]:
        """Reads numbers from bytes, or from the text that Python 2 made of them."""
        plain = data.encode("latin1") if isinstance(data, str) else data
        if self.name in _OBJECTS or not isinstance(plain, bytes | bytearray):
            raise pickle.UnpicklingError("it holds an array without its numbers")
        numbers: list[Any] = np.frombuffer(plain, dtype=np.dtype(self.order + self.name)).tolist()
        return numbers


class _Array:
    """Stands for a numpy.ndarray."""

    __slots__ = ("fortran", "shape", "values")

    def __init__(self) -> None:
        self.values: list[Any] = []
        self.shape: tuple[int, ...] = (0,)
        self.fortran = False

    def __setstate__(self, state: Any) -> None:
        shape, kind, fortran, data = state[-4:]
        if not isinstance(kind, _Dtype) or not isinstance(shape, tuple) or not all(type(n) is int for n in shape):
            raise pickle.UnpicklingError("it holds an array without shape or type")
        objects = isinstance(data, list) and kind.name in _OBJECTS
        values = data if objects else kind.numbers(data)
        if min(shape, default=0) < 0 or math.prod(shape) != len(values):
            raise pickle.UnpicklingError(f"it holds an array of shape {shape} with {len(values)} values")
        # Objects are listed row by row, whatever the order in memory was; numbers are not.
        self.values, self.shape, self.fortran = values, shape, bool(fortran) and not objects

    def nested(self) -> Any:
        """Returns lists of lists; of an array without dimensions its value."""
        if not self.shape:
            return self.values[0]
        rows = self.values
        if self.fortran and len(self.shape) > 1:
            order = np.arange(len(rows)).reshape(self.shape, order="F").ravel()
            rows = [rows[index] for index in order]
        for width in reversed(self.shape[1:]):
            rows = [rows[start : start + width] for start in range(0, len(rows), width)] if width else []
        return rows


class _Unpickler(pickle.Unpickler):
    """Builds arrays, lists and numbers, and refuses every other name that a pickle calls."""

    def __init__(self, file: IO[bytes]) -> None:
        super().__init__(file, encoding="latin1")  # what Python 2 wrote as str is bytes
        self._known = _constructors()

    def find_class(self, module: str, name: str) -> Any:
        """Returns a stand-in for one of NumPy's array constructors.

        Raises:
            pickle.UnpicklingError: It is anything else; nothing was imported.
        """
        known = self._known.get((module.replace("numpy._core.", "numpy.core."), name))
        if known is None:
            raise pickle.UnpicklingError(f"it wants to call {module[:60]}.{name[:60]}, which no array of numbers needs")
        return known


def _constructors() -> dict[tuple[str, str], Any]:
    """Returns the stand-ins, made anew for each file: a pickle can set attributes on what it is given."""

    def reconstruct(*_: object) -> _Array:
        return _Array()

    def dtype(name: object, *_: object) -> _Dtype:
        return _Dtype(name)

    def scalar(kind: object, data: object) -> Any:
        if not isinstance(kind, _Dtype):
            raise pickle.UnpicklingError("it holds a number without type")
        (value,) = kind.numbers(data)
        return value

    def from_buffer(data: object, kind: object, shape: object, order: object) -> _Array:
        array = _Array()
        array.__setstate__((shape, kind, order == "F", bytes(data) if isinstance(data, bytearray) else data))
        return array

    def encode(text: str, *_: object) -> bytes:
        return text.encode("latin1")

    known: dict[tuple[str, str], Callable[..., Any] | str] = {
        ("numpy.core.multiarray", "_reconstruct"): reconstruct,
        ("numpy.core.multiarray", "scalar"): scalar,
        ("numpy.core.numeric", "_frombuffer"): from_buffer,
        ("numpy", "ndarray"): "ndarray",
        ("numpy", "dtype"): dtype,
        ("_codecs", "encode"): encode,
    }
    return known


def _require_modest(file: IO[bytes]) -> None:
    """Refuses a pickle that names a length or a place in the memo beyond its own size, which costs memory."""
    start = file.tell()
    size = file.seek(0, io.SEEK_END)
    file.seek(start)
    for opcode, argument, _ in pickletools.genops(file):  # raises ValueError where fewer bytes follow than claimed
        if opcode.name in _PUTS and int(argument or 0) > size:
            raise pickle.UnpicklingError("it wants to remember more values than it holds")
    file.seek(start)


def _plain(value: Any, done: dict[int, Any], depth: int = 0) -> Any:
    """Makes lists of arrays and tuples; what occurs twice stays one object, so that nothing grows."""
    if isinstance(value, float) or (isinstance(value, int) and abs(value) < 1 << 64):
        return value
    if not isinstance(value, _Array | list | tuple) or depth > _DEEPEST:
        raise pickle.UnpicklingError("it holds more than lists of numbers")
    if id(value) not in done:
        items = value.nested() if isinstance(value, _Array) else value
        if not isinstance(items, list | tuple):
            return _plain(items, done, depth + 1)
        # The value is kept with its list, so that no other object gets its id.
        done[id(value)] = value, [_plain(item, done, depth + 1) for item in items]
    return done[id(value)][1]
