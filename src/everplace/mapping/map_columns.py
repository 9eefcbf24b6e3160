"""The columns of a map's tables in Arrow, and arrays to and from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from everplace.mapping.image_statistics import STATISTICS

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["arrow_table", "as_matrix", "descriptor_schema", "frame_schema", "state_schema"]


def frame_schema(features: int) -> pa.Schema:
    """Of the table of frames; F numbers of the map's method each."""
    import pyarrow as pa

    return pa.schema(
        [
            ("drive", pa.string()), ("number", pa.int64()), ("stem", pa.string()), ("place", pa.int64()),
            ("position", pa.float64()), ("sure", pa.bool_()), ("between", pa.int64()),
            ("x", pa.float64()), ("y", pa.float64()), ("heading", pa.float64()), ("seconds", pa.float64()),
            ("features", pa.list_(pa.float16(), features)), ("looks", pa.list_(pa.float32(), STATISTICS)),
            ("thumbnail", pa.binary()),
        ]
    )  # fmt: skip


def descriptor_schema(dimensions: int) -> pa.Schema:
    """Of the table of descriptors; D numbers each."""
    import pyarrow as pa

    return pa.schema([("row", pa.int64()), ("descriptor", pa.list_(pa.float32(), dimensions))])


def state_schema() -> pa.Schema:
    """Of the table of states (`everplace.mapping.map_state`)."""
    import pyarrow as pa

    return pa.schema(
        [
            ("version", pa.int64()), ("created", pa.string()), ("document", pa.string()), ("arrays", pa.binary()),
            ("frames_version", pa.int64()), ("descriptors_version", pa.int64()),
        ]
    )  # fmt: skip


def arrow_table(rows: Mapping[str, Any], schema: pa.Schema) -> pa.Table:
    """A table of these columns; those of lists come as N×K arrays."""
    import pyarrow as pa

    columns = []
    for spec in schema:
        values = rows[spec.name]
        if isinstance(values, np.ndarray) and values.ndim == 2:
            flat = pa.array(np.ascontiguousarray(values).reshape(-1))
            columns.append(pa.FixedSizeListArray.from_arrays(flat, values.shape[1]).cast(spec.type))
        else:
            columns.append(pa.array(values, spec.type))
    return pa.Table.from_arrays(columns, schema=schema)


def as_matrix(column: pa.ChunkedArray) -> NDArray[Any]:
    """N×K of a column of lists of K numbers."""
    whole = column.combine_chunks()
    return np.asarray(whole.flatten()).reshape(len(whole), -1)
