"""Several trainings at a time: the same results, and failures that stay where they are."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import pytest

import steersman as sm
from steersman.cli.seeds import train_seeds
from steersman.config import to_yaml
from steersman.errors import ConfigError, DataError
from steersman.learning.config import TrainConfig
from steersman.learning.parallel import TrainingEvent, TrainingJob, train_all
from steersman.learning.seeds import TrainedSeeds
from steersman.learning.train import train

from .problems import tiny

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")


def jobs(folder: FilePath, *configs: TrainConfig) -> list[TrainingJob]:
    return [
        TrainingJob(f"run {i}", config, folder / f"run_{i}") for i, config in enumerate(configs)
    ]


def silent(_: TrainingEvent) -> None:
    pass


SEEDS = 2, 5
SMALL = tiny(steps=600)
# Another algorithm draws from more random generators of its process.
ALONE = {
    "seed_2": SMALL.model_copy(update={"seed": 2}),
    "sac": tiny(steps=400, agent={"kind": "sac"}),
}


class Trained(NamedTuple):
    """Trainings of one call, one of which cannot go on."""

    folder: FilePath
    failed: dict[str, str]
    events: list[TrainingEvent]


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Trained:
    folder = tmp_path_factory.mktemp("seeds")
    wild: dict[str, Any] = {"learning_rate": {"kind": "constant", "at": 1e12}, "updates": 4}
    tasks = [TrainingJob("wild", tiny(agent=wild, steps=4000), folder / "wild")]
    tasks += [TrainingJob(name, config, folder / name) for name, config in ALONE.items()]
    events: list[TrainingEvent] = []
    return Trained(folder, train_all(tasks, 2, events.append), events)


def test_each_is_as_if_it_were_alone(trained: Trained, tmp_path: FilePath) -> None:
    for name, config in ALONE.items():
        alone = train(config, tmp_path / name)
        made = trained.folder / name / "policy.onnx"
        assert made.read_bytes() == alone.policy.read_bytes()
        told = [e for e in trained.events if e.job.name == name]
        steps = [e.row.steps for e in told if e.row is not None]
        assert steps == [at for at in (500, config.steps) if at <= config.steps]


def test_a_failure_leaves_the_others_alone(trained: Trained) -> None:
    assert list(trained.failed) == ["wild"]
    assert "agent.learning_rate" in trained.failed["wild"]


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
    try:
        deadline = time.monotonic() + 300.0  # a busy machine, and kernels to compile
        while len(list(tmp_path.glob("out/seed_*/resume/step_*"))) < 3:
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.05)
        os.kill(process.pid, end)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    time.sleep(0.2)
    assert_quiet(tmp_path)
    if end == signal.SIGINT:
        assert process.returncode == 130
        last = errors.splitlines()[-1]
        assert last.startswith("interrupted; --resume goes on from the last checkpoints in out")


def test_the_summary_names_the_best(
    trained: Trained, capsys: pytest.CaptureFixture[str], tmp_path: FilePath
) -> None:
    shutil.copytree(trained.folder / "seed_2", tmp_path / "seed_2")
    train(SMALL.model_copy(update={"seed": 5}), tmp_path / "seed_5")
    train_seeds(SMALL, SEEDS, tmp_path, overwrite=False, resume=True)
    out = capsys.readouterr().out
    table, best = out.splitlines()[:-1], out.splitlines()[-1]
    assert [line.split()[0] for line in table[-2:]] == ["2", "5"]
    (marked,) = (line for line in table if line.endswith("best"))
    assert best == f"best policy: {tmp_path / f'seed_{marked.split()[0]}' / 'policy.onnx'}"
    notes: list[str] = []
    result = sm.train(SMALL, seeds="2,5", out=tmp_path, resume=True, notify=notes.append)
    assert best == f"best policy: {result.policy}"
    assert {seed: each.seed for seed, each in result.trainings.items()} == {2: 2, 5: 5}
    assert notes == [f"{tmp_path / f'seed_{seed}'}: finished already" for seed in SEEDS]
    loaded = sm.load(tmp_path)
    assert loaded.line() == result.line()
    assert sm.load(tmp_path / "seed_2" / "progress.csv").rows == result.trainings[2].rows
    again: Any = sm.train(SMALL, "seeds=2,5", out=tmp_path, resume=True)
    assert again == result
    with pytest.raises(DataError, match="seed_2: holds a training"):
        sm.train(SMALL, seeds=[2, 3], out=tmp_path)


def test_what_is_for_one_training_or_for_several_is_refused_elsewhere(tmp_path: FilePath) -> None:
    with pytest.raises(ConfigError, match=r"jobs: goes with several trainings \(seeds=...\)"):
        sm.train("demo", out=tmp_path, jobs=2)
    with pytest.raises(ConfigError, match="reward: goes with one training"):
        sm.train("demo", out=tmp_path, seeds=[0, 1], reward=lambda _: 0.0)


def test_the_best_of_trainings_that_all_failed_is_an_error() -> None:
    result = TrainedSeeds({}, {0: "diverged", 4: "no road"})
    with pytest.raises(DataError, match="seed 0: diverged; seed 4: no road"):
        _ = result.best
