"""The main job from end to end: train, drive what was never seen, compare."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from steersman.config import build
from steersman.episode import Episode
from steersman.files import make_folder, write_text
from steersman.metrics.base import summarise
from steersman.provenance import provenance
from steersman.rollout import RunConfig, attempt


class PaperDrive(NamedTuple):
    """A row of the paper's table: its agent on the circle of radius 50 m at one throttle."""

    throttle: float
    ale_mm: float
    """Mean lateral error [mm]."""
    aoe_deg: float
    """Mean orientation error [deg]."""
    steer_std: float
    """Standard deviation of normalised steering."""
    speed: float
    """Test speed of the same row [m/s]: a convention, the paper gives none (docs/paper.md)."""


PAPER_CIRCLE = (
    PaperDrive(0.4, 2.83, 0.922, 0.110, 9.9),
    PaperDrive(0.6, 47.1, 2.12, 0.137, 18.7),
    PaperDrive(0.8, 85.3, 3.87, 0.139, 22.2),
    PaperDrive(1.0, 104.0, 5.01, 0.138, 24.2),
)


class Test(NamedTuple):
    """A drive on a path that training never saw, and what the paper found there."""

    name: str
    config: dict[str, Any]
    ale_mm: float | None = None
    """The paper's mean lateral error [mm]."""
    aoe_deg: float | None = None
    """The paper's mean orientation error [deg]."""
    steer_std: float | None = None
    """The paper's standard deviation of normalised steering."""


_CIRCLE = {"kind": "circle", "radius": 50.0}
COLUMNS = {
    "test": "test",
    "driver": "driver",
    "ale_mm": "mean |d| [mm]",
    "steady_ale_mm": "last half [mm]",
    "max_mm": "max |d| [mm]",
    "steer_std": "SD of steering",
    "aoe_deg": "heading error [deg]",
    "speed": "mean speed [m/s]",
    "a_y": "max |a_y| [m/s^2]",
    "time_us": "control time p50 [us]",
    "end": "ended by",
}
DECIMALS = {
    **dict.fromkeys(("ale_mm", "steady_ale_mm", "aoe_deg"), 2),
    **dict.fromkeys(("max_mm", "speed", "a_y", "time_us"), 1),
    "steer_std": 4,
}
TITLE = (
    "Agent, MPC-PID, the best classical controller and the oracle on roads that none was trained "
    "or tuned on, beside the paper's agent"
)
AGENT, MPC_PID, SCHEDULED, PAPER = "agent", "MPC-PID", "MPC-PID sched.", "paper's agent"
ORACLE = "oracle"
"""The best steering for the true plant, its future known (:mod:`steersman.bench.oracle`)."""
# The least error of the classical controllers of results/bench in a typical scenario.
BEST = "mpc_delay est."
HEADERS = {
    AGENT: "agent",
    MPC_PID: "demonstrator: MPC-PID",
    SCHEDULED: "MPC-PID, a model for each speed",
    BEST: "best classical: mpc_delay with estimator",
    ORACLE: "oracle, knows the future",
    PAPER: "paper's agent",
}
"""Drivers as the columns of the table of errors."""
ERRORS_TITLE = "Mean lateral error [mm] on roads that none was trained or tuned on"


def tests() -> list[Test]:
    """The circle of radius 50 m at the paper's throttles and at equal speeds, and Monza."""
    out = [
        Test(
            f"R50, throttle {throttle}",
            {
                "path": _CIRCLE,
                "speed": {"kind": "constant_throttle", "throttle": throttle},
                "duration": 60.0,
            },
            *paper,
        )
        for throttle, *paper, _ in PAPER_CIRCLE
    ]
    out += [
        Test(
            f"R50, {speed} m/s",
            {
                "path": _CIRCLE,
                "speed": {"kind": "constant_speed", "speed": speed},
                "duration": 60.0,
            },
            *paper,
        )
        for _, *paper, speed in PAPER_CIRCLE
    ]
    monza = {"kind": "constant_throttle", "throttle": 0.4}
    out.append(Test("Monza, throttle 0.4", {"path": {"kind": "monza"}, "speed": monza, "laps": 1}))
    return out


