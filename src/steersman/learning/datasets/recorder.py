"""Keeps what vehicles do while they learn or are demonstrated to."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import observe
from steersman.kernels import world as kernel
from steersman.kernels.vehicle import VX, VY
from steersman.learning.datasets.trajectory import Trajectory
from steersman.learning.fleet import FleetDriver
from steersman.learning.snapshot import Tree
from steersman.types import FloatArray

_FAILED = (kernel.LEFT_CORRIDOR, kernel.ROLLED)


class _Step(NamedTuple):
    """One control step of N vehicles."""

    rows: FloatArray
    places: FloatArray
    actions: FloatArray
    own: FloatArray
    demonstrated: FloatArray
    steer: FloatArray
    demonstrated_steer: FloatArray
    driver: Any
    rewards: FloatArray


class Recorder:
    """Records the vehicles of a :class:`FleetDriver`, each from its first step on.

    Before each step :meth:`choose` is told what will be done, right after it :meth:`stepped` is
    called, before anybody begins a new episode.
    """

    def __init__(self, driver: FleetDriver) -> None:
        """Nothing is recorded yet."""
        self._driver = driver
        self._steps: list[_Step] = []
        self._first = [0] * driver.n
        self._finished: list[Trajectory] = []

    def choose(self, actions: Any, own: Any, who: Any) -> None:
        """The next step's executed and own actions and drivers, (n,) each."""
        driver, fleet = self._driver, self._driver.fleet
        nobody = np.full(driver.n, np.nan)
        demonstrates = driver.demonstrates
        self._steps.append(
            _Step(
                rows=fleet.rows.copy(),
                places=self._places(),
                actions=np.array(actions, dtype=np.float64),
                own=np.array(own, dtype=np.float64),
                demonstrated=driver.demonstrated_actions() if demonstrates else nobody,
                steer=nobody,
                demonstrated_steer=fleet.demo.copy() if demonstrates else nobody,
                driver=np.array(who, dtype=np.int8),
                rewards=nobody,
            )
        )

    def stepped(self) -> None:
        """The step is done."""
        fleet = self._driver.fleet
        self._steps[-1] = self._steps[-1]._replace(
            steer=fleet.executed.copy(), rewards=fleet.reward[:, 0].copy()
        )
        for i in np.flatnonzero(fleet.ended != kernel.RUNNING).tolist():
            self._finish(i, terminated=int(fleet.ended[i]) in _FAILED)

    def finished(self) -> list[Trajectory]:
        """The episodes that have ended since this was last asked."""
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
        """The episodes under way, once those that have ended were asked for."""
        columns = zip(*self._steps, strict=True)
        steps = [np.stack(column) for column in columns]
        return {"first": list(self._first), "steps": dict(zip(_Step._fields, steps, strict=False))}

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot."""
        self._first, self._finished = list(saved["first"]), []
        columns = [saved["steps"][name] for name in _Step._fields if saved["steps"]]
        self._steps = [_Step(*values) for values in zip(*columns, strict=True)]

    def _places(self) -> FloatArray:
        fleet = self._driver.fleet
        speed = np.hypot(fleet.state[:, VX], fleet.state[:, VY])
        columns = [fleet.tracking[:, j] for j in (observe.D, observe.HEADING, observe.S)]
        return np.stack([*columns, speed], axis=1)

    def _finish(self, i: int, *, terminated: bool) -> None:
        steps = self._steps[self._first[i] :]
        self._first[i] = len(self._steps)
        columns = {
            name: np.stack([getattr(step, name)[i] for step in steps]) for name in _Step._fields
        }
        last = {"rows": self._driver.fleet.rows[i], "places": self._places()[i]}
        for name, value in last.items():
            columns[name] = np.concatenate((columns[name], value[None, :]))
        self._finished.append(Trajectory(**columns, terminated=terminated))
