"""Drives on the simulator and on the multi-body car, side by side.

    python benchmarks/second_opinion.py --out results/second_opinion

The same car, controllers, roads and speeds on both plants; ``record.json`` and, for
docs/second_opinion.md, ``table.md``.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import steersman as sm
from steersman.files import make_folder, write_text

CONTROLLERS = ("tuned/lqr", "tuned/pid_feedforward", "tuned/mpc_delay")
# Speed [m/s] on each road, before the cap in bends.
SPEEDS = {
    "training_circuit": 14.0,
    "figure_eight": 10.0,
    "circle": 12.7,
    "double_lane_change": 15.0,
}
PLANTS = ("simulator", "multibody")
WORDS = ("vehicle=bmw_320i", "speed=constant_speed", "speed.a_lat_max=3", "duration=60")


def driven(controller: str, path: str, plant: str) -> dict[str, float | str | bool]:
    """What is kept of a drive."""
    words = (*WORDS, f"path={path}", f"plant={plant}", f"speed.speed={SPEEDS[path]}")
    episode = sm.drive(sm.configure("drive", controller, *words))
    error = sm.summarise(episode)["rms_lateral_error_m"]
    return {
        "controller": controller,
        "path": path,
        "plant": plant,
        "rms_mm": float(f"{1e3 * error:.4g}"),
        "end": episode.end,
        "completed": episode.completed,
    }


def table(rows: list[dict[str, float | str | bool]]) -> str:
    """RMS errors [mm], on the simulator and on the multi-body car."""
    titles = ["controller", *(path.replace("_", " ") for path in SPEEDS)]
    lines = [f"| {' | '.join(titles)} |", f"|---|{'---:|' * len(SPEEDS)}"]
    for controller in CONTROLLERS:
        cells = [
            ", ".join(
                f"{row['rms_mm']:.3g}{'' if row['completed'] else ' (lost)'}"
                for row in rows
                if (row["controller"], row["path"]) == (controller, path)
            )
            for path in SPEEDS
        ]
        lines.append(f"| `{controller}` | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Drive, and write both files."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    out = make_folder(parser.parse_args().out)
    rows = [driven(c, path, plant) for c in CONTROLLERS for path in SPEEDS for plant in PLANTS]
    made = {**sm.provenance(), "words": WORDS, "speeds": SPEEDS, "rows": rows}
    write_text(out / "record.json", json.dumps(made, indent=1, allow_nan=False) + "\n")
    write_text(out / "table.md", table(rows))


if __name__ == "__main__":
    main()
