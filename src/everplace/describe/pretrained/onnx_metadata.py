"""The provenance of an exported network, how its run was trained, in the ONNX file's own metadata.

Without it a network that was trained on the tested places could not be told from one that was not.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from everplace.errors import MethodError
from everplace.files import readable

__all__ = ["read_provenance", "write_metadata"]

_KEY = "everplace.about"


def write_metadata(network: Path, about: Mapping[str, Any], identity: Mapping[str, str]) -> None:
    """Adds metadata to an ONNX file.

    Args:
        network: The file.
        about: How it was trained (see `everplace.model.provenance`).
        identity: What a program without everplace has to know, such as "image_size"; as `everplace.image_size`.
    """
    import onnx

    model = onnx.load(str(network))
    told = {_KEY: json.dumps(about, ensure_ascii=False)} | {
        f"everplace.{name}": text for name, text in identity.items()
    }
    for key, value in told.items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, value
    onnx.save(model, str(network))


def read_provenance(network: Path, metadata: Mapping[str, str]) -> dict[str, Any]:
    """Reads it back; empty for a network that was exported by something else.

    Args:
        network: The ONNX file, for the message.
        metadata: Its own key and value pairs.

    Raises:
        MethodError: The entry is not what `write_metadata` writes.
    """
    try:
        about = json.loads(metadata.get(_KEY, "{}"))
    except (ValueError, RecursionError):
        about = None
    if not isinstance(about, dict):
        raise MethodError(f"what {readable(network)} says of its making ({_KEY}) is damaged; export the run again")
    return about
