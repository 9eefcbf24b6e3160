"""Loads a network from a repository that is published for torch.hub: consent, isolation, one clear error.

Such a repository is a program, and loading it runs it. So a repository on GitHub is used only after the user has named
it in EVERPLACE_TRUST_HUB once; from then on torch.hub's own list of trusted repositories holds it. Nothing is asked on
the terminal. A directory on this machine needs no consent beyond its name.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn

from everplace.errors import MethodError
from everplace.files import readable

__all__ = ["TRUST_VARIABLE", "HubRepository", "LoadedNetwork", "load_network", "parse_repository"]

TRUST_VARIABLE = "EVERPLACE_TRUST_HUB"
"""Environment variable with the repositories whose code may run: OWNER/REPO, several separated by commas."""

_GITHUB = re.compile(r"(?P<owner>[\w.-]+)/(?P<name>[\w.-]+)(:(?P<ref>[\w./-]+))?")
_DEFAULT_REFS = ("main", "master")  # torch.hub's order


@dataclass(frozen=True, slots=True)
class HubRepository:
    """Where a network's code lies.

    Attributes:
        label: `OWNER/REPO`, `OWNER/REPO:REF`, or the name of a directory.
        directory: The directory on this machine; None: on GitHub.
    """

    label: str
    directory: Path | None = None


@dataclass(frozen=True, slots=True)
class LoadedNetwork:
    """A network and what tells it from others.

    Attributes:
        network: The network.
        code: SHA-256 of the repository's source files that were used, in hex.
        weights: SHA-256 of all parameters and buffers, in hex.
    """

    network: nn.Module
    code: str
    weights: str


def parse_repository(text: str) -> HubRepository:
    """Reads `OWNER/REPO`, `OWNER/REPO:REF`, or a directory, which begins with `/`, `.` or `~`.

    Raises:
        MethodError: It is none of these, or the directory holds no hubconf.py.
    """
    if text.startswith((".", "~")) or os.path.isabs(text):  # noqa: PTH117 - any text, also such as is no path
        directory = Path(text).expanduser().resolve()
        if not (directory / "hubconf.py").is_file():
            raise MethodError(f"{readable(directory)} is no hub repository: it holds no hubconf.py; choose another")
        return HubRepository(directory.name, directory)
    if not _GITHUB.fullmatch(text):
        raise MethodError(
            f"{text!r} is no hub repository; write OWNER/REPO, OWNER/REPO:REF, or a directory such as ./REPO or /REPO"
        )
    return HubRepository(text)


def load_network(repository: HubRepository, entry: str, arguments: Mapping[str, object]) -> LoadedNetwork:
    """Calls an entry of a repository's hubconf.py. This runs the repository's code.

    What it prints goes to stderr, and its modules are forgotten afterwards, so that two repositories may have modules
    of the same name.

    Args:
        repository: The repository; one on GitHub is downloaded into torch.hub's cache at its first use.
        entry: The function in hubconf.py that returns the network.
        arguments: Its keyword arguments.

    Raises:
        MethodError: The repository is not trusted, cannot be loaded, or returns no network.
    """
    if repository.directory is None:
        _require_trust(repository.label)
    where = f"{entry} of {repository.label}"
    before = set(sys.modules)
    try:
        with _unattended():
            network = _load(repository, entry, arguments)
        code = _code_hash(repository, before)
    except (Exception, SystemExit) as error:
        raise MethodError(f"{where} cannot be loaded: {_reason(error, repository)}") from error
    finally:
        for name in _own_modules(repository, before):
            del sys.modules[name]
    if not isinstance(network, nn.Module):
        what = type(network).__name__
        raise MethodError(f"{where} is no network: it returned a {what}; name an entry that returns a torch module")
    return LoadedNetwork(network, code, _weights_hash(network))


def _load(repository: HubRepository, entry: str, arguments: Mapping[str, object]) -> object:
    # A cached repository is loaded as a directory: torch.hub would ask GitHub for its branch every time.
    directory = repository.directory or _cached(repository.label)
    if directory is not None:
        return torch.hub.load(str(directory), entry, source="local", **arguments)  # type: ignore[no-untyped-call]
    return torch.hub.load(  # type: ignore[no-untyped-call]
        repository.label, entry, source="github", trust_repo=True, verbose=False, **arguments
    )


def _require_trust(label: str) -> None:
    repository = label.partition(":")[0]
    entry = repository.replace("/", "_")
    trusted = Path(torch.hub.get_dir()) / "trusted_list"
    with contextlib.suppress(FileNotFoundError):
        if entry in trusted.read_text("utf-8").splitlines():
            return
    if repository not in os.environ.get(TRUST_VARIABLE, "").split(","):
        raise MethodError(
            f"hub:{label} would run code from https://github.com/{repository} on this machine; "
            f"if you trust it, say so once by {TRUST_VARIABLE}={repository} in the environment"
        )
    # torch.hub itself notes only what it downloads, not what lies in its cache already.
    trusted.parent.mkdir(parents=True, exist_ok=True)
    with trusted.open("a", encoding="utf-8") as file:
        file.write(f"{entry}\n")


def _cached(label: str) -> Path | None:
    """The directory of a repository in torch.hub's cache, if it is there."""
    repository, _, ref = label.partition(":")
    names = [ref.replace("/", "_")] if ref else _DEFAULT_REFS
    for name in names:
        directory = Path(torch.hub.get_dir()) / f"{repository.replace('/', '_')}_{name}"
        if directory.is_dir():
            return directory
    return None


