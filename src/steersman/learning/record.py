"""What a training writes about itself: progress.csv and TensorBoard events."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path as FilePath
from typing import Any

from steersman.files import write_text

COLUMNS = (
    "steps",
    "updates",
    "seconds",
    "reward_mean",
    "training_error_mm",
    "off_track_resets",
    "validation_error_mm",
    "validation_rms_mm",
    "validation_failures",
    "steer_activity",
    "actor_loss",
    "critic_loss",
    "q_mean",
    "c_track",
    "c_diff",
    "demo_share",
    "saturated_share",
    "learning_rate",
)


class Record:
    """A row for each validation, in ``progress.csv`` and in ``tensorboard/``."""

    def __init__(
        self, out: FilePath, resumed_at: int | None, columns: Sequence[str] = COLUMNS
    ) -> None:
        """Begin, or go on after ``resumed_at`` steps: later events of before count no more."""
        from torch.utils.tensorboard import SummaryWriter

        self.rows: list[dict[str, float]] = []
        self._file = out / "progress.csv"
        self._columns = columns
        purge = None if resumed_at is None else resumed_at + 1
        writer: Any = SummaryWriter
        self._writer = writer(str(out / "tensorboard"), purge_step=purge)

    def add(self, row: dict[str, float]) -> None:
        """One more row, written at once."""
        self.rows.append(row)
        self._write()
        for name, value in row.items():
            if math.isfinite(value):
                self._writer.add_scalar(f"train/{name}", value, int(row["steps"]))

    def restore(self, rows: Iterable[dict[str, float]]) -> None:
        """Go on from these rows, and forget what came after them."""
        self.rows[:] = rows
        if self.rows:
            self._write()
        else:
            self._file.unlink(missing_ok=True)

    def flush(self) -> None:
        """Bring TensorBoard's events to disk."""
        self._writer.flush()

    def close(self) -> None:
        """Close TensorBoard's file."""
        self._writer.close()

    def _write(self) -> None:
        text = io.StringIO()
        table = csv.DictWriter(text, self._columns, lineterminator="\n")
        table.writeheader()
        table.writerows({k: f"{v:.8g}" for k, v in row.items()} for row in self.rows)
        write_text(self._file, text.getvalue())
