"""Trainings that were killed go on as if they had not been."""

from __future__ import annotations

import csv
import random
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.config import components, dump, to_yaml
from steersman.controllers.base import ControllerComponent
from steersman.errors import ConfigError, ControllerError, DataError
from steersman.learning import checkpoint, snapshot
from steersman.learning.config import TrainConfig
from steersman.learning.demonstration import Demonstrator
from steersman.learning.snapshot import changed, rebuilt
from steersman.learning.train import _Training, train
from steersman.sensing import to_observation
from steersman.vehicles import CarlaModel3

from .problems import RESIDUAL, tiny

# All that can carry state from step to step: noise on waypoints and cars, a schedule in the
# middle of its fall, an MPC with a rate limit (so that it asks for its last angle), a small
# buffer that overflows, a mean of the weights.
CHANGES: dict[str, Any] = {
    "problem": {
        "sensor": {"error_range": 0.05},
        "demonstration": {"controller": {"kind": "mpc_pid", "rate_limit": True, "horizon": 8}},
        "episode_time": 2.0,
    },
    "agent": {"buffer": 600, "noise": {"kind": "linear", "start": 0.3, "end": 0.0}},
    "validation": {"interval": 200},
    "steps": 1200,
    "average": 0.3,
    "checkpoint_interval": 100,
}


def config(**changes: Any) -> TrainConfig:
    return tiny(**{**CHANGES, **changes})


# The same with a base, which carries state for each vehicle, too.
CORRECTED: dict[str, Any] = {"problem": {**CHANGES["problem"], **RESIDUAL}}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """A training that nothing stopped."""
    folder = tmp_path_factory.mktemp("whole")
    train(config(), folder)
    return folder


@pytest.fixture(scope="module")
def corrected(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """The same of a residual policy."""
    folder = tmp_path_factory.mktemp("corrected")
    train(config(**CORRECTED), folder)
    return folder


def test_a_paused_training_goes_on_as_if_it_had_not(whole: FilePath, tmp_path: FilePath) -> None:
    steps = []
    for until in (450, 800, 800, None):
        train(config(), tmp_path, resume=True, until=until)
        steps.append(checkpoint.load(tmp_path) if until else None)
    counts = [saved["agent"]["counters"]["num_timesteps"] for saved in steps if saved]
    assert 450 <= counts[0] < 500
    assert 800 <= counts[1] == counts[2] < 850
    assert (tmp_path / "policy.onnx").read_bytes() == (whole / "policy.onnx").read_bytes()


class Stopped(Exception):
    """Stands for whatever ends a process."""


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """A training that stopped at its 1000th step."""
    folder = tmp_path_factory.mktemp("stopped")
    stop_at(1000, folder)
    return folder


def stop_at(at: int, out: FilePath, **changes: Any) -> None:
    """Train, and stop in the middle of the step that is validated at ``at``."""

    def reporter(row: Any) -> None:
        if row.steps >= at:
            raise Stopped

    with pytest.raises(Stopped):
        train(config(**changes), out, reporter)


def rows(folder: FilePath) -> list[dict[str, str]]:
    with (folder / "progress.csv").open(encoding="utf-8") as stream:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(stream)]


def assert_same(folder: FilePath, whole: FilePath) -> None:
    assert (folder / "policy.onnx").read_bytes() == (whole / "policy.onnx").read_bytes()
    assert rows(folder) == rows(whole)
    last = "checkpoints/step_000001200.npz"
    with np.load(folder / last) as ours, np.load(whole / last) as theirs:
        assert set(ours) == set(theirs)
        assert all(np.array_equal(ours[name], theirs[name]) for name in ours)
    assert not list(folder.rglob(".*"))
    assert not (folder / "resume").exists()


def newest(out: FilePath) -> FilePath:
    return max((out / "resume").glob("step_*.npz"))


# --------------------------------------------------------------------------------- exact resume


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_killed_at_any_moment(corrected: FilePath, tmp_path: FilePath) -> None:
    out = tmp_path / "out"
    (tmp_path / "c.yaml").write_text(to_yaml(config(**CORRECTED)), encoding="utf-8")
    moment = random.Random(time.time_ns())
    command = [sys.executable, "-c", "from steersman.cli import main; main()", "train"]
    command += [str(tmp_path / "c.yaml"), "--out", str(out), "--resume"]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    while process.poll() is None and not list(out.glob("resume/step_*")):
        time.sleep(0.005)
    time.sleep(moment.uniform(0.0, 0.3))
    process.kill()
    _, errors = process.communicate()
    assert "Traceback" not in errors
    told: list[str] = []
    train(config(**CORRECTED), out, resume=True, notify=told.append)
    assert "going on after" in told[0] or "finished" in told[0]
    assert_same(out, corrected)


