"""Object arrays of NumPy, read by an unpickler that knows their constructors and nothing else."""

from __future__ import annotations

import io
import os
import pickle
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.containers.object_npy import read_object_array


def objects(rows: list[list[Any]]) -> NDArray[Any]:
    array = np.empty((len(rows), 2), dtype=object)
    for index, row in enumerate(rows):
        array[index, 0], array[index, 1] = row
    return array


def header(shape: tuple[int, ...]) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "|O", "fortran_order": False, "shape": shape})
    return buffer.getvalue()


ROWS = objects([[0, [0, 1]], [np.int64(1), np.array([1, 2], dtype=">i4")], [2.0, []]])
PLAIN = [[0, [0, 1]], [1, [1, 2]], [2.0, []]]


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4, 5])
def test_every_protocol_of_pickle(tmp_path: Path, protocol: int) -> None:
    path = tmp_path / "a.npy"
    path.write_bytes(header((3, 2)) + pickle.dumps(ROWS, protocol=protocol))
    assert read_object_array(TreePath(path)) == PLAIN


def test_what_older_numpy_wrote_under_python_2(tmp_path: Path) -> None:
    # Protocol 2 names modules in text; a byte string of Python 2 is the opcode U and comes back as str.
    data = pickle.dumps(ROWS, protocol=2).replace(b"numpy._core.multiarray", b"numpy.core.multiarray")
    (tmp_path / "a.npy").write_bytes(header((3, 2)) + data)
    assert read_object_array(TreePath(tmp_path / "a.npy")) == PLAIN
    number = b"\x80\x02cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R(K\x01K\x02\x85"
    number += b"cnumpy\ndtype\nU\x02i2K\x00K\x01\x87R(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"
    number += b"\x89U\x04\x01\x00\xff\xfftb."
    # It wrote shapes as (2L,), which NumPy reads with a warning that says to save the file again.
    (tmp_path / "b.npy").write_bytes(header((2,)).replace(b"(2,), }  ", b"(2L,), } ") + number)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_object_array(TreePath(tmp_path / "b.npy")) == [1, -1]


@pytest.mark.parametrize("order", ["C", "F"])
def test_plain_numbers_and_the_order_in_memory(tmp_path: Path, order: Any) -> None:
    numbers = np.arange(24.0).reshape(2, 3, 4)
    np.save(tmp_path / "a.npy", np.array(numbers, order=order))
    assert read_object_array(TreePath(tmp_path / "a.npy")) == numbers.tolist()
    inside = np.empty(1, dtype=object)
    inside[0] = np.array(numbers[0], order=order)
    np.save(tmp_path / "b.npy", inside, allow_pickle=True)
    assert read_object_array(TreePath(tmp_path / "b.npy")) == [numbers[0].tolist()]
    np.save(tmp_path / "c.npy", np.array(ROWS, order=order), allow_pickle=True)
    assert read_object_array(TreePath(tmp_path / "c.npy")) == PLAIN


def test_lists_of_one_length_stay_lists(tmp_path: Path) -> None:
    rows = np.empty(2, dtype=object)
    rows[0], rows[1] = [1, 2], [3, 4]
    np.save(tmp_path / "a.npy", rows, allow_pickle=True)
    assert read_object_array(TreePath(tmp_path / "a.npy")) == [[1, 2], [3, 4]]


class Hostile:
    def __init__(self, function: Any, *arguments: Any) -> None:
        self.call = function, arguments

    def __reduce__(self) -> Any:
        return self.call


@pytest.mark.parametrize(
    ("function", "named"), [(os.system, "posix.system"), (eval, "builtins.eval"), (np.load, "numpy.load"), (np.dot, "")]
)
def test_a_hostile_pickle_runs_nothing(tmp_path: Path, function: Any, named: str) -> None:
    mark = tmp_path / "pwned"
    argument = f"__import__('pathlib').Path({str(mark)!r}).touch()" if function is eval else f"touch {mark}"
    array = np.empty(1, dtype=object)
    array[0] = Hostile(function, argument)
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    with pytest.raises(RouteError, match=f"a.npy is damaged or unsafe: it wants to call {named}") as caught:
        read_object_array(TreePath(tmp_path / "a.npy"))
    assert "\n" not in str(caught.value)
    assert not mark.exists()


