"""Writes the run directory at the end of each epoch: the best checkpoint, metrics.csv, what resuming needs."""

from __future__ import annotations

import time
import warnings
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import torch

from everplace.model.checkpoint import save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.posterior import BLOCKS
from everplace.model.provenance import HELD_OUT_STEMS, SEEN_IMAGES, TRAINED_STEMS
from everplace.training.config import TrainConfig
from everplace.training.frames import SplitRoute
from everplace.training.metrics_table import MetricsTable
from everplace.training.resume_state import RunProgress, save_state
from everplace.training.validation import criterion_name

__all__ = ["CollapseWarning", "RunKeeper"]

_ALIVE_NATS = 0.5


class CollapseWarning(UserWarning):
    """A block of the latent holds next to nothing."""


class RunKeeper:
    """Keeps a run on disk.

    Attributes:
        progress: How far the run has come.
    """

    def __init__(
        self,
        out: Path,
        config: TrainConfig,
        split: SplitRoute,
        images: str,
        seen: list[str],
        progress: RunProgress,
        save_every: float,
    ) -> None:
        """Opens what an earlier process of the run has left.

        Args:
            out: The run directory.
            config: The run's configuration.
            split: The frames that are trained on and held out.
            images: Fingerprint of the images.
            seen: What `everplace.training.seen_images` says of them.
            progress: How far the run is.
            save_every: At most so many seconds pass (and one epoch) between two states to resume from.
        """
        self.progress = progress
        self._out = out
        self._config = config
        self._criterion = criterion_name(split, config)
        self._images = images
        self._about = {
            "recipe": config.recipe,
            "remedies": ", ".join(config.remedies_in_use()),
            "seed": config.seed,
            "criterion": self._criterion,
            "images": images,
            TRAINED_STEMS: split.trained_stems,
            HELD_OUT_STEMS: split.held_out_stems,
            SEEN_IMAGES: seen,
        }
        self._table = MetricsTable(out, keep_epochs=progress.epoch)
        self._save_every = save_every
        self._saved = time.monotonic()
        self._collapsed: set[str] = set()
        self._writer: Any = None

    def keep(self, model: ConditionVAE, optimizer: torch.optim.Optimizer, row: dict[str, float], *, last: bool) -> None:
        """Keeps an epoch: its row of metrics.csv, the checkpoint if it is the best so far, the state now and then.

        Args:
            model: The network as it stands.
            optimizer: Its optimizer.
            row: What was measured.
            last: Whether training ends here.

        Raises:
            StorageError: The run directory cannot be written to.
        """
        epoch = int(row["epoch"])
        self.progress = self.progress.model_copy(update={"epoch": epoch, "seconds": row["seconds"]})
        self._warn_of_collapse(row, last=last)
        value = row.get(self._criterion)
        # At equal recall the later epoch is kept: it has been trained for longer.
        if value is not None and (self.progress.best_value is None or value >= self.progress.best_value):
            self.progress = self.progress.model_copy(update={"best_epoch": epoch, "best_value": value})
            save_checkpoint(self._out, model, {**self._about, "epoch": epoch, "value": value})
        self._table.append(row)
        self._log(row)
        if time.monotonic() - self._saved >= self._save_every:
            save_state(self._out, self.progress, model, optimizer, self._images)
            self._saved = time.monotonic()

    def _log(self, row: dict[str, float]) -> None:
        """Logs a row for TensorBoard, where it is installed."""
        if find_spec("tensorboard") is None:
            return
        if self._writer is None:
            from torch.utils.tensorboard import SummaryWriter

            self._writer = SummaryWriter(str(self._out / "tensorboard"))
        for name, value in row.items():
            self._writer.add_scalar(name, value, int(row["epoch"]))
        self._writer.flush()

    def finish(self) -> None:
        """Marks the run finished, and drops what only resuming needs."""
        save_state(self._out, self.progress.model_copy(update={"finished": True}), None, None, self._images)

    def _warn_of_collapse(self, row: dict[str, float], *, last: bool) -> None:
        # While the weight of the divergence rises a block may still come to life, unless training ends before.
        warming_up = row["epoch"] <= self._config.warmup_epochs and not last
        if warming_up or self._config.model == "cae":
            return
        for block, symbol in BLOCKS.items():
            if row[f"kl_{block}"] < _ALIVE_NATS and block not in self._collapsed:
                self._collapsed.add(block)
                # What holds a block up: the label that is read from it, or else the image.
                support = block if block in row else "image"
                warnings.warn(
                    f"{symbol} has collapsed in epoch {row['epoch']:.0f}: its KL divergence is "
                    f"{row[f'kl_{block}']:.2f} nats with {row[f'active_{block}']:.0f} active dimensions; try a "
                    f"lower weights.beta_{block}, a longer warmup_epochs or a higher weights.{support}",
                    CollapseWarning,
                    stacklevel=2,
                )
