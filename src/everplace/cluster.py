"""Work on the machines of a Ray cluster (Moritz et al. 2018), block by block."""

from __future__ import annotations

import importlib.util
import logging
import os
import pickle
import socket
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from everplace.errors import EverplaceError, MachineError, MissingExtraError

__all__ = ["map_on_cluster", "require_ray"]

T = TypeVar("T")
R = TypeVar("R")
_CONNECT_SECONDS = 10


def require_ray() -> None:
    """Raises MissingExtraError if Ray is not installed."""
    if importlib.util.find_spec("ray") is None:
        raise MissingExtraError("the engine ray", "ray")


def map_on_cluster(prepare: Callable[[], Callable[[T], R]], blocks: Iterable[T]) -> Iterator[R]:
    """Computes a result for every block, on as many workers as the cluster has processors.

    The cluster is the one that `RAY_ADDRESS` names, or one on this machine that ends with the process. A worker that
    dies is started anew, and its block with it.

    Args:
        prepare: Called once in every worker; what it returns is called with a block. All that it holds and that blocks
            and results hold is pickled.
        blocks: Read whole before anything is computed.

    Yields:
        The results, in the order of the blocks; few are held at a time.

    Raises:
        MissingExtraError: Ray is not installed.
        EverplaceError: What a block raises, as it does where it is called here.
        MachineError: The cluster cannot be reached, or it fails.
    """
    require_ray()
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # read while Ray is imported
    import ray
    import ray.data

    _require_reachable(os.environ.get("RAY_ADDRESS", ""))
    rows = [{"number": number, "block": pickle.dumps(block)} for number, block in enumerate(blocks)]
    if not rows:
        return
    try:
        if not ray.is_initialized():
            ray.init(include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
        context = ray.data.DataContext.get_current()
        context.execution_options.preserve_order = True
        context.enable_progress_bars = False
        logging.getLogger("ray.data").setLevel(logging.ERROR)
        workers = max(1, int(ray.cluster_resources().get("CPU", 1)))  # type: ignore[no-untyped-call]
        dataset = ray.data.from_items(rows, override_num_blocks=len(rows)).map_batches(
            _Worker, fn_constructor_args=(pickle.dumps(prepare),), batch_size=1, num_cpus=1, zero_copy_batch=True,
            compute=ray.data.ActorPoolStrategy(size=min(workers, len(rows))),
        )  # fmt: skip
        for row in dataset.iter_rows():
            yield _result(row["result"])
    except (ConnectionError, ray.exceptions.RayError) as error:
        raise MachineError(f"the Ray cluster failed: {str(error).strip().splitlines()[-1]}") from error


def _require_reachable(address: str) -> None:
    """Makes sure at once that somebody listens there; Ray itself tries for minutes, with words of its own."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal():
        return
    try:
        socket.create_connection((host, int(port)), timeout=_CONNECT_SECONDS).close()
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise MachineError(
            f"the Ray cluster at {address}, which RAY_ADDRESS names, cannot be reached ({reason}); start it, or "
            "unset RAY_ADDRESS to use this machine"
        ) from None


class _Worker:
    """Lives in a process of the cluster."""

    def __init__(self, prepare: bytes) -> None:
        self._prepare: Callable[[], Callable[[Any], Any]] = pickle.loads(prepare)
        self._work: Callable[[Any], Any] | None = None

    def __call__(self, batch: dict[str, Any]) -> dict[str, Any]:
        return {"number": batch["number"], "result": [pickle.dumps(self._computed(batch["block"][0]))]}

    def _computed(self, block: bytes) -> tuple[EverplaceError | None, Any, list[str]]:
        """What went wrong, the result, and warnings: for Ray an error is a failure of its own, with a long report."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                if self._work is None:
                    self._work = self._prepare()
                error, result = None, self._work(pickle.loads(block))
            except EverplaceError as failure:
                error, result = failure, None
        return error, result, [str(one.message) for one in caught if one.category is UserWarning]


def _result(data: bytes) -> Any:
    error, result, told = pickle.loads(data)
    for message in told:
        warnings.warn(message, stacklevel=2)
    if error is not None:
        raise error
    return result