@contextlib.contextmanager
def _unattended() -> Iterator[None]:
    """Sends what foreign code prints to stderr, and answers its questions with end of file."""
    stdin = sys.stdin
    sys.stdin = io.StringIO()
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        sys.stdin = stdin


def _own_modules(repository: HubRepository, before: set[str]) -> list[str]:
    """Names of the modules that came from the repository, or from one that it loaded itself."""
    roots = [Path(torch.hub.get_dir()).resolve(), *([repository.directory] if repository.directory else [])]
    own = []
    for name in sorted(set(sys.modules) - before):
        module = sys.modules[name]
        # A package without __init__.py has no file, but places where it looks for its modules.
        file = getattr(module, "__file__", None) or next(iter(getattr(module, "__path__", [])), None)
        # An environment of installed packages may lie inside a repository; these stay.
        if file and "site-packages" not in Path(file).parts and any(map(Path(file).resolve().is_relative_to, roots)):
            own.append(name)
    return own


def _code_hash(repository: HubRepository, before: set[str]) -> str:
    directory = repository.directory or _cached(repository.label)
    files = {"hubconf": directory / "hubconf.py"} if directory is not None else {}
    for name in _own_modules(repository, before):
        if file := getattr(sys.modules[name], "__file__", None):
            files[name] = Path(file)
    digest = hashlib.sha256()
    for name, path in sorted(files.items()):
        content = path.read_bytes()
        digest.update(f"{name} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


def _weights_hash(network: nn.Module) -> str:
    digest = hashlib.sha256()
    tensors = dict([*network.named_parameters(), *network.named_buffers()])
    for name, tensor in sorted(tensors.items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}\n".encode())
        digest.update(tensor.detach().cpu().contiguous().reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def _reason(error: BaseException, repository: HubRepository) -> str:
    """Says why loading failed, and what to do."""
    if isinstance(error, EOFError):
        return (
            "it asks a question, as torch.hub does for a second repository; load it once in Python with torch.hub.load "
            "and answer there"
        )
    listed = re.match(r"Missing dependencies: (.+)", str(error))
    missing = error.name if isinstance(error, ModuleNotFoundError) else listed[1] if listed else None
    if missing is not None:
        return f"it needs {missing}, not installed here; pip install {missing.replace(',', '')}"
    what = ": ".join([type(error).__name__, *str(error).strip().splitlines()[:1]])
    if repository.directory is None and _cached(repository.label) is None:
        return f"{what}; check the network, or clone the repository and give its directory"
    return f"{what}; see its hubconf.py for the entries and their arguments"
