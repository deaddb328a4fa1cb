"""Drives recorded while they happen: the steps of a fleet, and of a training."""

from __future__ import annotations

import shutil
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from steersman.bounds import read_arrays
from steersman.files import replacing
from steersman.kernels import observe
from steersman.kernels import world as kernel
from steersman.kernels.vehicle import VX, VY
from steersman.learning.datasets import store
from steersman.learning.datasets.trajectory import Trajectory
from steersman.learning.fleet import FleetDriver
from steersman.learning.problem import Problem
from steersman.learning.snapshot import Tree
from steersman.types import FloatArray

if TYPE_CHECKING:
    from steersman.learning.vec_env import PathFollowingVecEnv

NAME = "training"
_PARTS = "parts"
# What a trajectory holds of each step.
_COLUMNS = tuple(name for name in Trajectory._fields if name != "terminated")


class Recorder:
    """Records the vehicles of a :class:`FleetDriver`, each from its first step on.

    Call :meth:`choose` before each step and :meth:`stepped` right after it, before any vehicle
    begins a new episode.
    """

    def __init__(self, driver: FleetDriver) -> None:
        """Nothing is recorded yet."""
        self._driver = driver
        self._steps: list[dict[str, Any]] = []  # values of _COLUMNS, of all vehicles
        self._first = [0] * driver.n
        self._finished: list[Trajectory] = []

    def choose(self, actions: Any, own: Any, who: Any) -> None:
        """Record the next step's executed and own actions (n, m), and ``Who`` of them (n,)."""
        driver, fleet = self._driver, self._driver.fleet
        unknown, steerless = np.full(np.shape(own), np.nan), np.full(driver.n, np.nan)
        self._steps.append(
            {
                "rows": fleet.rows.copy(),
                "places": self._places(),
                "actions": np.array(actions, dtype=np.float64),
                "own": np.array(own, dtype=np.float64),
                "demonstrated": driver.demonstrated_actions() if driver.demonstrates else unknown,
                "demonstrated_steer": fleet.demo.copy() if driver.demonstrates else steerless,
                "driver": np.array(who, dtype=np.int8),
            }
        )

    def stepped(self) -> None:
        """Record what came of the step; an episode that has ended is finished."""
        fleet = self._driver.fleet
        self._steps[-1] |= {"steer": fleet.executed.copy(), "rewards": fleet.reward[:, 0].copy()}
        for i in np.flatnonzero(fleet.ended != kernel.RUNNING).tolist():
            self._finish(i, terminated=int(fleet.ended[i]) in kernel.FAILED)

    def finished(self) -> list[Trajectory]:
        """The episodes that have ended since the last call."""
        found, self._finished = self._finished, []
        begin = min(self._first)
        del self._steps[:begin]
        self._first = [first - begin for first in self._first]
        return found

    def take(self) -> list[Trajectory]:
        """All episodes; those that are under way are cut off here."""
        for i in range(self._driver.n):
            if self._first[i] < len(self._steps):
                self._finish(i, terminated=False)
        return self.finished()

    def snapshot(self) -> dict[str, Any]:
        """The episodes under way; call :meth:`finished` before."""
        names = _COLUMNS if self._steps else ()
        steps = {name: np.stack([step[name] for step in self._steps]) for name in names}
        return {"first": list(self._first), "steps": steps}

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot."""
        self._first, self._finished = list(saved["first"]), []
        steps = saved["steps"]
        count = len(steps["rows"]) if steps else 0
        self._steps = [{name: steps[name][k] for name in _COLUMNS} for k in range(count)]

    def _places(self) -> FloatArray:
        fleet = self._driver.fleet
        speed = np.hypot(fleet.state[:, VX], fleet.state[:, VY])
        columns = [fleet.tracking[:, j] for j in (observe.D, observe.HEADING, observe.S)]
        return np.stack([*columns, speed], axis=1)

    def _finish(self, i: int, *, terminated: bool) -> None:
        steps = self._steps[self._first[i] :]
        self._first[i] = len(self._steps)
        columns = {name: np.stack([step[name][i] for step in steps]) for name in _COLUMNS}
        last = {"rows": self._driver.fleet.rows[i], "places": self._places()[i]}
        for name, value in last.items():
            columns[name] = np.concatenate((columns[name], value[None, :]))
        self._finished.append(Trajectory(**columns, terminated=terminated))


class Keeper:
    """Keeps the steps of a training's vehicles in ``DIR/data``.

    Episodes that have ended go into a part for each checkpoint; those under way are in the
    checkpoint.
    """

    def __init__(self, env: PathFollowingVecEnv, out: FilePath) -> None:
        """Begin to keep.

        Raises:
            ModuleNotFoundError: the extra ``minari`` is not installed.
        """
        store.require()
        self._folder = out / "data"
        self._recorder = env.recorder = Recorder(env.driver)

    def flush(self, steps: int) -> None:
        """Write the episodes that have ended since the last part; before a checkpoint."""
        found = self._recorder.finished()
        if found:
            with replacing(self._parts() / f"step_{steps:09d}.npz") as stream:
                np.savez(stream, **_packed(found))

    def snapshot(self) -> dict[str, Any]:
        """The episodes under way."""
        return self._recorder.snapshot()

    def restore(self, saved: Tree, steps: int) -> None:
        """Go on from a checkpoint; parts from after it are deleted."""
        self._recorder.restore(saved)
        for file in self._parts().glob("step_*.npz"):
            if int(file.stem.removeprefix("step_")) > steps:
                file.unlink()

    def finish(self, problem: Problem, source: str) -> FilePath:
        """Write the dataset, in place of one of the same training; returns its folder."""
        found: list[Trajectory] = []
        for file in sorted(self._parts().glob("step_*.npz")):
            with file.open("rb") as part:
                found += _unpacked(read_arrays(part))
        found += self._recorder.take()
        shutil.rmtree(self._folder / f"{NAME}-v0", ignore_errors=True)
        place = store.write(self._folder, NAME, store.Stored(problem, found, source))
        shutil.rmtree(self._parts(), ignore_errors=True)
        return place

    def _parts(self) -> FilePath:
        return self._folder / _PARTS


def _packed(found: list[Trajectory]) -> dict[str, Any]:
    """Episodes behind each other."""
    columns = {
        name: np.concatenate([np.atleast_1d(getattr(one, name)) for one in found])
        for name in Trajectory._fields
    }
    return {**columns, "steps": np.array([one.steps for one in found])}


def _unpacked(columns: dict[str, Any]) -> list[Trajectory]:
    counts = columns.pop("steps").tolist()
    ends = columns.pop("terminated").tolist()
    first, out = 0, []
    for k, count in enumerate(counts):
        # Rows and places have one more than there are steps.
        part = {
            name: values[first + k : first + k + count + 1]
            if name in {"rows", "places"}
            else values[first : first + count]
            for name, values in columns.items()
        }
        out.append(Trajectory(**part, terminated=bool(ends[k])))
        first += count
    return out
