"""``steersman tune``: its files and its last lines."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path as FilePath

import pytest
from typer.testing import Result

Steersman = Callable[..., Result]
RUN = "suite=[{path: {kind: circle, radius: 30}, speed: {kind: constant_speed}, duration: 2}]"


def test_the_files_and_the_last_lines(
    steersman: Steersman, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("tune", "controller=pid", RUN, "--trials", "3", "--out", "t")
    result = steersman(*words)
    assert result.exit_code == 0
    names = {file.name for file in (tmp_path / "t").iterdir()}
    outcome = {"tuned.yaml", "result.json", "pareto.json", "pareto.svg"} | {
        "history.svg",
        "report.html",
    }
    assert names == outcome | {"config.yaml", "study.jsonl"}
    assert "warning: the runs hold no steering delay, no waypoint noise, " in result.stderr
    chosen, spent = result.stderr.splitlines()[-2:]
    found = json.loads((tmp_path / "t" / "result.json").read_text())["chosen"]
    assert chosen.startswith(f"Trial {found['number']} of pid was chosen, cost ")
    assert f"RMS error {1e3 * found['rms_error_m']:.3g} mm, steering " in chosen
    assert spent == "6 s (0.1 min) were simulated in 3 trials."
    drawing = (tmp_path / "t" / "pareto.svg").read_text()
    page = (tmp_path / "t" / "report.html").read_text()
    assert "chosen</text>" in drawing
    assert drawing in page
    assert chosen in page
    assert "searched from" in page
    monkeypatch.setattr("steersman.report.tuning.find_spec", lambda _: None)
    (tmp_path / "t" / "pareto.svg").unlink()
    again = steersman(*words)
    assert "t holds the 3 trials that were asked for: none was driven" in again.stderr
    fewer = steersman(*words[:3], "--trials", "2", "--out", "t")
    assert "t holds the 2 trials that were asked for: none was driven" in fewer.stderr
    assert "none was driven" not in result.stderr
    assert "no report.html: it needs the extra 'report'" in again.stderr
    assert (tmp_path / "t" / "pareto.svg").read_text() == drawing


def test_one_line_for_ones_own_car_and_road(steersman: Steersman, tmp_path: FilePath) -> None:
    (tmp_path / "my_car.yaml").write_text("base: bmw_320i\n")
    rows = "\n".join(f"{5 * k},{0.001 * (5 * k) ** 2}" for k in range(8))
    (tmp_path / "my_track.csv").write_text(f"east,north\n{rows}\n")
    words = ("tune", "lqr", "--car", "my_car.yaml", "--road", "my_track.csv", "--trials", "1")
    result = steersman(*words, "road.columns=x=east,y=north", "seeds=0..1", "--out", "t")
    assert result.exit_code == 0, result.stderr
    assert "warning" not in result.stderr
    assert "seed_1: Trial 0 of lqr was chosen" in result.stderr
    assert (tmp_path / "t" / "tuned.yaml").is_file()
    suite = json.loads((tmp_path / "t" / "seed_0" / "result.json").read_text())["suite"]
    assert {run["path"]["file"] for run in suite} == {"my_track.csv"}
    assert {run["vehicle"]["kind"] for run in suite} == {"file"}
