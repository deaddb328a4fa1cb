"""What the study found: the content of ``results.json``; numbers that are unknown are None."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator

import steersman as sm


def _known(value: Any) -> Any:
    return value if value is None or math.isfinite(value) else None


Number = Annotated[float | None, BeforeValidator(_known)]
Numbers = Sequence[Number]


# --------------------------------------------------------------------------------- trainings


class StudyTraining(sm.StoredResult):
    """The record of one training."""

    diverged: str | None
    """Why, if it did."""
    policy: bool
    """Whether it exported a policy."""
    curve: dict[str, Numbers]
    """The columns of its record, a row for each validation."""


class SeedInterval(sm.StoredResult):
    """A statistic over seeds with its 95 % bootstrap interval."""

    value: Number
    low: Number
    high: Number

    def apart(self, other: SeedInterval) -> bool:
        """Whether the two intervals have nothing in common; False where one is unknown."""
        if self.low is None or self.high is None or other.low is None or other.high is None:
            return False
        return self.high < other.low or self.low > other.high


class SeedSpread(sm.StoredResult):
    """Quartiles over the seeds that have a value, at every validation."""

    steps: Sequence[float] = ()
    low: Sequence[float] = ()
    median: Sequence[float] = ()
    high: Sequence[float] = ()
    n: Sequence[float] = ()
    """How many seeds have a value."""


class SeedCosts(sm.StoredResult):
    """What each seed spent until its validation error was that small; None: never."""

    threshold_m: float
    steps: Numbers
    seconds: Numbers
    off_track_resets: Numbers


class MethodResult(sm.StoredResult):
    """The trainings of one method; lists have a value for each seed."""

    label: str
    reward: str
    """Methods of the same reward may be compared by their losses."""
    ablation: bool
    seeds: int
    diverged: int
    best_mm: Numbers
    """Smallest validation error."""
    best_iqm: SeedInterval
    best_quartiles: Numbers
    last_mm: Numbers
    """Validation error at the end."""
    last_iqm: SeedInterval
    mean_over_training_iqm: SeedInterval
    resets: Numbers
    seconds: Numbers
    curves: dict[str, SeedSpread]
    reach: list[SeedCosts]


class CostSaving(sm.StoredResult):
    """What a method spends of one cost on the way to an error, beside DDPG alone."""

    alone_median: Number
    median: Number
    horizon: Number
    """What a seed that does not get there is charged."""
    saving: SeedInterval | None
    """Share that is saved; None where no seed of either got there."""


class Saving(sm.StoredResult):
    """What the demonstration saves on the way to a mean error."""

    threshold_m: float
    method: str
    alone: str = "ddpg"
    """The method without a demonstrator that it stands beside."""
    alone_reached: int
    """Seeds of DDPG alone that got there."""
    reached: int
    seeds: list[int]
    """Of DDPG alone, and of the method."""
    steps: CostSaving
    seconds: CostSaving
    off_track_resets: CostSaving


class SpreadSaving(sm.StoredResult):
    """Interquartile range over seeds of the best error, beside that of DDPG alone [mm]."""

    method: str
    alone: str = "ddpg"
    alone_mm: Number
    range_mm: Number
    alone_median_mm: Number
    median_mm: Number
    smaller_by: SeedInterval


class LearningCurves(sm.StoredResult):
    """All trainings."""

    steps: float
    """Of the longest training."""
    methods: dict[str, MethodResult]
    savings: list[Saving]
    spread: list[SpreadSaving]


# ------------------------------------------------------------------------------------ drives


class DriveFigures(sm.StoredResult):
    """Figures of a drive, or their medians over drives; ``steady_``: of the last half."""

    ale_mm: Number = None
    """Mean |lateral error|."""
    steady_ale_mm: Number = None
    max_mm: Number = None
    aoe_deg: Number = None
    """Mean |heading error|."""
    steady_aoe_deg: Number = None
    course_deg: Number = None
    steer_std: Number = None
    steady_steer_std: Number = None
    speed: Number = None
    """[m/s]"""
    steady_speed: Number = None
    seconds: Number = None
    distance: Number = None
    """[m]"""


class StudyDrive(DriveFigures):
    """One drive."""

    end: str = ""
    completed: bool = False


class SeedDrives(sm.StoredResult):
    """The same drive with the policies of several seeds."""

    seeds: int
    completed: int
    median: DriveFigures = DriveFigures()
    worst: StudyDrive = StudyDrive()
    """The drive that ended early or, if none did, the one with the largest error."""
    least_aoe_deg: Number = None
    """Heading error without any lateral error, at the speed that was reached."""


class PaperFigures(sm.StoredResult):
    """What the paper reports of its agent."""

    ale_mm: float
    aoe_deg: float
    steer_std: float


class CircleTest(sm.StoredResult):
    """All drivers in one test of the paper's table."""

    test: str
    paper: PaperFigures
    drivers: dict[str, SeedDrives]


