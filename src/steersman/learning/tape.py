"""Driven control steps kept for the way back, and the way back through them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from steersman.errors import ConfigError
from steersman.kernels import adjoint as kernel
from steersman.kernels import tape as kept
from steersman.kernels.fleet import Fleet, World
from steersman.kernels.linearised_step import learn, make_derived
from steersman.kernels.step import Lesson
from steersman.learning.fleet import FleetDriver
from steersman.plants.mover import Kernels
from steersman.types import FloatArray


class _Linearised(Kernels):
    """The embedded simulator, which keeps the derivatives of its last step."""

    def __init__(self, driver: FleetDriver) -> None:
        super().__init__(driver.mover.vehicle)
        self.derived = make_derived(driver.n)

    def step(self, world: World, fleet: Fleet, lesson: Lesson | None, actions: FloatArray) -> None:
        """One call of a kernel."""
        assert lesson is not None
        learn(self.bound(world, fleet, lesson), self.derived, actions)


class Recorded:
    """The last steps of a fleet, and the slopes of its rewards at its actions.

    Attributes:
        tape: what was kept of the steps.
        inputs: (H, N, features) network inputs before each step.
        next_inputs: (H, N, features) those after it, at the end of a drive the last ones.
        rewards: (H, N).
    """

    def __init__(self, driver: FleetDriver, horizon: int) -> None:
        """Keep ``horizon`` steps of a fleet, which from now on is moved with derivatives.

        Raises:
            ConfigError: its plant is not the embedded simulator, a base controller is corrected,
                or a formula cannot be derived.
        """
        problem = driver.problem
        if not problem.plant.embedded:
            raise ConfigError(
                f"{problem.plant.kind!r} has no derivatives; plant=simulator has",
                ("problem", "plant"),
            )
        if problem.base is not None:
            raise ConfigError(
                "a base controller has no derivatives; set action to rate or direct",
                ("problem", "action"),
            )
        self._mover = _Linearised(driver)
        driver.simulation.mover = self._mover
        self._driver, self._late = driver, problem.sensor.periods(driver.dt)
        self._slopes = kept.Slopes(problem.layout.slopes, problem.task.slopes())
        self.tape = kept.make_tape(driver.fleet, horizon)
        self._adjoint = kept.make_adjoint(self.tape, self._slopes)
        self.inputs = np.zeros((horizon, *driver.fleet.inputs.shape))
        self.next_inputs = np.zeros_like(self.inputs)
        self.rewards = np.zeros(self.inputs.shape[:2])

    def before(self, t: int) -> None:
        """Keep what step ``t`` finds."""
        fleet = self._driver.fleet
        self.inputs[t] = fleet.inputs
        for name in kept.BEFORE:
            getattr(self.tape, name)[t] = getattr(fleet, name)

    def after(self, t: int, actions: FloatArray) -> None:
        """Keep what step ``t`` left, before drives that ended begin anew."""
        fleet, tape = self._driver.fleet, self.tape
        for name in kept.AFTER:
            getattr(tape, name)[t] = getattr(fleet, name.removeprefix("next_"))
        tape.jacobian[t], tape.actions[t] = self._mover.derived.jacobian, actions
        self.next_inputs[t], self.rewards[t] = fleet.inputs, fleet.reward[:, 0]

    def pull(
        self,
        weights: FloatArray,
        ends: FloatArray,
        through: Callable[[int, FloatArray], FloatArray],
    ) -> FloatArray:
        """The slopes of a loss at the actions, (H, N).

        Args:
            weights: (H, N) the loss's slopes at the rewards.
            ends: (H, N, features) its slopes at ``next_inputs`` where a drive or the tape ends,
                zero elsewhere; changed.
            through: maps a step and slopes at its actions (N,) to slopes at its inputs
                (N, features).
        """
        driver, tape, adjoint, slopes = self._driver, self.tape, self._adjoint, self._slopes
        for each in (adjoint.state, adjoint.delayed, adjoint.places, adjoint.rows):
            each[:] = 0.0
        out = np.zeros_like(weights)
        last = len(weights) - 1
        for t in range(last, -1, -1):
            kernel.cut(tape, t, adjoint)
            if ends[t].any():
                self._pull_inputs(t, self.next_inputs[t], ends[t], after=True)
            kernel.pull_step(
                driver.world, driver.lesson, slopes, tape, t, self._late, weights[t], adjoint
            )
            out[t] = adjoint.action
            self._pull_inputs(t, self.inputs[t], through(t, adjoint.action), after=False)
        return out

    def _pull_inputs(self, t: int, inputs: Any, weights: Any, *, after: bool) -> None:
        kernel.pull_inputs(
            self._driver.lesson,
            self._slopes,
            self.tape,
            (t, self._late, after),
            inputs,
            weights,
            self._adjoint,
        )
