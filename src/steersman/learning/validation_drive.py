"""The validation drives as they went, so that the worst of them can be seen."""

from __future__ import annotations

from typing import Any

import numpy as np

from steersman import episode as ending
from steersman.episode import Episode
from steersman.episode_rows import columns_of
from steersman.kernels import world as kernel
from steersman.learning.fleet import FleetDriver
from steersman.outcome import end_of
from steersman.provenance import provenance
from steersman.types import FloatArray


class FleetRecord:
    """States and commands of a fleet, step by step, each vehicle's to the end of its drive."""

    def __init__(self, driver: FleetDriver) -> None:
        """Begin at the present state, the first of every drive."""
        self._driver = driver
        self._rows, self._lead = [self._row()], [driver.fleet.lead.copy()]
        self._more: list[FloatArray] = []
        self._steps = np.zeros(driver.n, dtype=np.int64)
        self._distance = np.zeros(driver.n)
        self._ended = np.zeros(driver.n, dtype=np.int64)

    def _row(self) -> FloatArray:
        fleet = self._driver.fleet
        return np.concatenate((fleet.state, fleet.tracking), axis=1)

    def stepped(self, alive: Any) -> None:
        """After a step of the vehicles that are ``alive`` (n,) bool."""
        driver, fleet = self._driver, self._driver.fleet
        more = np.zeros((driver.n, 8))  # no time was measured, and each decision is its own
        more[:, 0], more[:, 1] = len(self._more) * driver.dt, fleet.sent
        more[:, 2:4] = fleet.command[:, 1:3]
        self._rows.append(self._row())
        self._lead.append(fleet.lead.copy())
        self._more.append(more)
        self._steps += alive
        self._distance[alive] = fleet.clock[alive, kernel.CLOCK_DISTANCE]
        self._ended[alive] = fleet.ended[alive]

    def episode(self, i: int) -> Episode:
        """The drive of vehicle ``i``."""
        driver, problem, steps = self._driver, self._driver.problem, int(self._steps[i])
        rows = np.array([row[i] for row in self._rows[:steps]])
        more = np.array([row[i] for row in self._more[:steps]])
        lead = np.array([row[i] for row in self._lead[:steps]])
        road = problem.roads[int(driver.fleet.path[i])]
        parts = {"path": road, "vehicle": problem.vehicle}
        # With errors of its own the sensor cannot be measured again.
        if not problem.disturbances and problem.sensor.make(1, 0) is None:
            parts["sensor"] = problem.sensor
        config = {name: part.model_dump(mode="json") for name, part in parts.items()}
        meta = {"config": config, "plant": driver.source, **provenance()}
        end = end_of(int(self._ended[i])) or ending.DURATION
        return Episode(
            columns_of(rows, more, lead), end, float(self._distance[i]), driver.dt, road.length,
            road.closed, meta,
        )  # fmt: skip