def test_the_constructors_of_one_file_cannot_be_changed_for_the_next(tmp_path: Path) -> None:
    # GLOBAL _reconstruct, then BUILD with (None, {"x": 1}): sets an attribute on the function it was given.
    bad = b"\x80\x02cnumpy.core.multiarray\n_reconstruct\nN}X\x01\x00\x00\x00xK\x01s\x86b."
    (tmp_path / "a.npy").write_bytes(header((1,)) + bad)
    with pytest.raises(RouteError, match="no array"):
        read_object_array(TreePath(tmp_path / "a.npy"))
    np.save(tmp_path / "b.npy", ROWS, allow_pickle=True)
    assert read_object_array(TreePath(tmp_path / "b.npy")) == PLAIN
    assert not hasattr(np.array([1]).__reduce__()[0], "x")


def test_lists_that_hold_one_another_many_times_do_not_grow(tmp_path: Path) -> None:
    laugh: Any = [0] * 1000
    for _ in range(3):
        laugh = [laugh] * 1000
    array = np.empty(1, dtype=object)
    array[0] = laugh
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    (outer,) = read_object_array(TreePath(tmp_path / "a.npy"))
    assert outer[0] is outer[999]
    endless: list[Any] = []
    endless.append(endless)
    array[0] = endless
    np.save(tmp_path / "b.npy", array, allow_pickle=True)
    with pytest.raises(RouteError, match="more than lists of numbers"):
        read_object_array(TreePath(tmp_path / "b.npy"))


def test_a_small_file_cannot_ask_for_much_memory(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for claim in (
        b"N" + b"r\xff\xff\xff\x0f.",
        b"\x8e" + b"\xff" * 4 + b"\x01\x00\x00\x00.",
        b"\x96" + b"\0" * 4 + b"\x01\0\0\0.",
    ):
        (tmp_path / "a.npy").write_bytes(header((1,)) + b"\x80\x05" + claim)
        with pytest.raises(RouteError, match="damaged or unsafe|not a whole"):
            read_object_array(TreePath(tmp_path / "a.npy"))
    number = b"\x8a\xff" + b"\x7f" * 255 + b"."
    (tmp_path / "a.npy").write_bytes(header((1,)) + b"\x80\x05" + number)
    with pytest.raises(RouteError, match="no array"):
        read_object_array(TreePath(tmp_path / "a.npy"))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kilobytes; the first asks for 4 GB


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not a whole .npy file"),
        (b"\x93NUMPY\x01\x00", "is not a whole .npy file"),
        (header((1,)), "is not a whole .npy file"),
        (header((1,)) + pickle.dumps([1, 2]), "what it holds is no array"),
        (header((1,)) + pickle.dumps(np.array(["a"], dtype=object)), "more than lists of numbers"),
        (header((1,)) + pickle.dumps(np.array([{}], dtype=object)), "more than lists of numbers"),
        (header((1,)) + pickle.dumps(np.array(["a"])), "values of the type 'U1'"),
        (header((1,)) + pickle.dumps(np.zeros(2, dtype=[("a", "i4")])), "values of the type 'V4'"),
    ],
)
def test_broken_files(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(RouteError, match=message):
        read_object_array(TreePath(tmp_path / "a.npy"))
    with pytest.raises(RouteError, match="cannot read .*gone.npy"):
        read_object_array(TreePath(tmp_path / "gone.npy"))


@given(
    protocol=st.integers(0, 5),
    edits=st.lists(st.tuples(st.integers(0, 400), st.binary(max_size=3)), min_size=1, max_size=4),
    kept=st.integers(0, 400),
)
@fuzzed(80)
def test_fuzzed_files_give_lists_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, protocol: int, edits: list[tuple[int, bytes]], kept: int
) -> None:
    data = bytearray(header((3, 2)) + pickle.dumps(ROWS, protocol=protocol))
    for position, piece in edits:
        data[position : position + len(piece)] = piece
    path = tmp_path_factory.mktemp("npy") / "a.npy"
    path.write_bytes(data[: kept or None])
    try:
        assert isinstance(read_object_array(TreePath(path)), list)
    except RouteError as error:
        assert "a.npy" in str(error)
        assert "\n" not in str(error)
