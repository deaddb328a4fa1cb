"""Every step of a training as a dataset, also of one that is killed and resumed."""

from __future__ import annotations

import shutil
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.files import replacing
from steersman.learning.datasets import store
from steersman.learning.datasets.recorder import Recorder
from steersman.learning.datasets.trajectory import Trajectory
from steersman.learning.problem import Problem
from steersman.learning.snapshot import Tree
from steersman.learning.vec_env import PathFollowingVecEnv

NAME = "training"
_PARTS = "parts"


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
        """Go on from a checkpoint; parts from after it are forgotten."""
        self._recorder.restore(saved)
        for file in self._parts().glob("step_*.npz"):
            if int(file.stem.removeprefix("step_")) > steps:
                file.unlink()

    def finish(self, problem: Problem, source: str) -> FilePath:
        """Write the dataset, in place of one of the same training; returns its folder."""
        found: list[Trajectory] = []
        for file in sorted(self._parts().glob("step_*.npz")):
            with np.load(file, allow_pickle=False) as part:
                found += _unpacked(dict(part))
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
