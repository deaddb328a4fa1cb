"""Draw docs/images/demo.png from results/demo/table.json: errors and steering at equal speeds."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt

HERE = Path(__file__).resolve().parent
TABLE = HERE.parents[1] / "results" / "demo" / "table.json"
# Okabe and Ito's colours, which colour-blind eyes tell apart; and how each driver is drawn.
STYLES = {
    "paper's agent": ("#D55E00", "s", "paper's agent (CARLA)"),
    "MPC-PID": ("#777777", "^", "MPC-PID, tuned at 30 km/h"),
    "MPC-PID sched.": ("#0072B2", "D", "MPC-PID, a model for each speed"),
    "mpc_delay est.": ("#CC79A7", "v", "mpc_delay behind the estimator"),
    "agent": ("#009E73", "o", "Steersman's agent"),
}
# Of the axis: errors of the oracle are no more than rounding.
LEAST_MM = 1e-3


def main() -> None:
    """Draw the two panels."""
    rows = json.loads(TABLE.read_text(encoding="utf-8"))["rows"]
    rows = [r for r in rows if r["test"].endswith("m/s")]
    mpl.rcParams.update({"font.size": 11, "axes.spines.top": False, "axes.spines.right": False})
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    for driver, (colour, marker, label) in STYLES.items():
        mine = [r for r in rows if r["driver"] == driver]
        rolled = "" if all(r["completed"] for r in mine) else " (open marks: left the road)"
        speeds = [float(r["test"].split(", ")[1].split()[0]) for r in mine]
        for axis, key in ((left, "ale_mm"), (right, "steer_std")):
            values = [r[key] for r in mine]
            axis.plot(speeds, values, "-", color=colour, lw=1)
            for row, speed in zip(mine, speeds, strict=True):
                fill = colour if row["completed"] else "white"
                axis.plot(speed, row[key], marker, color=colour, mfc=fill, ms=8)
            axis.plot([], [], "-", marker=marker, color=colour, label=label + rolled, ms=8)
    oracle = max(r["ale_mm"] for r in rows if r["driver"] == "oracle")
    left.set(yscale="log", xlabel="speed [m/s]", ylabel="mean |lateral error| [mm]")
    left.set_ylim(bottom=LEAST_MM)
    below = f"oracle: at most {oracle:.0e} mm, below the axis"
    left.text(0.98, 0.03, below, transform=left.transAxes, fontsize=10, ha="right")
    right.set(yscale="log", xlabel="speed [m/s]", ylabel="SD of normalised steering")
    left.set_title("Circle of radius 50 m, 60 s", loc="left")
    right.set_title("Steering that should be constant", loc="left")
    for axis in (left, right):
        axis.grid(which="major", alpha=0.3)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.savefig(HERE / "demo.png", dpi=130)


if __name__ == "__main__":
    main()
