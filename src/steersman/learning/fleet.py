"""N vehicles that learn: starts and spread of their episodes, base and demonstrator."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from steersman.controllers.adjustment import Adjuster
from steersman.controllers.base import ControllerComponent
from steersman.kernels import encode, formula
from steersman.kernels import path as paths
from steersman.kernels import speed as speed_kernel
from steersman.kernels import step as lessons
from steersman.kernels import world as kernel
from steersman.kernels.fleet import Fleet
from steersman.lead import most_points
from steersman.learning.adjusted import AdjustedBase
from steersman.learning.demonstration import (
    Demonstrator,
    demonstrated_action,
    demonstrated_correction,
)
from steersman.learning.privilege import Truth
from steersman.learning.problem import Problem
from steersman.learning.snapshot import Tree, fill
from steersman.learning.spread import CarSpread, lateral_cap
from steersman.learning.starts import FleetStart, draw_start
from steersman.plants.mover import Seat, Shared
from steersman.profiles import Profile, write_profile
from steersman.speed_share import action_for, share_of, share_under
from steersman.types import Decision, FloatArray, Pose
from steersman.world import Simulation

_UNCAPPED = 1e6


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
        self.n, self.dt = n, problem.plant.dt
        self.lesson = problem.lesson()
        self.simulation = Simulation(
            problem.plant,
            problem.vehicle,
            problem.sensor,
            problem.roads,
            problem.demands(n),
            n,
            corridor=problem.corridor,
            disturbances=problem.disturbers(n),
            shared=shared,
            lesson=self.lesson,
            memory=encode.memory_size(self.lesson.encoding),
            wishes=problem.joint,
            lead=most_points(problem.leads, problem.episode_time),
        )
        self.world, self.mover = self.simulation.world, self.simulation.mover
        self.fleet: Fleet = self.simulation.fleet
        if isinstance(self.mover, Seat):
            try:
                self.mover.enter()
            except BaseException:  # a Ctrl-C too: nothing else could close the plant
                if shared is None:
                    self.mover.close()
                raise
        self._a_lat = next((s.a_lat_max for s in self._capped()), None)
        self._spread = CarSpread(problem, self.world, self.fleet, self.mover.vehicle)
        demonstration = problem.demonstration
        self.demonstrates = demonstration.enabled
        """Whether a demonstrator proposes a steering at every step."""
        self.base_share = 1.0
        """Share of the base's steering that the actions correct."""
        self._corrected = self._proposer(problem.corrected)
        self._base_shares = np.ones(n)  # of the wished speed, which the base allows
        self._adjusted: AdjustedBase | None = None
        self._shown: FloatArray = np.zeros(0)
        if problem.parameters and problem.base is not None:
            chosen, vehicle = problem.adjustments(), problem.nominal or self.mover.vehicle
            self._adjusted = AdjustedBase(
                Adjuster(problem.base, chosen, vehicle, self.dt), problem.prices
            )
            if self.demonstrates:
                self._shown = np.array([each.action(demonstration.controller) for each in chosen])
        # A base that is the demonstrator too computes once.
        truth = Truth(self.simulation, self.mover.vehicle) if demonstration.privileged else None
        same = demonstration.controller == problem.corrected and truth is None
        shown = demonstration.controller if demonstration.enabled else None
        self._demonstrator = self._corrected if shown and same else self._proposer(shown, truth)
        self._proposes = self._corrected is not None or self._demonstrator is not None

    @property
    def source(self) -> str:
        """The plant in words, as results state it."""
        of = self.mover.shared
        return self.problem.plant.source() if of is None else of.plant.source

    def _proposer(
        self, controller: ControllerComponent | None, truth: Truth | None = None
    ) -> Demonstrator | None:
        if controller is None:
            return None
        return Demonstrator(controller, self.problem.nominal or self.mover.vehicle, self.dt, truth)

    def _capped(self) -> list[Profile]:
        rng = np.random.default_rng(0)
        draws = [s.draw(rng, self.problem.episode_time) for s in self.problem.speeds]
        return [p for p in draws if p.a_lat_max is not None]

    def seed(self, seed: int) -> None:
        """Give every vehicle its own generator, all from one seed."""
        self.seed_each(np.random.SeedSequence(seed).spawn(self.n))

    def seed_each(self, children: Sequence[np.random.SeedSequence]) -> None:
        """Give every vehicle the generator of its own seed."""
        self.simulation.rngs = [np.random.default_rng(child) for child in children]

    def reset(self, i: int, change: Callable[[FleetStart], FleetStart] | None = None) -> None:
        """Begin a new episode of vehicle ``i``; ``change`` makes its start from the drawn one."""
        problem, rng = self.problem, self.simulation.rngs[i]
        self._spread.vary(i, rng)
        start = draw_start(problem, self.world, rng)
        start = start if change is None else change(start)
        slippery, limit = problem.spread.slippery, problem.spread.a_lat_max
        if slippery > 0.0 and rng.uniform() < slippery:
            start = start._replace(profile=self._spread.make_slippery(i, start.profile, rng))
        if limit is not None and lateral_cap(start.profile) > limit:
            self._spread.make_nominal(i)
        self.begin(i, start)
        self.look(i)
        if self._adjusted is not None:
            self._adjusted.restart(i)
        self._propose(i, restart=True)

    def begin(self, i: int, start: FleetStart) -> None:
        """Put vehicle ``i`` at a start, in the steady turn of the road there."""
        world, road = self.world, start.road
        profile, speed = self._scaled(start.profile), start.speed
        x, y, psi, _ = paths.at(world.paths, road, start.s)
        pose = Pose(
            x - start.offset * math.sin(psi), y + start.offset * math.cos(psi), psi + start.heading
        )
        if math.isnan(speed):
            write_profile(profile, i, world.speed.rows, world.speed.times, world.speed.speeds)
            wished = speed_kernel.target_speed(world.speed, i, world.paths, road, 0.0, start.s)
            speed = start.share * wished
        self.simulation.begin(i, road, start.s, pose, speed, profile, start.lead)
        length, closed = world.paths.meta[road, [paths.LENGTH, paths.CLOSED]]
        goal = math.inf if closed > 0.0 else length - start.s
        self.simulation.limit(i, self.problem.episode_time, goal)

    def _scaled(self, profile: Profile) -> Profile:
        """The profile's cap relative to the one that the roads' table was made with."""
        if profile.road is not None and profile.a_lat_max is None:
            return profile
        if profile.a_lat_max is None or self._a_lat is None:
            return profile._replace(cap_scale=_UNCAPPED)
        return profile._replace(
            cap_scale=profile.cap_scale * math.sqrt(profile.a_lat_max / self._a_lat)
        )

    def look(self, i: int) -> None:
        """Measure vehicle ``i`` where it is, and make its features."""
        self.simulation.look(i)
        lessons.encode(self.lesson, self.fleet, i)

    def _propose(self, i: int, *, restart: bool = False) -> None:
        """Compute the steering of base and demonstrator for the present state of vehicle ``i``."""
        fleet, base, demonstrator = self.fleet, self._corrected, self._demonstrator
        proposed = Decision(0.0)
        if base is not None:  # the last state of an episode has its feature, too
            proposed = self._ask(base, i, restart=restart)
            fleet.base[i] = self.base_share * proposed.steer
            encode.tell_base(
                self.lesson.encoding, fleet.rows[i], fleet.memory[i], fleet.base[i], fleet.inputs[i]
            )
            encode.normalise(fleet.inputs[i, -1:], self.lesson.scale[-1:])
            if self.problem.joint:
                self._base_shares[i] = share_of(proposed.speed_limit, fleet.wishes[i, 0])
        if demonstrator is not None and fleet.ended[i] == kernel.RUNNING:
            if demonstrator is not base:
                proposed = self._ask(demonstrator, i, restart=restart)
            fleet.demo[i] = proposed.steer
            if self.problem.joint:
                fleet.demo_shares[i] = share_of(proposed.speed_limit, fleet.wishes[i, 0])

    def _ask(self, proposer: Demonstrator, i: int, *, restart: bool) -> Decision:
        if restart:
            proposer.restart(i)
        else:
            proposer.executed(i, float(self.fleet.memory[i, encode.LAST_COMMAND]))
        return proposer.propose(i, self.simulation.observation(i))

    def step(self, actions: FloatArray) -> None:
        """One step of all vehicles under ``actions`` (n, m) in [-1, 1].

        The caller resets those whose episode ended. Under an action that holds for several control
        steps, the reward is their mean.
        """
        if self._adjusted is None:
            self._once(actions.reshape(self.n, -1))
            return
        total, fleet = np.zeros_like(self.fleet.reward), self.fleet
        driven = np.zeros(self.n)
        for going in self.steps(actions):
            total[going] += fleet.reward[going]
            driven[going] += 1.0
        fleet.reward[:] = total / np.maximum(driven, 1.0)[:, None]

    def steps(self, actions: FloatArray) -> Iterator[Any]:
        """As :meth:`step`, with a pause after each control step.

        Yields:
            (n,) the vehicles that drove; where an action holds for several control steps, one whose
            episode has ended waits.
        """
        actions = actions.reshape(self.n, -1)
        if self._adjusted is None:
            self._once(actions)
            yield np.ones(self.n, dtype=bool)
        else:
            yield from self._adjusted.steps(self, actions)

    def _once(self, actions: FloatArray) -> None:
        """One control step under actions (n, m) of steering, and of speed where they are joint."""
        if self.problem.joint:
            self._limit(actions[:, 1])
        self.advance(np.ascontiguousarray(actions[:, 0]))

    def _limit(self, actions: FloatArray) -> None:
        """Limit the speeds of the next control step by actions (n,) in [-1, 1]."""
        fleet = self.fleet
        pairs = zip(actions.tolist(), self._base_shares.tolist(), strict=True)
        fleet.shares[:] = [share_under(action, base) for action, base in pairs]
        fleet.memory[:, encode.LAST_SHARE] = fleet.shares
        fleet.speed_limit[:] = fleet.shares * fleet.wishes[:, 0]

    def advance(self, commands: FloatArray) -> None:
        """One control step of the vehicles under commands (n,) as the kernels take them."""
        self.simulation.step(commands)
        formula.check()
        for i in range(self.n) if self._proposes else ():
            self._propose(i)

    def last_commands(self) -> FloatArray:
        """Steering executed in the last step, (n,)."""
        return self.fleet.memory[:, encode.LAST_COMMAND]

    def demonstrated_actions(self) -> FloatArray:
        """The demonstrator's action for the present observations, (n, m) in [-1, 1]."""
        fleet, lesson = self.fleet, self.lesson
        if self._adjusted is not None:
            return np.tile(self._shown, (self.n, 1))
        if lesson.authority > 0.0:
            shown = demonstrated_correction(fleet.demo, fleet.base, lesson.authority)
        else:
            last = self.last_commands()
            shown = demonstrated_action(fleet.demo, last, lesson.rate_limit, self.dt)
        if self.problem.joint:
            pairs = zip(fleet.demo_shares.tolist(), self._base_shares.tolist(), strict=True)
            return np.column_stack([shown, [action_for(share, base) for share, base in pairs]])
        return shown[:, None]

    def snapshot(self) -> dict[str, Any]:
        """All that changes while driving."""
        return {
            "arrays": self.simulation.arrays(),
            "base_shares": self._base_shares,
            **self.simulation.snapshot(),
            **{name: {} if p is None else p.snapshot() for name, p in self._kept().items()},
        }

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot."""
        fill(self.simulation.arrays(), saved["arrays"])
        self._base_shares[:] = saved["base_shares"]
        self.simulation.restore(saved)
        for name, proposer in self._kept().items():
            if proposer is not None:
                proposer.restore(saved[name])

    def _kept(self) -> dict[str, Demonstrator | AdjustedBase | None]:
        """What keeps states of its own, by its name in a snapshot."""
        return {"base": self._adjusted or self._corrected, "demonstrator": self._demonstrator}

    def close(self) -> None:
        """Release the plant, if there is one; may be called twice."""
        self.simulation.close()
