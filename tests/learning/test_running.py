"""A training that is watched: its state, its alarms, what it is asked, its worst drive."""

from __future__ import annotations

import threading
import time
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman.episode import load_episode
from steersman.errors import DataError, TrainingDiverged, TrainingStopped
from steersman.learning import running
from steersman.learning.progress import TrainRow, alarms, check_progress, read_rows
from steersman.learning.running import ask, read_state, told
from steersman.learning.train import train

from .problems import tiny


def until(true: object, within: float = 30.0) -> None:
    begun = time.monotonic()
    while not true():  # type: ignore[operator]
        assert time.monotonic() < begun + within
        time.sleep(0.005)


def test_pause_and_stop(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "PERIOD", 0.01)
    config, folder = tiny(steps=700), tmp_path / "run"
    train(config, tmp_path / "whole")
    assert read_state(folder) is None
    faults: list[BaseException] = []
    ticks: list[int] = []

    def tick(steps: int) -> None:
        ticks.append(steps)
        if len(ticks) == 1:
            ask(folder, "pause")

    def run() -> None:
        try:
            train(config, folder, tick=tick)
        except TrainingStopped as stopped:
            faults.append(stopped)

    thread = threading.Thread(target=run)
    thread.start()
    until(lambda: (found := read_state(folder)) is not None and found.state == "paused")
    paused = read_state(folder)
    time.sleep(0.1)
    assert read_state(folder) == paused  # it waits
    ask(folder, "stop")
    thread.join(30.0)
    found = read_state(folder)
    assert paused is not None
    assert found is not None
    assert (found.state, found.total, found.steps) == ("stopped", 700, paused.steps)
    assert found.why == str(faults[0])
    assert found.why.endswith(f"stopped after {found.steps} steps; --resume goes on")
    # What was paused and stopped ends as what was not; the request is forgotten.
    train(config, folder, resume=True)
    assert (folder / "policy.onnx").read_bytes() == (
        tmp_path / "whole" / "policy.onnx"
    ).read_bytes()
    ended = read_state(folder)
    assert ended is not None
    assert (ended.state, ended.steps) == ("ended", 700)
    # The worst validation drive is as far off as the record says of both together.
    drive = load_episode(folder / "validation.npz")
    last = read_rows(folder / "progress.csv", TrainRow)[-1]
    assert 0 < len(drive) <= 80
    errors = np.concatenate([abs(drive["lateral_error"][1:]), np.full(80 - len(drive) + 1, 1.5)])
    assert 1e3 * errors.mean() >= 0.9 * last.validation_error_mm
    assert drive.end in {"duration", "off_track", "roll_over", "end_of_path"}


def test_the_end_is_told_however_it_comes(tmp_path: FilePath) -> None:
    for error, state in (
        (TrainingDiverged("loss is not finite"), "failed"),
        (KeyboardInterrupt(), "stopped"),
    ):
        with pytest.raises(type(error)), told(tmp_path, 7, 9):
            raise error
        found = read_state(tmp_path)
        assert found is not None
        assert (found.state, found.steps) == (state, 7)
        assert found.why == str(error) or found.why == "interrupted"
    (tmp_path / "state.json").write_text("{}", encoding="utf-8")
    with pytest.raises(DataError, match="is not the state of a training"):
        read_state(tmp_path)


def test_alarms_come_before_the_end() -> None:
    config = tiny()
    good = TrainRow(steps=500, updates=1e4, validation_error_mm=10.0, saturated_share=0.1,
                    actor_loss=0.0, critic_loss=0.0, q_mean=1.0)  # fmt: skip
    assert alarms(config, [good], 1.0) == ()
    bound = 1.0 / (1.0 - config.agent.gamma)
    bad = good._replace(validation_error_mm=30.0, saturated_share=0.6, q_mean=2.0 * bound)
    words = alarms(config, [good, bad], 1.0)
    assert [one.partition(" ")[0] for one in words] == ["the", "60", "mean"]
    assert "30 mm; after 500 steps it was 10 mm" in words[0]
    check_progress(config, [good, bad], 1.0)  # goes on