def test_nothing_to_resume_is_said(tmp_path: FilePath) -> None:
    out, told = tmp_path / "new", list[str]()
    for resume, notes in ((True, [f"nothing to resume in {out}: beginning"]), (False, [])):
        told.clear()
        begun = checkpoint.begin(config(), out, told.append, overwrite=False, resume=resume)
        assert begun == (False, None)
        assert told == notes
        assert not checkpoint.exists(out)
    checkpoint.save(out, 100, {})
    assert checkpoint.exists(out)
    told.clear()
    assert checkpoint.begin(config(), out, told.append, overwrite=False, resume=True).saved
    assert told == []


def test_a_policy_without_a_checkpoint_is_kept_when_the_training_begins_again(
    tmp_path: FilePath,
) -> None:
    checkpoint.begin(config(), tmp_path, print, overwrite=False, resume=False)
    for name in ("policy.onnx", "policy.json", "progress.csv"):
        (tmp_path / name).write_text(name)
    told: list[str] = []
    begun = checkpoint.begin(config(), tmp_path, told.append, overwrite=False, resume=True)
    assert begun == (False, None)
    aside = tmp_path / "before"
    assert told[0].endswith(f"the policy that was there is in {aside}")
    assert {file.name: file.read_text() for file in aside.iterdir()} == {
        name: name for name in ("policy.onnx", "policy.json")
    }
    assert not (tmp_path / "policy.onnx").exists()


@pytest.mark.parametrize("steps", [200, 600, 1000])
def test_stopped_in_the_middle_of_a_step(whole: FilePath, tmp_path: FilePath, steps: int) -> None:
    stop_at(steps, tmp_path)
    told: list[str] = []
    train(config(), tmp_path, resume=True, notify=told.append)
    # The step in which it stopped was not stored yet, so the checkpoint is of the one before.
    assert told[0] == f"{tmp_path}: going on after {steps - 100} steps"
    assert re.search(r"policy.onnx: after \d+ of 1200 steps, the best in validation$", told[1])
    assert len(told) == 2
    assert_same(tmp_path, whole)


# Each action, each kind of state that a demonstrator carries, and neither.
@pytest.mark.parametrize(
    ("action", "demonstrator"),
    [
        ("direct", "mpc_pid"),
        ("rate", "pid"),
        ("rate", "none"),
        ("residual", "mpc_delay"),
        ("residual", "none"),
    ],
)
def test_every_kind_of_training(tmp_path: FilePath, action: str, demonstrator: str) -> None:
    demonstration: dict[str, Any] = {"enabled": False}
    if demonstrator != "none":
        demonstration = {"controller": {"kind": demonstrator}, "store": "agent"}
    changes: dict[str, Any] = {
        "problem": {
            **CHANGES["problem"],
            **(RESIDUAL if action == "residual" else {}),
            "action": action,
            "demonstration": demonstration,
        },
        "steps": 400,
    }
    train(config(**changes), tmp_path / "whole")
    stop_at(200, tmp_path / "out", **changes)
    train(config(**changes), tmp_path / "out", resume=True)
    assert rows(tmp_path / "out") == rows(tmp_path / "whole")
    ours, theirs = ((tmp_path / name / "policy.onnx").read_bytes() for name in ("out", "whole"))
    assert ours == theirs