class CircleResult(sm.StoredResult):
    """The paper's table."""

    tests: list[CircleTest]


class ErrorSeries(sm.StoredResult):
    """Errors over time with one range of waypoint errors."""

    range: float
    time: list[float]
    lateral_mm: list[float]
    heading_deg: list[float]


class WaypointErrors(sm.StoredResult):
    """Drives with waypoint errors, one for each range."""

    agent: list[SeedDrives]
    mpc_pid: list[StudyDrive]


class RobustnessResult(sm.StoredResult):
    """The paper's figure of robustness."""

    throttle: float
    ranges: list[float]
    every_step: WaypointErrors
    once: WaypointErrors
    series: Sequence[ErrorSeries] = ()


class CornerError(sm.StoredResult):
    """|lateral error| in a corner; None where the car never came."""

    corner: str
    mean_mm: Number
    max_mm: Number


class DrivenLap(sm.StoredResult):
    """The line of one agent's lap [m]."""

    seed: int
    x: list[float]
    y: list[float]
    path_x: list[float]
    path_y: list[float]
    s: list[float]
    lateral_error: list[float]


class MonzaResult(sm.StoredResult):
    """The paper's racing track."""

    throttle: float
    agent: SeedDrives
    agents: dict[str, StudyDrive]
    """By seed."""
    mpc_pid: StudyDrive
    scheduled: StudyDrive
    corners: dict[str, list[CornerError]]
    line: DrivenLap | None = None


class AwayTest(sm.StoredResult):
    """A track at a speed, with every variant of MPC-PID and the full method's agents."""

    track: str
    speed: float
    mpc_pid: dict[str, StudyDrive]
    agent: SeedDrives


class TunedFor(sm.StoredResult):
    """Where MPC-PID was tuned."""

    track: str
    speed: float


class AwayResult(sm.StoredResult):
    """MPC-PID away from the track and speed that it was tuned for."""

    tuned: TunedFor
    cap: float
    """Largest lateral acceleration that the speeds need [m/s^2]."""
    tests: list[AwayTest]


# -------------------------------------------------------------------------------------- times


class TimingRow(sm.StoredResult):
    """Computing times of one implementation; None where it was not measured."""

    name: str
    note: str = ""
    p50_us: Number = None
    p99_us: Number = None
    max_us: Number = None
    steps: int | None = None
    lap_s: Number = None
    extrapolated: bool = False
    """Whether the lap is extrapolated from fewer steps."""
    failed: int | None = None
    """Solves that failed, if any did."""


class TimingResult(sm.StoredResult):
    """Computing times of the controllers alone."""

    paper: dict[str, float]
    lap_steps: int
    lap_end: str
    rows: list[TimingRow]


class StudyResult(sm.StoredResult):
    """The whole study."""

    format: int = 1
    versions: dict[str, str]
    commit: str | None = None
    made_by: list[str]
    """Every commit that contributed."""
    seconds: dict[str, float]
    """Computing time of each stage."""
    plan: dict[str, Any]
    learning: LearningCurves
    circle: CircleResult
    robustness: RobustnessResult
    monza: MonzaResult
    away: AwayResult
    timing: TimingResult