def drive_tests(
    policy: FilePath, out: FilePath, progress: Callable[[str], None] | None = None
) -> list[dict[str, Any]]:
    """Drive every test with the policy, three classical controllers and the oracle.

    Returns the rows of the table.

    Writes ``episodes/<test>/<controller>.npz``, ``table.json``, ``table.md`` and
    ``table_errors.json``, the errors with a column for each driver, into ``out``.
    """
    controllers: dict[str, dict[str, Any]] = {
        AGENT: {"kind": "policy", "file": str(policy)},
        MPC_PID: {"kind": "mpc_pid"},
        SCHEDULED: {"kind": "mpc_pid", "scheduled": True},
        BEST: {"kind": "estimated/tuned/mpc_delay"},
    }
    rows: list[dict[str, Any]] = []
    for test in tests():
        drives = {
            name: build(RunConfig, test.config | {"controller": controller})
            for name, controller in controllers.items()
        }
        for name in (*drives, ORACLE):
            if progress is not None:
                progress(f"{test.name}: {name}")
            if name == ORACLE:
                episode = _oracle(drives[AGENT], drives[BEST])
            else:
                episode = attempt(drives[name]).of_controller()
            folder = make_folder(out / "episodes" / _slug(test.name))
            episode.save(folder / f"{_slug(name)}.npz")
            rows.append(_row(test, name, episode))
        if test.ale_mm is not None:
            rows.append(_paper_row(test))
    table = {"title": TITLE, "columns": COLUMNS, "decimals": DECIMALS, "rows": rows}
    for name, content in (("table", table), ("table_errors", errors_table(rows))):
        text = json.dumps({**content, **provenance()}, indent=1, allow_nan=False)
        write_text(out / f"{name}.json", text + "\n")
    write_text(out / "table.md", markdown(rows))
    return rows


def _oracle(*drives: RunConfig) -> Episode:
    """The drive of the oracle, searched from the first of these drives that stays on the road."""
    from steersman.bench.oracle import searched

    for drive in drives:
        search = searched(drive, drive.controller)
        if search.result() is not None:
            break
    return search.episode()


def _slug(name: str) -> str:
    return name.lower().replace(", ", "_").replace(" ", "_").replace("/", "_per_").strip(".")


def _row(test: Test, driver: str, episode: Episode) -> dict[str, Any]:
    m = summarise(episode)
    steady = m["steady"]
    return {
        "test": test.name,
        "driver": driver,
        "ale_mm": 1e3 * m["mean_abs_lateral_error_m"],
        "steady_ale_mm": 1e3 * steady["mean_abs_lateral_error_m"],
        "max_mm": 1e3 * m["max_abs_lateral_error_m"],
        "steer_std": m["steer_std"],
        "aoe_deg": m["mean_abs_heading_error_deg"],
        "speed": m["mean_speed_m_s"],
        "a_y": m["max_lateral_acceleration_m_s2"],
        "time_us": None if driver == ORACLE else m["control_time_us_p50"],
        "end": episode.end,
        "completed": episode.completed,
        "duration_s": m["duration_s"],
    }


def _paper_row(test: Test) -> dict[str, Any]:
    return dict.fromkeys(COLUMNS) | {
        "test": test.name,
        "driver": PAPER,
        "ale_mm": test.ale_mm,
        "steer_std": test.steer_std,
        "aoe_deg": test.aoe_deg,
        "completed": True,
    }


def errors_table(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean lateral errors: a row for each test, a column for each driver."""
    columns = {"test": "test", **HEADERS}
    lines: dict[str, dict[str, Any]] = {}
    for row in rows:
        error = row["ale_mm"]
        if not row["completed"]:
            error = f"{error:.{DECIMALS['ale_mm']}f}, {row['end']}".replace("_", " ")
        lines.setdefault(row["test"], {"test": row["test"]})[row["driver"]] = error
    return {
        "title": ERRORS_TITLE,
        "columns": columns,
        "decimals": dict.fromkeys(HEADERS, DECIMALS["ale_mm"]),
        "rows": list(lines.values()),
    }


def _cells(row: dict[str, Any]) -> Iterator[str]:
    for key in COLUMNS:
        value = row[key]
        if value is None:
            yield ""
        elif isinstance(value, str):
            yield value.replace("_", " ")
        else:
            yield f"{value:.{DECIMALS[key]}f}"


def markdown(rows: list[dict[str, Any]]) -> str:
    """The table as the README shows it."""
    lines = [
        "| " + " | ".join(text.replace("|", r"\|") for text in COLUMNS.values()) + " |",
        "|---|---|" + "---:|" * (len(COLUMNS) - 3) + "---|",
    ]
    lines += ["| " + " | ".join(_cells(row)) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def cells(rows: list[dict[str, Any]]) -> list[list[str]]:
    """The table's cells as text, for the terminal."""
    return [list(_cells(row)) for row in rows]
