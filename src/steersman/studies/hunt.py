"""The stages of a falsification's search, from the nominal to the checks of what it found."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from steersman.bench.grip import demanded_grip
from steersman.bench.suite import derived_seed
from steersman.engine.jobs import PIECE_SIZE, Workers
from steersman.engine.work import Job, Tell
from steersman.studies.perturbation import AXES, Point, norm
from steersman.studies.tried import Tried, drive, key
from steersman.types import FloatArray

if TYPE_CHECKING:
    from steersman.studies.falsify import FalsifyConfig

# Share of an axle's grip up to which a drive that fails is the controller's failure.
MOST_GRIP = 0.9
# Called after each drive with: drives done, drives planned at most, what was found so far.
Progress: TypeAlias = Callable[[int, int, str], None]

# Share of a failure's norm at which its ray is tried for a milder one.
_BELOW = 0.98
# Halvings of the way to a point, to find where grip ends on it.
_HALVINGS = 10


# In parallel: a quantity and a side of it to bracket, or a point to drive.
Task: TypeAlias = "tuple[str, float] | Point"


class Bracket(NamedTuple):
    """A quantity that is disturbed alone, to one of its sides."""

    name: str
    failing: float | None
    """Smallest coordinate that was found to fail; None if the end of the range does not."""
    holding: float
    """Nearest coordinate below it that does not fail."""
    at_grip: bool = False
    """Whether its range ends where grip does, before the end that was stated."""


class Search:
    """The stages of a search, and every point that they have driven."""

    def __init__(
        self,
        config: FalsifyConfig,
        kept: Mapping[str, Tried],
        keep: Callable[[Tried], None],
        progress: Progress | None = None,
        workers: Workers | None = None,
    ) -> None:
        """Nothing is driven yet.

        Args:
            config: what is driven, and how far it is disturbed.
            kept: drives that are not repeated, by their keys.
            keep: called with each new drive.
            progress: called after each drive.
            workers: drive in parallel what does not depend on each other; the search is the same.
        """
        self.config, self.run = config, config.run()
        self.names = config.ranges.names()
        self.tried: dict[str, Tried] = {}
        self._kept, self._keep, self._progress = dict(kept), keep, progress
        self._workers = workers
        # What the undisturbed run needs is not too much for another to need.
        self._most = max(MOST_GRIP, demanded_grip(self.run))
        self._stage, self._before, self._planned, self._within = "nominal", 0, 1, 0

    def drive(self, point: Point) -> Tried:
        """Drive a point, or recall it."""
        name = key(point, self.names)
        row = self._kept.get(name)
        if row is None:
            config = self.config.ranges.disturbed(self.run, point)
            row = drive(self._stage, point, config, self._most)
            self._add(row)
        self.tried.setdefault(name, row)
        self._tell()
        return row

    def _add(self, row: Tried) -> None:
        self._kept[key(row.point, self.names)] = row
        self._keep(row)

    def _ahead(self, tasks: Sequence[Task], drives: int) -> None:
        """Do tasks of so many drives each in parallel, if they are worth it; they are recalled."""
        size = drives * self._kept[key(self._point(), self.names)].seconds
        if self._workers is None or not self._workers.parallel or size * len(tasks) <= PIECE_SIZE:
            return
        jobs = [Job(str(k), (self._stage, task), size) for k, task in enumerate(tasks)]
        work = partial(_task, self.config, dict(self._kept))
        self._workers.run(work, jobs, listener=lambda _, row: self._add(row))

    def mildest(self) -> Tried | None:
        """The failure with the smallest norm."""
        failed = (row for row in self.tried.values() if row.failed)
        return min(failed, key=lambda row: row.norm, default=None)

    def nominal(self) -> Tried:
        """The undisturbed run."""
        return self.drive(self._point())

    def singles(self) -> list[Bracket]:
        """Each quantity disturbed alone, to each of its sides."""
        sides = [(name, side) for name in self.names for side in AXES[name].sides]
        self._begin("single", len(sides) * (1 + self.config.bisections))
        self._ahead(sides, 1 + self.config.bisections)
        return [self.bracket(name, side) for name, side in sides]

    def bracket(self, name: str, side: float) -> Bracket:
        """One quantity disturbed alone, to one side."""
        low, high, end = 0.0, None, self._within_grip(self._point(**{name: side}))
        reached = end[name]
        if self.drive(end).failed:
            low, high = self._bisect(self._point(), end)
        holding = reached if high is None else reached * low
        failing = None if high is None else reached * high
        return Bracket(name, failing, holding, at_grip=reached != side)

    def _within_grip(self, point: Point) -> Point:
        """The point, or where on the way to it grip ends: beyond, no controller can be blamed."""

        def enough(share: float) -> bool:
            nearer = {name: share * u for name, u in point.items()}
            return demanded_grip(self.config.ranges.disturbed(self.run, nearer)) <= self._most

        if enough(1.0):
            return point
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if enough(middle) else (low, middle)
        return {name: low * u for name, u in point.items()}

    def explore(self) -> None:
        """All quantities at once: the sampler learns from what was driven so far.

        Points that are not milder than the mildest single failure are drawn in along their ray.
        """
        import optuna
        from optuna.distributions import FloatDistribution

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self._begin("search", self.config.trials)
        single = self.mildest()
        end, radius = (1.0, self._reach()) if single is None else (single.norm, single.norm)
        space = {n: FloatDistribution(end * min(0.0, *AXES[n].sides), end) for n in self.names}
        seed = derived_seed(self.config.seed, "search")
        study = optuna.create_study(
            sampler=optuna.samplers.TPESampler(seed=seed, multivariate=True)
        )
        for row in self.tried.values():
            if all(space[name].low <= u <= end for name, u in row.point.items()):
                study.add_trial(
                    optuna.create_trial(
                        params=dict(row.point),
                        distributions=dict(space),
                        value=self._score(row),
                    )
                )
        for _ in range(self.config.trials):
            trial = study.ask(dict(space))
            point = {name: float(trial.params[name]) for name in self.names}
            if norm(point) >= radius:
                inward = _BELOW * radius / norm(point)
                point = {name: inward * u for name, u in point.items()}
            study.tell(trial, self._score(self.drive(self._within_grip(point))))

    def pull_in(self) -> None:
        """Bring the mildest failure nearer: along its ray, each coordinate, along its ray."""
        steps = 1 + self.config.bisections
        self._begin("pull in", steps * (2 + len(self.names)))
        self._along_ray()
        found = self.mildest()
        for name in self.names if found is not None else ():
            assert found is not None
            point = found.point
            without = point | {name: 0.0}
            if point[name] and not self.drive(without).failed:
                self._bisect(without, point)
            found = self.mildest()
        self._along_ray()

    def check(self) -> None:
        """Points drawn evenly from the ball below the mildest failure, or within the ranges."""
        self._begin("check", self.config.checks)
        rng = np.random.default_rng(derived_seed(self.config.seed, "check"))
        draws = []
        for _ in range(self.config.checks):
            direction = rng.normal(size=len(self.names))
            draws.append((direction, rng.uniform() ** (1.0 / len(self.names))))
        self._ahead([self._milder(*draw) for draw in draws], 1)
        for draw in draws:
            if self.drive(self._milder(*draw)).failed:
                self._along_ray()

    def _milder(self, direction: FloatArray, share: float) -> Point:
        """The point in a direction at a share of the mildest failure's norm, or of the ranges'."""
        found = self.mildest()
        radius = self._reach() if found is None else found.norm
        point = self._inside(direction * (share * radius / float(np.linalg.norm(direction))))
        return self._within_grip(point)

    def _inside(self, values: Any) -> Point:
        """Coordinates brought into the ranges, which makes them milder, if anything."""
        point = {}
        for name, u in zip(self.names, values.tolist(), strict=True):
            low = min(0.0, *AXES[name].sides)
            point[name] = min(max(u if low else abs(u), low), 1.0)
        return point

    def _along_ray(self) -> None:
        """Bisect between the nominal and the mildest failure."""
        found = self.mildest()
        if found is not None and found.norm:
            self._bisect(self._point(), found.point)

    def _bisect(self, near: Point, far: Point) -> tuple[float, float]:
        """On the way from ``near``, which does not fail, to ``far``, which does.

        Returns:
            Shares of the way: the last that did not fail, and the first that did.
        """
        low, high = 0.0, 1.0
        for _ in range(self.config.bisections):
            middle = 0.5 * (low + high)
            point = {name: u + middle * (far[name] - u) for name, u in near.items()}
            if self.drive(point).failed:
                high = middle
            else:
                low = middle
        return low, high

    def _score(self, row: Tried) -> float:
        """What the sampler makes small: mild failures first, then what nearly fails."""
        if row.failed:
            return row.norm
        return self._reach() + 2.0 - min(row.max_error_m / self.config.corridor, 1.0)

    def _reach(self) -> float:
        """Norm of the farthest corner of the ranges."""
        return math.sqrt(len(self.names))

    def _point(self, **changes: float) -> Point:
        return dict.fromkeys(self.names, 0.0) | changes

    def _begin(self, stage: str, planned: int) -> None:
        self._stage, self._within = stage, 0
        self._before += self._planned
        self._planned = planned

    def _tell(self) -> None:
        self._within += 1
        if self._progress is None:
            return
        found = self.mildest()
        words = "no failure yet" if found is None else f"mildest failure at {found.norm:.3f}"
        done = self._before + min(self._within, self._planned)
        self._progress(done, most_drives(self.config), f"{self._stage}, {words}")


def _task(
    config: FalsifyConfig, kept: Mapping[str, Tried], given: tuple[str, Task], tell: Tell
) -> None:
    stage, task = given
    search = Search(config, kept, tell)
    search._stage = stage
    if isinstance(task, tuple):
        search.bracket(*task)
    else:
        search.drive(task)


def most_drives(config: FalsifyConfig) -> int:
    """Drives of a search at most, those after failing checks apart."""
    names = config.ranges.names()
    sides = sum(len(AXES[name].sides) for name in names)
    steps = 1 + config.bisections
    return 1 + steps * (sides + 2 + len(names)) + config.trials + config.checks
