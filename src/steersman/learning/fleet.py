"""N vehicles that learn: episodes begin and end here, the kernel does the steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.controllers.base import ControllerComponent
from steersman.kernels import encode, formula, observe
from steersman.kernels import path as paths
from steersman.kernels import speed as speed_kernel
from steersman.kernels import step as kernel
from steersman.kernels import vehicle as car
from steersman.kernels.step import Fleet
from steersman.kernels.vehicle import GRAVITY
from steersman.learning.demonstration import (
    Demonstrator,
    demonstrated_action,
    demonstrated_correction,
)
from steersman.learning.mover import Shared, make_mover
from steersman.learning.problem import Problem
from steersman.learning.snapshot import Tree, fill
from steersman.profiles import Profile, write_profile
from steersman.types import FloatArray, Pose

_UNCAPPED = 1e6
# Share of the grip that a speed cap asks for on a slippery road.
_USED_GRIP = 0.6


class Start(NamedTuple):
    """How an episode of one vehicle begins."""

    road: int
    s: float
    offset: float
    heading: float
    profile: Profile
    speed: float


def _lateral_cap(profile: Profile) -> float:
    """Lateral acceleration that a profile's speed cap allows [m/s^2]; infinite without a cap."""
    return math.inf if profile.a_lat_max is None else profile.a_lat_max * profile.cap_scale**2