def test_stopped_before_the_first_validation(
    tmp_path: FilePath, whole: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(_: Any) -> None:
        raise Stopped

    with monkeypatch.context() as patch:
        patch.setattr(_Training, "_validate", stop)
        with pytest.raises(Stopped):
            train(config(), tmp_path)
    with pytest.raises(DataError, match=r"holds a training already; .* --resume"):
        train(config(), tmp_path)
    train(config(), tmp_path, resume=True)
    assert_same(tmp_path, whole)


def test_an_empty_folder_begins_anew(tmp_path: FilePath, whole: FilePath) -> None:
    train(config(), tmp_path, resume=True)
    assert_same(tmp_path, whole)


def test_nothing_is_done_twice(whole: FilePath) -> None:
    before = {file: file.stat().st_mtime_ns for file in whole.rglob("*")}
    told: list[str] = []
    assert train(config(), whole, resume=True, notify=told.append).policy == whole / "policy.onnx"
    assert told == [f"{whole}: finished already"]
    assert {file: file.stat().st_mtime_ns for file in whole.rglob("*")} == before


def test_tensorboard_has_each_validation_once(tmp_path: FilePath) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    stop_at(600, tmp_path, checkpoint_interval=300)
    train(config(checkpoint_interval=300), tmp_path, resume=True)
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    steps = [event.step for event in events.Scalars("train/validation_error_mm")]
    assert steps == [200, 400, 600, 800, 1000, 1200]


def test_two_checkpoints_are_kept(stopped: FilePath) -> None:
    names = sorted(file.name for file in (stopped / "resume").iterdir())
    assert names == ["step_000000800.npz", "step_000000900.npz"]


# ------------------------------------------------------------------------------------- damage


def damage(file: FilePath, how: str) -> None:
    data = bytearray(file.read_bytes())
    if how == "truncated":
        del data[len(data) // 2 :]
    elif how == "empty":
        data.clear()
    elif how == "one bit":
        data[len(data) // 3] ^= 1
    elif how == "header":
        data[60:90] = b"\x00" * 30
    file.write_bytes(data)


@pytest.mark.parametrize("how", ["truncated", "empty", "one bit", "header"])
def test_a_damaged_checkpoint_gives_way_to_the_one_before(
    tmp_path: FilePath, whole: FilePath, stopped: FilePath, how: str
) -> None:
    shutil.copytree(stopped, tmp_path, dirs_exist_ok=True)
    file = newest(tmp_path)
    damage(file, how)
    told: list[str] = []
    train(config(), tmp_path, resume=True, notify=told.append)
    assert told[0].startswith(f"{file}: not a whole checkpoint")
    assert told[0].endswith("going on from step_000000800.npz")
    assert told[1] == f"{tmp_path}: going on after 800 steps"
    assert_same(tmp_path, whole)


def test_only_damaged_checkpoints_are_an_error(tmp_path: FilePath, stopped: FilePath) -> None:
    shutil.copytree(stopped, tmp_path, dirs_exist_ok=True)
    for file in (tmp_path / "resume").iterdir():
        damage(file, "truncated")
    with pytest.raises(DataError, match=r"step_000000900.npz: not a whole .*--overwrite trains"):
        train(config(), tmp_path, resume=True)


def test_a_pickle_is_not_read(tmp_path: FilePath) -> None:
    file = tmp_path / "resume" / "step_000000001.npz"
    file.parent.mkdir()
    np.savez(file, state=np.array([{"a": 1}], dtype=object))
    with pytest.raises(DataError, match="holds object, not numbers"):
        checkpoint.load(tmp_path)


def test_a_checkpoint_of_another_format(tmp_path: FilePath) -> None:
    file = tmp_path / "resume" / "step_000000001.npz"
    file.parent.mkdir()
    with file.open("wb") as stream:
        snapshot.write({"format": 99}, stream)
    with pytest.raises(DataError, match="format 99 is not known"):
        checkpoint.load(tmp_path)


# ------------------------------------------------------------------------------ configuration


def test_another_configuration_is_refused(tmp_path: FilePath, stopped: FilePath) -> None:
    shutil.copytree(stopped, tmp_path, dirs_exist_ok=True)
    before = newest(tmp_path).read_bytes()
    with pytest.raises(ConfigError, match=r"^agent\.gamma: 0\.9 is given, but .* has 0\.95"):
        train(config(agent={**CHANGES["agent"], "gamma": 0.9}), tmp_path, resume=True)
    with pytest.raises(ConfigError, match=r"^steps: 4000 is given"):
        train(config(steps=4000), tmp_path, resume=True)
    assert newest(tmp_path).read_bytes() == before


def test_overwrite_and_resume_contradict_each_other(tmp_path: FilePath) -> None:
    with pytest.raises(ConfigError, match="contradict"):
        train(config(), tmp_path, overwrite=True, resume=True)


def test_a_configuration_of_something_else_is_named(tmp_path: FilePath) -> None:
    (tmp_path / "config.yaml").write_text("laps: 1\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"config\.yaml: laps: unknown field"):
        train(config(), tmp_path, resume=True)


# ---------------------------------------------------------------------- states as plain data


@pytest.mark.parametrize(
    "kind", sorted(set(components("controller")) - {"adaptive", "policy", "process"})
)
def test_every_controller_goes_on_from_its_plain_state(kind: str, tmp_path: FilePath) -> None:
    controller = components("controller")[kind]()
    assert isinstance(controller, ControllerComponent)
    row_source = np.random.default_rng(0)

    def rows(count: int) -> list[Any]:
        out = []
        for _ in range(count):
            row = row_source.normal(0.0, 0.02, 7 + 2 * 25)
            row[0] = 9.0
            row[7::2] = 2.0 * np.arange(1, 26)
            out.append(row)
        return out

    early, late = rows(5), rows(5)
    first, second = (Demonstrator(controller, CarlaModel3(), 0.05) for _ in range(2))
    first.restart(3)
    for k, row in enumerate(early):
        first.propose(3, to_observation(row, 0.05 * k, 2.0))
    file = tmp_path / "state.npz"
    with file.open("wb") as stream:
        snapshot.write(first.snapshot(), stream)
    with file.open("rb") as stream:
        second.restore(snapshot.read(stream))
    for k, row in enumerate(late):
        seen = to_observation(row, 1.0 + 0.05 * k, 2.0)
        ours, theirs = (d.propose(3, seen).steer for d in (first, second))
        assert ours == theirs


def test_what_no_file_can_keep_is_named() -> None:
    with pytest.raises(ControllerError, match="holds a new dict"):
        changed(({},), (None,))


def test_tuples_that_grow() -> None:
    fresh = (1.0, None)
    state = (1.5, (2.0, None), "text", True)
    assert rebuilt(changed(state, fresh), fresh) == state


def test_the_first_difference_is_found() -> None:
    given = dump(tiny(agent={"hidden": [16, 8]}))
    where, ours, theirs = checkpoint.first_difference(given, dump(tiny())) or ((), 0, 0)
    assert (where, ours, theirs) == (("agent", "hidden", "1"), 8, 16)
