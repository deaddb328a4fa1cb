"""The demo's drives and its table."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import pytest
from tests.loops import random_policy

from steersman.config import build
from steersman.episode import load_episode
from steersman.report.runs import load_runs
from steersman.rollout import RunConfig
from steersman.studies import demo


@pytest.fixture
def rows(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """The table of two short tests, one of them with figures of the paper."""
    short = [demo.tests()[0], demo.tests()[-1]]
    short = [t._replace(config=t.config | {"duration": 2.0, "laps": None}) for t in short]
    monkeypatch.setattr(demo, "tests", lambda: short)
    return demo.drive_tests(random_policy(tmp_path), tmp_path / "out")


def test_every_test_is_a_valid_run_of_its_own() -> None:
    tests = demo.tests()
    assert len({t.name for t in tests}) == len(tests) == 9
    for test in tests:
        assert build(RunConfig, test.config).controller.kind == "mpc_pid"


def test_the_paper_stands_beside_its_throttles_and_speeds() -> None:
    """Table of the paper: throttle 0.4 to 1.0, and the same figures at the inferred speeds."""
    circle = demo.tests()[:8]
    assert [t.ale_mm for t in circle] == 2 * [2.83, 47.1, 85.3, 104.0]
    assert [t.aoe_deg for t in circle] == 2 * [0.922, 2.12, 3.87, 5.01]
    assert [t.steer_std for t in circle] == 2 * [0.110, 0.137, 0.139, 0.138]
    throttles = [t.config["speed"]["throttle"] for t in circle[:4]]
    speeds = [t.config["speed"]["speed"] for t in circle[4:]]
    assert (throttles, speeds) == ([0.4, 0.6, 0.8, 1.0], [9.9, 18.7, 22.2, 24.2])


def test_rows_are_what_the_episodes_say(rows: list[dict[str, Any]], tmp_path: FilePath) -> None:
    assert [r["driver"] for r in rows] == [
        *(demo.AGENT, demo.MPC_PID, demo.SCHEDULED, demo.BEST, demo.ORACLE, demo.PAPER),
        *(demo.AGENT, demo.MPC_PID, demo.SCHEDULED, demo.BEST, demo.ORACLE),
    ]
    episodes = sorted((tmp_path / "out" / "episodes").rglob("*.npz"))
    assert len(episodes) == 10
    by_driver = {(r["test"], r["driver"]): r for r in rows}
    episode = load_episode(tmp_path / "out" / "episodes" / "r50_throttle_0.4" / "mpc-pid.npz")
    row = by_driver["R50, throttle 0.4", demo.MPC_PID]
    assert row["ale_mm"] == pytest.approx(1e3 * abs(episode["lateral_error"]).mean())
    assert row["end"] == episode.end


def test_no_drive_has_less_error_than_the_oracle(rows: list[dict[str, Any]]) -> None:
    for test in {row["test"] for row in rows}:
        errors = {r["driver"]: r["ale_mm"] for r in rows if r["test"] == test}
        assert errors[demo.ORACLE] == min(errors.values())
        assert errors[demo.ORACLE] < 0.01


def test_files_can_be_read_back(rows: list[dict[str, Any]], tmp_path: FilePath) -> None:
    out = tmp_path / "out"
    assert json.loads((out / "table.json").read_text())["rows"] == rows
    lines = (out / "table.md").read_text().splitlines()
    assert len(lines) == len(rows) + 2
    assert {line.replace(r"\|", "").count("|") for line in lines} == {len(demo.COLUMNS) + 1}
    runs = load_runs([out])
    assert sum(run.episode is not None for run in runs) == 10
    errors = next(run.table for run in runs if run.table and len(run.table.rows) == 2)
    agent, mean = errors.rows[0][demo.AGENT], rows[0]["ale_mm"]
    assert agent == mean if rows[0]["completed"] else str(agent).startswith(f"{mean:.2f}, ")
    assert errors.rows[0][demo.PAPER] == 2.83
    assert [len(cells) for cells in demo.cells(rows)] == [len(demo.COLUMNS)] * len(rows)
