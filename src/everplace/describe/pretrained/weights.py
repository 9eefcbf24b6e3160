"""Weight files of pretrained networks: where they lie, how they are fetched, checked and loaded.

A file is loaded with `weights_only=True`, so none of its code runs. Its layout is checked before anything is
computed, and its SHA-256 becomes a setting of the method: descriptors of different weights are not compared.
"""

from __future__ import annotations

import pickle
import re
import tarfile
import warnings
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from everplace.downloads import fetch, sha256_of
from everplace.errors import DownloadError, MethodError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer
from everplace.progress import Progress, quiet
from everplace.route.pack import default_cache

__all__ = ["PublishedWeights", "fetch_weights", "load_weights", "weight_file"]

# What torch.load raises for a file that is damaged, foreign, or would run code.
_UNLOADABLE = (pickle.UnpicklingError, RuntimeError, EOFError, ValueError, TypeError, LookupError, AttributeError)


@dataclass(frozen=True, slots=True)
class PublishedWeights:
    """A weight file that the makers of a network publish.

    Attributes:
        network: The network's name, for people.
        url: Where it is published.
        sha256: Of the file, in hex; torch names its files by the first eight digits.
        megabytes: Size of the file.
    """

    network: str
    url: str
    sha256: str
    megabytes: int

    @property
    def path(self) -> Path:
        """Where the file is kept: `weights` in $EVERPLACE_CACHE, or else in the user's cache directory."""
        return default_cache().with_name("weights") / self.url.rpartition("/")[2]


def weight_file(argument: str, published: PublishedWeights) -> Path:
    """Returns the file that a user named, or that of the published weights in the cache.

    Raises:
        MethodError: The published weights are not in the cache; the message says how to get them.
    """
    if argument:
        return Path(argument).expanduser()
    if not published.path.is_file():
        raise MethodError(
            f"{published.network} needs its published weights: download {published.url} ({published.megabytes} MB) "
            f"and put it at {readable(published.path)}"
        )
    return published.path


def fetch_weights(published: PublishedWeights, progress: Progress = quiet) -> None:
    """Downloads published weights into the cache, unless they lie there; a broken download is continued.

    Args:
        published: Which.
        progress: Told of the pieces that have come.

    Raises:
        MethodError: The network fails, or sends another file; the message says how to get the file otherwise.
        StorageError: The cache cannot be written to.
    """
    try:
        fetch(published.url, published.sha256, published.path, progress)
    except DownloadError as error:
        raise MethodError(
            f"{published.network} needs its published weights: {error}; or fetch the file elsewhere "
            f"({published.megabytes} MB) and put it at {readable(published.path)}"
        ) from error


def load_weights(path: Path, network: nn.Module, name: str) -> str:
    """Fills a network from a file of weights.

    Args:
        path: A state dict as `torch.save` writes it. Further tensors in it are left aside. A name that ends in
            "-<hex digits>.pth" states the beginning of the file's SHA-256, as torch's own do, and is held to it.
        network: Has the same keys as the file; may be on the meta device.
        name: The network's name, for people.

    Returns:
        The file's SHA-256 in hex.

    Raises:
        MethodError: The file is missing, damaged, would run code when loaded, or holds another network.
    """
    if not path.is_file():
        raise MethodError(f"there is no weight file {readable(path)}; give the path of {name}'s .pth file")
    try:
        digest = sha256_of(path)
        stated = re.search(r"-([0-9a-f]{8,64})\.pth$", path.name)
        if stated is not None and not digest.startswith(stated[1]):
            raise MethodError(
                f"{readable(path)} is damaged: its SHA-256 begins with {digest[:8]} and not with {stated[1]} as its "
                "name says; fetch it again"
            )
        tensors = _read(path)
    except OSError as error:
        raise MethodError(f"cannot read {readable(path)}: {error.strerror or error}; check its permissions") from error
    except _UNLOADABLE as error:
        raise MethodError(
            f"{readable(path)} is refused: it is damaged, or holds other things than tensors, which could run code; "
            f"give the official weight file of {name}"
        ) from error
    wanted = network.state_dict()
    for key, value in wanted.items():
        found = tensors.get(key)
        if not isinstance(found, Tensor) or found.shape != value.shape or not found.is_floating_point():
            has = f"has shape {tuple(found.shape)}" if isinstance(found, Tensor) else "is missing"
            raise MethodError(
                f"{readable(path)} holds no weights of {name}: {key} {has}, wanted {tuple(value.shape)}; "
                "give the official file, or one of the same layout"
            )
    # Copies: the file is memory-mapped, and must be free to change or go once its numbers are taken.
    network.load_state_dict({key: tensors[key].to(torch.float32, copy=True) for key in wanted}, assign=True)
    return digest


def _read(path: Path) -> Mapping[str, Tensor]:
    refuse_pointer(path, MethodError)
    if tarfile.is_tarfile(path):  # torch before 2.6 ran code from these, whatever it was told
        raise pickle.UnpicklingError("a tar file")
    with warnings.catch_warnings():  # about oddities of files that are refused in the end, or are well
        warnings.simplefilter("ignore")
        found = torch.load(path, map_location="cpu", weights_only=True, mmap=zipfile.is_zipfile(path))
    if not isinstance(found, Mapping):
        raise pickle.UnpicklingError("no state dict")
    return found
