"""How much of a benchmark's pooled error its lost drives are, and what the usual drive has.

    python benchmarks/lost_drives.py runs/bench --out results/bench/mpc_delay_null/lost_drives.json

Reads the rows of ``steersman bench`` and drives nothing. A drive that ends early is charged the
corridor's half width, and squares weigh it above all others: this tells the pooled error with and
without such drives, and medians over the scenarios, which they hardly move.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from steersman.bench.suite import CLEAN
from steersman.files import write_text


def figures(rows: list[dict]) -> dict[str, float | int]:
    """Of one controller; errors in mm, steering in thousandths of its range per step."""
    error = 1e3 * np.array([row["charged_rms_m"] for row in rows])
    lost = np.array([not row["completed"] for row in rows])
    clean = np.array([row["disturbance"] == CLEAN for row in rows])
    steer = 1e3 * np.array([row["steer_change_rms"] for row in rows])
    square = error**2
    found = {
        "scenarios": len(rows),
        "lost": int(lost.sum()),
        "lost_share_of_squared_error": square[lost].sum() / square.sum(),
        "rms_mm": np.sqrt(square.mean()),
        "rms_of_finished_mm": np.sqrt(square[~lost].mean()),
        "median_clean_mm": np.median(error[clean]),
        "median_disturbed_mm": np.median(error[~clean]),
        "rms_steer_change": np.sqrt(np.mean(steer**2)),
        "median_steer_change": np.median(steer),
    }
    return {k: v if isinstance(v, int) else float(f"{v:.4g}") for k, v in found.items()}


def main() -> None:
    """Read the rows and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", help="of a benchmark, with rows.jsonl")
    parser.add_argument("--out", required=True)
    given = parser.parse_args()
    lines = (Path(given.folder) / "rows.jsonl").read_text(encoding="utf-8").splitlines()
    by: dict[str, list[dict]] = {}
    for line in lines:
        row = json.loads(line)
        by.setdefault(row["controller"], []).append(row)
    commits = sorted({str(row["commit"]) for rows in by.values() for row in rows})
    found = {"made_by": commits, "controllers": {name: figures(r) for name, r in by.items()}}
    write_text(Path(given.out), json.dumps(found, indent=1, allow_nan=False) + "\n")


if __name__ == "__main__":
    main()
