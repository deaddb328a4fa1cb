"""Several trainings at a time: the same results, and failures that stay where they are."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.cli.seeds import train_seeds
from steersman.config import to_yaml
from steersman.errors import DataError
from steersman.learning.config import TrainConfig
from steersman.learning.parallel import TrainingEvent, TrainingJob, train_all
from steersman.learning.train import train

from .problems import tiny

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")


def jobs(folder: FilePath, *configs: TrainConfig) -> list[TrainingJob]:
    return [
        TrainingJob(f"run {i}", config, folder / f"run_{i}") for i, config in enumerate(configs)
    ]


def silent(_: TrainingEvent) -> None:
    pass


def test_each_is_as_if_it_were_alone(tmp_path: FilePath) -> None:
    configs = tiny(steps=600), tiny(steps=600, seed=3)
    events: list[TrainingEvent] = []
    assert train_all(jobs(tmp_path, *configs), 2, events.append) == {}
    for i, config in enumerate(configs):
        alone = train(config, tmp_path / f"alone_{i}")
        assert (tmp_path / f"run_{i}" / "policy.onnx").read_bytes() == alone.policy.read_bytes()
        rows = [e.row.steps for e in events if e.job.config == config and e.row is not None]
        assert rows == [500, 600]


def test_a_failure_leaves_the_others_alone(
    tmp_path: FilePath, capsys: pytest.CaptureFixture[str]
) -> None:
    wild: dict[str, Any] = {"learning_rate": {"kind": "constant", "at": 1e12}, "updates": 4}
    failed = train_all(jobs(tmp_path, tiny(agent=wild, steps=4000), tiny(steps=400)), None, silent)
    assert list(failed) == ["run 0"]
    assert "agent.learning_rate" in failed["run 0"]
    assert (tmp_path / "run_1" / "policy.onnx").exists()
    assert capsys.readouterr() == ("", "")


def test_nothing_begins_if_a_folder_is_taken(tmp_path: FilePath) -> None:
    tasks = jobs(tmp_path, tiny(steps=400), tiny(steps=400))
    tasks[1].out.mkdir()
    (tasks[1].out / "progress.csv").touch()
    with pytest.raises(DataError, match="run_1: holds a training already"):
        train_all(tasks, 2, silent)
    assert not tasks[0].out.exists()


def test_a_crash_leaves_its_traceback(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "broken"
    (broken / "torch").mkdir(parents=True)
    (broken / "torch" / "__init__.py").write_text("1 / 0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(broken)
    failed = train_all(jobs(tmp_path, tiny()), 1, silent)
    log = tmp_path / "run_0" / "traceback.txt"
    assert failed == {"run 0": f"ZeroDivisionError: division by zero (see {log})"}
    assert "Traceback" in log.read_text(encoding="utf-8")


def test_what_is_finished_is_not_begun_again(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "broken"
    (broken / "torch").mkdir(parents=True)
    (broken / "torch" / "__init__.py").write_text("1 / 0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(broken)  # a training that began would fail
    (task,) = jobs(tmp_path, tiny(steps=400))
    (task.out / "checkpoints").mkdir(parents=True)
    (task.out / "checkpoints" / "step_400.npz").touch()
    (task.out / "policy.onnx").touch()
    (task.out / "config.yaml").write_text(to_yaml(task.config), encoding="utf-8")
    events: list[TrainingEvent] = []
    assert train_all([task], 1, events.append, resume=True) == {}
    assert [(e.steps, e.note) for e in events] == [(400.0, f"{task.out}: finished already")]


def test_an_interruption_stops_all(tmp_path: FilePath) -> None:
    def interrupt(event: TrainingEvent) -> None:
        raise KeyboardInterrupt

    tasks = jobs(tmp_path, tiny(steps=400_000), tiny(steps=400_000))
    with pytest.raises(KeyboardInterrupt):
        train_all(tasks, 2, interrupt)
    assert_quiet(tmp_path)


def assert_quiet(folder: FilePath) -> None:
    """Nothing is written any more."""

    def state() -> dict[FilePath, int]:
        return {file: file.stat().st_mtime_ns for file in folder.rglob("*") if file.exists()}

    before = state()
    time.sleep(1.0)
    assert state() == before


@posix
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT])
def test_all_go_with_their_parent(tmp_path: FilePath, end: signal.Signals) -> None:
    (tmp_path / "c.yaml").write_text(
        to_yaml(tiny(steps=400_000, checkpoint_interval=100)), encoding="utf-8"
    )
    command = [sys.executable, "-c", "from steersman.cli import main; main()", "train", "c.yaml"]
    process = subprocess.Popen(
        [*command, "seeds=0..1", "--jobs", "2", "--out", "out"],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60.0
    while len(list(tmp_path.glob("out/seed_*/resume/step_*"))) < 3:
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.05)
    os.kill(process.pid, end)
    _, errors = process.communicate(timeout=60)
    time.sleep(0.2)
    assert_quiet(tmp_path)
    if end == signal.SIGINT:
        assert process.returncode == 130
        last = errors.splitlines()[-1]
        assert last.startswith("interrupted; --resume goes on from the last checkpoints in out")


def test_the_summary_names_the_best(tmp_path: FilePath, capsys: pytest.CaptureFixture[str]) -> None:
    train_seeds(tiny(steps=400), [2, 5], tmp_path, jobs=2, overwrite=False, resume=False)
    out = capsys.readouterr().out
    table, best = out.splitlines()[:-1], out.splitlines()[-1]
    assert [line.split()[0] for line in table[-2:]] == ["2", "5"]
    (marked,) = (line for line in table if line.endswith("best"))
    assert best == f"best policy: {tmp_path / f'seed_{marked.split()[0]}' / 'policy.onnx'}"
    train_seeds(tiny(steps=400), [2, 5], tmp_path, jobs=2, overwrite=False, resume=True)
    assert capsys.readouterr().out == out
