"""What a benchmark leaves in its folder: rows, their table, ``results.json``, ``suite.yaml``."""

from __future__ import annotations

import math
from typing import Any, ClassVar

from pydantic import Field, model_validator

from steersman.bench.grip import BEYOND, grip_class
from steersman.bench.map_record import MapRecord
from steersman.bench.statistics import Interval
from steersman.metrics.base import Values
from steersman.stored import ShownResult, SourcedResult, StoredResult, optional
from steersman.table_file import Columns, columns_of

FORMAT = 1
RESULTS = "results.json"
_APPLIED = "disturbance_"
# Fields that a row lacks where they are None.
_IF_ANY = ("plant", "error")


class BenchRow(StoredResult):
    """One scenario driven by one controller.

    Files hold it as one flat object: ``applied`` under names with ``disturbance_`` before them,
    metrics under their own names.
    """

    replicate: str = ""
    """Which of several of the same name, such as the seed of its tuning."""
    key: str = ""
    """Changes with the scenario, the controller and the columns of a row."""
    controller: str
    kind: str
    learned: bool = False
    """Whether a policy is part of the controller."""
    scenario: str
    path: str
    speed: str
    disturbance: str
    vehicle: str
    seed: int
    applied: dict[str, float | str | None]
    """Every number of the disturbance by its name."""
    grip_share: float | None = None
    """Largest share of grip that path and speeds ask for; None in rows of before it was known."""
    dt_s: float
    end: str
    """How the drive ended."""
    driven_share: float
    """Share in [0, 1] of the planned time or distance that was driven."""
    charged_rms_m: float
    charged_mean_m: float
    charged_p95_m: float
    charged_max_m: float
    metrics: Values
    plant: str | None = None
    """The plant, if it was not the embedded simulator."""
    error: str | None = None
    """What the controller raised, and where; None where it raised nothing."""
    commit: str | None = None
    computing_time_s: float

    @model_validator(mode="before")
    @classmethod
    def _from_flat(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "metrics" in data:
            return data
        out: dict[str, Any] = {"applied": {}, "metrics": {}}
        for name, value in data.items():
            if name in cls.model_fields:
                out[name] = value
            elif name.startswith(_APPLIED):
                out["applied"][name.removeprefix(_APPLIED)] = value
            else:
                out["metrics"][name] = value
        return out

    def plain(self) -> dict[str, Any]:
        """The flat object, as it is kept in files."""
        out: dict[str, Any] = {}
        for name in type(self).model_fields:
            value = getattr(self, name)
            if name == "applied":
                out |= {f"{_APPLIED}{key}": v for key, v in value.items()}
            elif name == "metrics":
                out |= value
            elif name not in _IF_ANY or value is not None:
                out[name] = value
        return out

    @property
    def completed(self) -> bool:
        """Whether the drive reached its planned end."""
        return bool(self.metrics["completed"])

    @property
    def grip(self) -> str:
        """The class of the grip that it asks for; empty where that is not known."""
        return "" if self.grip_share is None else grip_class(self.grip_share)

    @property
    def beyond_grip(self) -> bool:
        """Whether it asks for more grip than a controller can be asked to hold."""
        return self.grip == BEYOND

    def number(self, metric: str) -> float:
        """A metric that is always defined, such as a count."""
        return float(self.metrics.get(metric) or 0.0)


class IntervalEstimate(StoredResult):
    """A figure with its 95 % interval; None where it is undefined."""

    value: float | None
    low: float | None = None
    high: float | None = None

    @classmethod
    def of(cls, interval: Interval) -> IntervalEstimate:
        """From statistics, in which NaN and infinity are undefined."""
        return cls(**{k: v if math.isfinite(v) else None for k, v in interval._asdict().items()})

    def scaled(self, factor: float) -> IntervalEstimate:
        """In another unit."""
        numbers = self.model_dump().items()
        return IntervalEstimate(**{k: None if v is None else factor * v for k, v in numbers})


class PooledErrors(StoredResult):
    """Lateral errors of a group of rows, each row of the same weight."""

    runs: int
    failures: int
    """Drives that ended early."""
    interventions: int = 0
    paths: int | None = None
    """Paths that the interval rests on; None in files of before they were counted."""
    rms_m: IntervalEstimate
    """Root of the mean of the squared charged RMS errors."""
    typical_m: IntervalEstimate | None = optional()
    """Geometric mean of the charged RMS errors."""
    lost_share: IntervalEstimate | None = optional()
    """Share of the drives that ended early."""
    mean_m: float | None
    p95_m: float | None


class DistributedFigure(StoredResult):
    """A metric over the scenarios."""

    rms: IntervalEstimate
    """Root of the mean square."""
    median: IntervalEstimate


class ErrorRatio(StoredResult):
    """RMS errors over those of another controller in the same scenarios."""

    rms: IntervalEstimate
    """Ratio of the pooled RMS errors."""
    typical: IntervalEstimate
    """Geometric mean of the scenarios' ratios."""


class Regret(StoredResult):
    """What drives cost beyond the oracle's: RMS error and the price of steering together."""

    runs: int
    """Drives of scenarios with an oracle."""
    below: int
    """Those that cost less than the oracle's, which is a local optimum."""
    oracle_m: float
    """Mean cost of the oracle's drives [m]."""
    mean_m: IntervalEstimate
    median_m: IntervalEstimate


class ControllerSummary(StoredResult):
    """The figures of a controller over all its rows."""

    learned: bool
    all: PooledErrors
    clean: PooledErrors
    disturbed: PooledErrors
    beyond: PooledErrors | None = None
    """Scenarios that ask for more than there is of grip; no other figure counts them."""
    runs: int
    failures: int
    ends: dict[str, int]
    """How often drives ended early, by how."""
    steer_change_rms: float | None
    steer_reversals_per_min: float | None
    control_time_us_p50: float | None
    control_time_us_p99: float | None
    interventions: int = 0
    intervened_s: float = 0.0
    fallbacks: int
    saturated_share: float | None
    weighted_acceleration_m_s2: float | None
    deadline_misses_50ms: int
    deadline_misses_10ms: int
    control_steps: int
    computing_us_per_step: float
    error: str | None = optional()
    """What it raised in the first of its drives that ended by that; None if none did."""
    figures: dict[str, DistributedFigure] = Field({})
    """Metrics that are no errors, with intervals: steering, comfort, computing time."""
    replicates: int = 1
    """How many of the same name drove, such as seeds of a tuning."""
    gentle_runs: int
    """Drives whose path needs no more acceleration than the standards of comfort allow."""
    iso_11270_share: float | None
    r79_share: float | None
    regret: Regret | None = optional()
    """None where no scenario has an oracle."""
    ratio: dict[str, ErrorRatio] | None = optional()
    """By group, over the best classical controller; None without one."""

    def failed_words(self, name: str) -> str | None:
        """A sentence about the drives of ``name`` in which it raised something; None without."""
        count = self.ends.get("error", 0)
        if self.error is None:
            return None
        return f"{name}: failed in {count} of {self.runs} drives; {self.error}"

    def errors(self, group: str) -> PooledErrors:
        """The errors of ``all``, ``clean`` or ``disturbed`` rows."""
        found: PooledErrors = getattr(self, group)
        return found


class Profiles(StoredResult):
    """Shares of the scenarios within a factor of the best controller's error."""

    factors: list[float]
    shares: dict[str, list[float]]
    """By controller, one for each factor."""


class SweepStep(StoredResult):
    """A disturbance that differs from a clean run in one number alone."""

    disturbance: str
    value: float


class Summary(StoredResult):
    """The figures of all controllers."""

    controllers: dict[str, ControllerSummary]
    """The fewer drives lost the earlier, then by typical error."""
    best_classical: str | None
    """The first of them that is not learned; ratios refer to it."""
    profiles: Profiles
    by: dict[str, dict[str, dict[str, PooledErrors]]]
    """Errors by factor (``disturbance``, ``path``, ``speed``), its value, and controller."""
    sweeps: dict[str, list[SweepStep]]
    """By the number that differs: ``delay``, ``waypoint_noise``, ``friction``."""
    paths: int
    scenarios: int


class BenchResult(ShownResult, SourcedResult):
    """The content of ``results.json``; its table has a row for each controller."""

    shown_by: ClassVar[str] = "steersman.report.benchmark:shown_bench"

    format: int = FORMAT
    suite: str
    seeds: list[int]
    maps: dict[str, MapRecord] = Field({})
    maps_left_out: list[str] = Field([])
    """Maps without anything to drive on."""
    made_by: list[str]
    """Commits at which the rows were driven."""
    controllers: dict[str, dict[str, Any]]
    """Configurations by name."""
    summary: Summary
    plant: str = "simulator"
    left_out: dict[str, int] = Field({})
    """Scenarios that the plant cannot do, by the name of their disturbance."""

    def line(self) -> str:
        """What was driven, and what had the smallest error."""
        found, best = self.summary, next(iter(self.summary.controllers.items()), None)
        drove = f"{len(found.controllers)} controllers over {found.scenarios} scenarios"
        rms = None if best is None else best[1].all.rms_m.value
        least = "" if rms is None or best is None else f"; {best[0]} first, RMS {1e3 * rms:.3g} mm"
        return f"BenchResult: suite {self.suite}, {drove}{least}"

    def table(self) -> Columns:
        """The summary of each controller, the best first."""
        return columns_of(
            {"controller": name} | one.plain() for name, one in self.summary.controllers.items()
        )
