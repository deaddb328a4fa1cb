"""Behind a car ahead: gap and jerk of each controller that a benchmark drove on the suite ``acc``.

    steersman bench acc --controllers textbook.yaml,tuned=time_gap --out runs/acc
    python benchmarks/following.py runs/acc --out results/acc

Means over the traces with their 95 % intervals (a bootstrap over traces and seeds), collisions and
the least gap of all drives; ``following.json`` and, to read, ``following.md``. A drive that ended
early counts with what it drove, beside the number of those.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from steersman.bench.statistics import Clusters
from steersman.files import make_folder, write_text

FIGURES = {
    "rms_gap_error_m": "gap error, RMS [m]",
    "rms_time_gap_error_s": "time gap error, RMS [s]",
    "rms_longitudinal_jerk_m_s3": "jerk, RMS [m/s^3]",
}


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The figures of one controller."""
    clusters = Clusters([row["path"] for row in rows], [row["replicate"] for row in rows])
    means = {}
    for name in FIGURES:
        values = [row[name] for row in rows]
        found = clusters.interval(lambda mean, values=values: mean(values))
        means[name] = [float(f"{each:.4g}") for each in found]
    return {
        "drives": len(rows),
        "collisions": sum(bool(row["collided"]) for row in rows),
        "ended_early": sum(row["driven_share"] < 1.0 for row in rows),
        "least_gap_m": round(min(row["least_gap_m"] for row in rows), 3),
        **means,
        "by_trace": {row["path"]: [float(f"{row[k]:.4g}") for k in FIGURES] for row in rows},
    }


def table(found: dict[str, Any]) -> str:
    """The figures as a table."""
    titles = ["", "collisions", "ended early", "least gap [m]", *FIGURES.values()]
    lines = [f"| {' | '.join(titles)} |", f"|{'---|' * len(titles)}"]
    for name, row in found.items():
        cells = [
            f"`{name}`",
            *(f"{row[key]} of {row['drives']}" for key in ("collisions", "ended_early")),
            f"{row['least_gap_m']:.2f}",
            *("{:.3g} [{:.3g}, {:.3g}]".format(*row[key]) for key in FIGURES),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Read a benchmark's rows, and write both files."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("bench", type=Path, help="folder of steersman bench")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    text = (given.bench / "rows.jsonl").read_text(encoding="utf-8")
    rows = [json.loads(line) for line in text.splitlines()]
    names = list(
        json.loads((given.bench / "results.json").read_text(encoding="utf-8"))["controllers"]
    )
    names = list(dict.fromkeys(name.split(",")[0] for name in names))
    found = {name: summary([r for r in rows if r["controller"] == name]) for name in names}
    made = {"commit": sorted({row["commit"] for row in rows}), "controllers": found}
    make_folder(given.out)
    write_text(given.out / "following.json", json.dumps(made, indent=1, allow_nan=False) + "\n")
    write_text(given.out / "following.md", table(found))


if __name__ == "__main__":
    main()