class FleetDriver:
    """Drives the vehicles of a :class:`Problem`; environments are thin shells around it."""

    def __init__(self, problem: Problem, n: int, shared: Shared | None = None) -> None:
        """Prepare ``n`` vehicles; ``seed`` and ``reset`` before the first step.

        ``shared`` is a plant to drive instead of the problem's own; who made it closes it.

        Raises:
            ConfigError: the plant drives one vehicle, and more are wanted.
            PlantError: it cannot be reached.
        """
        self.problem = problem
        self.n = n
        self.dt = problem.plant.dt
        self.world = problem.world(n)
        self.fleet: Fleet = kernel.empty_fleet(n, self.world.encoding, problem.sensor.count)
        self._a_lat = next((s.a_lat_max for s in self._capped()), None)
        self.mover = make_mover(problem, n, shared)
        self._base = self.mover.vehicle.row()
        errors = problem.sensor.error_range > 0.0
        self._shifts = np.zeros((n, problem.sensor.count if errors else 0, 2))
        self._levels = np.ones(n)
        self._rngs = [np.random.default_rng(0) for _ in range(n)]
        demonstration = problem.demonstration
        self.demonstrates = demonstration.enabled
        """Whether a demonstrator proposes a steering at every step."""
        self._corrected = self._proposer(problem.base)
        # A base that demonstrates itself is asked once.
        itself = demonstration.enabled and demonstration.controller == problem.base
        other = demonstration.controller if demonstration.enabled and not itself else None
        self._demonstrator = self._corrected if itself else self._proposer(other)

    @property
    def source(self) -> str:
        """Whose numbers it gives."""
        shared = self.mover.shared
        return self.problem.plant.source() if shared is None else shared.plant.source

    def _proposer(self, controller: ControllerComponent | None) -> Demonstrator | None:
        if controller is None:
            return None
        return Demonstrator(controller, self.mover.vehicle, self.dt)

    def _capped(self) -> list[Profile]:
        rng = np.random.default_rng(0)
        draws = [s.draw(rng, self.problem.episode_time) for s in self.problem.speeds]
        return [p for p in draws if p.a_lat_max is not None]

    def seed(self, seed: int) -> None:
        """Give every vehicle its own generator, all from one seed."""
        self.seed_each(np.random.SeedSequence(seed).spawn(self.n))

    def seed_each(self, children: Sequence[np.random.SeedSequence]) -> None:
        """Give every vehicle the generator of its own seed."""
        self._rngs = [np.random.default_rng(child) for child in children]

    def reset(self, i: int) -> None:
        """Begin a new episode of vehicle ``i``."""
        problem, rng = self.problem, self._rngs[i]
        self._vary(i, rng)
        start = self._draw_start(rng)
        slippery, limit = problem.spread.slippery, problem.spread.a_lat_max
        if slippery > 0.0 and rng.uniform() < slippery:
            start = start._replace(profile=self._make_slippery(i, start.profile, rng))
        if limit is not None and _lateral_cap(start.profile) > limit:
            self._make_nominal(i)
        self.begin(i, start)
        if not problem.sensor.redraw and self._shifts.shape[1]:
            self._shifts[i] = self._levels[i] * problem.sensor.draw(rng)
        self._look(i)
        self._propose(i, restart=True)

    def _draw_start(self, rng: np.random.Generator) -> Start:
        problem, spread = self.problem, self.problem.spread
        road = int(rng.integers(len(problem.roads)))
        length = self.world.paths.meta[road, paths.LENGTH]
        closed = self.world.paths.meta[road, paths.CLOSED] > 0.0
        s = 0.0
        if problem.start == "anywhere":
            s = float(rng.uniform(0.0, length if closed else 0.7 * length))
        source = problem.speeds[int(rng.integers(len(problem.speeds)))]
        profile = source.draw(rng, problem.episode_time)
        offset, heading = rng.uniform(-1.0, 1.0, 2) * (spread.offset, spread.heading)
        speed = math.nan
        if profile.throttle is not None:
            speed = source.start_speed(problem.roads[road], s)
        return Start(road, s, float(offset), float(heading), profile, speed)

    def _vary(self, i: int, rng: np.random.Generator) -> None:
        """Draw this episode's car, delay and sensor."""
        spread = self.problem.spread
        row = self.world.vehicles.rows[i]
        row[:] = self._base
        self._levels[i] = 1.0
        if spread.nominal > 0.0 and rng.uniform() < spread.nominal:
            self._make_nominal(i)
            return
        if spread.waypoints > 0.0:
            self._levels[i] = 1.0 - rng.uniform(0.0, spread.waypoints)
        draws = 1.0 + rng.uniform(-1.0, 1.0, 5) * (
            spread.mass,
            spread.yaw_inertia,
            spread.stiffness,
            spread.stiffness,
            spread.friction,
        )
        for column, factor in zip(
            (car.MASS, car.INERTIA, car.C_F, car.C_R, car.MU), draws, strict=True
        ):
            row[column] *= factor
        extra = int(rng.integers(round(spread.delay / self.problem.plant.h) + 1))
        self.fleet.delay[i] = self.problem.plant.delay_of(self.problem.vehicle) + extra

    def _make_slippery(self, i: int, profile: Profile, rng: np.random.Generator) -> Profile:
        """Lower the friction; the profile as a driver would drive it there."""
        row = self.world.vehicles.rows[i]
        least, own = self.problem.spread.least_friction, row[car.MU]
        row[car.MU] = min(least * (own / least) ** rng.uniform(), own)
        cap = _USED_GRIP * row[car.MU] * GRAVITY
        if profile.a_lat_max is None or _lateral_cap(profile) <= cap:
            return profile
        return profile._replace(cap_scale=math.sqrt(cap / profile.a_lat_max))

    def _make_nominal(self, i: int) -> None:
        """The car, delay and sensor without any spread."""
        self.world.vehicles.rows[i] = self._base
        self.fleet.delay[i] = self.problem.plant.delay_of(self.problem.vehicle)
        self._levels[i] = 1.0 - self.problem.spread.waypoints

    def begin(self, i: int, start: Start) -> None:
        """Put vehicle ``i`` at a start, in the steady turn of the road there."""
        world, fleet = self.world, self.fleet
        fleet.path[i] = start.road
        write_profile(
            self._scaled(start.profile), i, world.speed.rows, world.speed.times, world.speed.speeds
        )
        speed = start.speed
        if math.isnan(speed):
            speed = speed_kernel.target_speed(world.speed, i, world.paths, start.road, 0.0, start.s)
        x, y, psi, kappa = paths.at(world.paths, start.road, start.s)
        pose = Pose(
            x - start.offset * math.sin(psi), y + start.offset * math.cos(psi), psi + start.heading
        )
        self.mover.begin(world, fleet, i, pose, speed, kappa)
        state, clock = fleet.state[i], fleet.clock[i]
        clock[kernel.CLOCK_STEPS] = 0.0
        clock[kernel.CLOCK_INTEGRAL] = state[car.THROTTLE] - state[car.BRAKE]
        clock[kernel.CLOCK_LIMIT] = self.problem.episode_time
        observe.track(world.paths, start.road, state, start.s, fleet.tracking[i])
        fleet.memory[i] = 0.0
        fleet.ended[i] = kernel.RUNNING

    def _scaled(self, profile: Profile) -> Profile:
        """The profile's cap relative to the one that the roads' table was made with."""
        if profile.a_lat_max is None or self._a_lat is None:
            return profile._replace(cap_scale=_UNCAPPED)
        return profile._replace(
            cap_scale=profile.cap_scale * math.sqrt(profile.a_lat_max / self._a_lat)
        )

    def _look(self, i: int) -> None:
        self._draw_shift(i)
        kernel.look(self.world, self.fleet, i, self._shifts[i])

    def _draw_shift(self, i: int) -> None:
        if self._shifts.shape[1] and self.problem.sensor.redraw:
            self._shifts[i] = self._levels[i] * self.problem.sensor.draw(self._rngs[i])

    def _propose(self, i: int, *, restart: bool = False) -> None:
        """Ask base and demonstrator what they would do now with vehicle ``i``."""
        fleet, base, demonstrator = self.fleet, self._corrected, self._demonstrator
        if base is not None:  # the last state of an episode has its feature, too
            fleet.base[i] = self._ask(base, i, restart=restart)
            encode.tell_base(
                self.world.encoding, fleet.rows[i], fleet.memory[i], fleet.base[i], fleet.inputs[i]
            )
            encode.normalise(fleet.inputs[i, -1:], self.world.scale[-1:])
        if demonstrator is not None and fleet.ended[i] == kernel.RUNNING:
            same = demonstrator is base
            fleet.demo[i] = fleet.base[i] if same else self._ask(demonstrator, i, restart=restart)

    def _ask(self, proposer: Demonstrator, i: int, *, restart: bool) -> float:
        if restart:
            proposer.restart(i)
        else:
            proposer.executed(i, float(self.fleet.memory[i, encode.LAST_COMMAND]))
        time = self.fleet.clock[i, kernel.CLOCK_STEPS] * self.dt
        return proposer.propose(i, self.fleet.rows[i], time, self.problem.sensor.spacing)

    def step(self, actions: FloatArray) -> None:
        """One control step of all vehicles; the caller resets those whose episode ended."""
        for i in range(self.n):
            self._draw_shift(i)
        self.mover.step(self.world, self.fleet, actions, self._shifts)
        formula.check()
        for i in range(self.n):
            self._propose(i)

    def last_commands(self) -> FloatArray:
        """Steering executed in the last step, (n,)."""
        return self.fleet.memory[:, encode.LAST_COMMAND]

    def demonstrated_actions(self) -> FloatArray:
        """The demonstrator's action for the present observations, (n,) in [-1, 1]."""
        fleet, world = self.fleet, self.world
        if world.authority > 0.0:
            return demonstrated_correction(fleet.demo, fleet.base, world.authority)
        return demonstrated_action(fleet.demo, self.last_commands(), world.rate_limit, self.dt)

    def _arrays(self) -> dict[str, Any]:
        """Every array that changes while driving."""
        speed = self.world.speed
        return {
            **self.fleet._asdict(),
            "cars": self.world.vehicles.rows,
            "speed_rows": speed.rows,
            "speed_times": speed.times,
            "speed_speeds": speed.speeds,
            "shifts": self._shifts,
            "levels": self._levels,
        }

    def snapshot(self) -> dict[str, Any]:
        """All that changes while driving."""
        proposers = {"base": self._corrected, "demonstrator": self._demonstrator}
        return {
            "arrays": self._arrays(),
            "generators": [rng.bit_generator.state for rng in self._rngs],
            **{name: {} if p is None else p.snapshot() for name, p in proposers.items()},
        }

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot."""
        fill(self._arrays(), saved["arrays"])
        for rng, state in zip(self._rngs, saved["generators"], strict=True):
            rng.bit_generator.state = state
        if self._corrected is not None:
            self._corrected.restore(saved["base"])
        if self._demonstrator is not None:
            self._demonstrator.restore(saved["demonstrator"])
        self.mover.lose()

    def close(self) -> None:
        """Release the plant, if there is one; may be called twice."""
        self.mover.close()
