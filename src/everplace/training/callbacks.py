"""What happens around the steps: measuring, keeping the best epoch, saving what resuming needs, showing progress."""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

import lightning
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from everplace.model.bounds import Weights
from everplace.model.checkpoint import save_checkpoint
from everplace.model.provenance import HELD_OUT_STEMS, TRAINED_STEMS
from everplace.training.config import TrainConfig
from everplace.training.frames import SplitRoute
from everplace.training.metrics_table import MetricsTable
from everplace.training.module import BoundModule
from everplace.training.resume_state import RunProgress, save_state
from everplace.training.validation import criterion_name, validate

__all__ = ["CollapseWarning", "RunKeeper", "TrainingDisplay"]

_ALIVE_NATS = 0.5


class CollapseWarning(UserWarning):
    """A block of the latent holds next to nothing."""


class RunKeeper(lightning.Callback):
    """Writes the run directory at the end of each epoch.

    Attributes:
        progress: How far the run has come.
    """

    def __init__(
        self,
        run: Path,
        config: TrainConfig,
        split: SplitRoute,
        images: str,
        progress: RunProgress,
        save_every: float,
    ) -> None:
        self.progress = progress
        self.latest: dict[str, float] = {}
        self._run = run
        self._config = config
        self._split = split
        self._images = images
        self._table: MetricsTable | None = None
        self._save_every = save_every
        self._saved = time.monotonic()
        self._warned: set[str] = set()

    def on_train_epoch_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Measures, keeps the best epoch so far, and saves the state now and then."""
        assert isinstance(pl_module, BoundModule)
        epoch = pl_module.epoch + 1
        # No later loss would tell of what the epoch's last step did.
        pl_module.require_finite({**pl_module.model.state_dict(), **pl_module.remedies.state_dict()})
        row = {"epoch": float(epoch), "seconds": pl_module.seconds, **pl_module.epoch_means()}
        last = trainer.should_stop or epoch == self._config.epochs
        if epoch % self._config.validate_every == 0 or last:
            weights = Weights(**self._config.weights.model_dump())
            measured = validate(pl_module.model, self._split, self._config.tolerance, weights)
            pl_module.require_finite(measured)
            row |= measured
        self.latest = row
        self.progress = self.progress.model_copy(update={"epoch": epoch, "seconds": row["seconds"]})
        if trainer.is_global_zero:
            self._warn_of_collapse(row, last=last)
            self._keep(trainer, pl_module, row)
        self.progress = trainer.strategy.broadcast(self.progress)
        pl_module.has_checkpoint = self.progress.best_epoch > 0

    def _keep(self, trainer: lightning.Trainer, module: BoundModule, row: dict[str, float]) -> None:
        criterion = criterion_name(self._split, self._config)
        value = row.get(criterion)
        # At equal recall the later epoch is kept: it has been trained for longer.
        if value is not None and (self.progress.best_value is None or value >= self.progress.best_value):
            self.progress = self.progress.model_copy(update={"best_epoch": self.progress.epoch, "best_value": value})
            about = {
                "recipe": self._config.recipe,
                "remedies": ", ".join(self._config.remedies_in_use()),
                "seed": self._config.seed,
                "epoch": self.progress.epoch,
                "criterion": criterion,
                "value": value,
                "images": self._images,
                TRAINED_STEMS: self._split.trained_stems,
                HELD_OUT_STEMS: self._split.held_out_stems,
            }
            save_checkpoint(self._run, module.model, about)
        if self._table is None:
            self._table = MetricsTable(self._run, keep_epochs=module.first_epoch)
        self._table.append(row)
        for logger in trainer.loggers:
            logger.log_metrics(row, step=self.progress.epoch)
        if time.monotonic() - self._saved >= self._save_every:
            optimizer = trainer.optimizers[0]
            save_state(self._run, self.progress, module.model, optimizer, self._images, module.remedies)
            self._saved = time.monotonic()

    def _warn_of_collapse(self, row: dict[str, float], *, last: bool) -> None:
        # While the weight of the divergence rises a block may still come to life, unless training ends before.
        warming_up = row["epoch"] <= self._config.warmup_epochs and not last
        if warming_up or self._config.model == "cae":
            return
        # What holds a block up: the label that is read from it, or else the image.
        support = {
            "place": "weights.place" if "place" in row else "weights.image",
            "condition": "weights.condition" if "condition" in row else "weights.image",
        }
        if "contrastive" in row:
            support["place"] = "remedies.contrastive"
        for symbol, block in (("z_p", "place"), ("z_c", "condition")):
            if row[f"kl_{block}"] < _ALIVE_NATS and symbol not in self._warned:
                self._warned.add(symbol)
                warnings.warn(
                    f"{symbol} has collapsed in epoch {row['epoch']:.0f}: its KL divergence is "
                    f"{row[f'kl_{block}']:.2f} nats with {row[f'active_{block}']:.0f} active dimensions; try a "
                    f"lower weights.beta_{block}, a longer warmup_epochs or a higher {support[block]}",
                    CollapseWarning,
                    stacklevel=2,
                )


class TrainingDisplay(lightning.Callback):
    """Shows training on stderr: a bar for a person at a terminal, a line an epoch for a log file."""

    def __init__(self, keeper: RunKeeper, config: TrainConfig, name: str = "") -> None:
        """Shows a run.

        Args:
            keeper: What measures it.
            config: Its configuration.
            name: What it is called, where several are trained one after the other.
        """
        self._keeper = keeper
        self._prefix = f"{name}: " if name else ""
        self._config = config
        self._console = Console(file=sys.stderr)
        self._bar: Progress | None = None
        self._task: TaskID | None = None

    def on_train_start(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Opens the bar, if a person is there to see it."""
        if not trainer.is_global_zero or not self._console.is_terminal:
            return
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
            TextColumn("{task.fields[terms]}"), console=self._console,
        )  # fmt: skip
        self._task = self._bar.add_task(f"{self._prefix}epoch 1", total=int(trainer.num_training_batches), terms="")
        self._bar.start()

    def on_train_epoch_start(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Begins the bar of an epoch."""
        if self._bar is not None and self._task is not None and isinstance(pl_module, BoundModule):
            of = f"/{self._config.epochs}" if self._config.epochs else ""
            self._bar.reset(self._task, description=f"{self._prefix}epoch {pl_module.epoch + 1}{of}")

    def on_train_batch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule, *args: object
    ) -> None:
        """Moves the bar."""
        if self._bar is not None and self._task is not None:
            self._bar.advance(self._task)

    def on_train_epoch_end(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule) -> None:
        """Shows the terms of the bound and the held-out recall."""
        if not trainer.is_global_zero:
            return
        row = self._keeper.latest
        terms = self._terms(row)
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, terms=terms)
        else:
            self._console.print(
                f"{self._prefix}epoch {row['epoch']:.0f} ({row['seconds']:.0f} s): {terms}", soft_wrap=True
            )

    def teardown(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule, stage: str) -> None:
        """Closes the bar, also when training ends by an error."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def on_exception(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule, exception: BaseException
    ) -> None:
        """Closes the bar."""
        self.teardown(trainer, pl_module, "fit")

    @staticmethod
    def _terms(row: dict[str, float]) -> str:
        shown = {
            "bound": "bound", "image": "log p(x|z)", "place": "log p(p|z_p)", "contrastive": "contrastive",
            "condition": "log p(c|z_c)", "adversary": "adversary's log p(c|z_p)", "swap": "log p(x|swapped z)",
            "kl_place": "KL z_p", "kl_condition": "KL z_c", "kl_conditional": "KL z_c given c",
            "free_place": "free bits z_p", "free_condition": "free bits z_c", "active_place": "active z_p",
            "active_condition": "active z_c", "held_out_recall_at_1": "held-out recall@1",
        }  # fmt: skip
        return "  ".join(f"{label} {row[name]:.4g}" for name, label in shown.items() if name in row)
