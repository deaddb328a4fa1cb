"""A base controller for each vehicle, of which the agent's actions set the parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from steersman.controllers.adjustment import Adjusted, Adjuster, field
from steersman.kernels import encode
from steersman.kernels import world as kernel
from steersman.kernels.reward import TOTAL
from steersman.learning.snapshot import Tree, changed, rebuilt
from steersman.types import FloatArray

if TYPE_CHECKING:
    from steersman.learning.fleet import FleetDriver


class AdjustedBase:
    """One base controller driving many vehicles, each under its own parameters."""

    def __init__(self, adjuster: Adjuster, prices: Mapping[str, float]) -> None:
        """The state before the first step is made once: it is immutable.

        ``prices`` are deducted from the reward: so much of a unit of each parameter, by its name.
        """
        self._adjuster, self._fresh, self._prices = adjuster, adjuster.begin(), prices
        self._now: dict[int, Adjusted] = {}

    def steps(self, driver: FleetDriver, actions: FloatArray) -> Iterator[Any]:
        """Drive the control steps for which actions (n, m) hold, with a pause after each.

        Yields:
            (n,) the vehicles that drove; one whose episode has ended waits.
        """
        fleet, commands = driver.fleet, np.empty(driver.n)
        for k in range(driver.problem.period):
            going = fleet.ended == kernel.RUNNING
            driving = np.flatnonzero(going).tolist()
            for i in driving:
                if k == 0:
                    self._now[i] = self._adjuster.adjust(self._now[i], actions[i])
                decision, self._now[i] = self._now[i].step(driver.simulation.observation(i))
                commands[i] = decision.steer
            if not driving:
                return
            driver.advance(commands)
            for i in driving:
                executed = float(fleet.memory[i, encode.LAST_COMMAND])
                self._now[i] = now = self._now[i].executed(executed)
                for name, price in self._prices.items():
                    fleet.reward[i, TOTAL] -= price * field(now.controller, name)
            yield going

    def restart(self, n: int) -> None:
        """Vehicle ``n`` begins a new episode, under the base's own parameters."""
        self._now[n] = self._fresh

    def snapshot(self) -> dict[str, Any]:
        """Action and state of each vehicle, without what ``init`` makes again."""
        return {
            str(n): {"action": now.action, "state": changed(now.state, now.fresh)}
            for n, now in self._now.items()
        }

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot."""
        for name, kept in saved.items():
            now = self._adjuster.adjust(self._fresh, kept["action"])
            state = rebuilt(kept["state"], now.fresh)
            self._now[int(name)] = now._replace(state=state, action=kept["action"])
