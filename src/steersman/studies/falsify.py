"""Search for the mildest disturbance that takes a controller off the road.

What is disturbed, and what mild means, :mod:`steersman.studies.perturbation` defines. A search can
prove that a controller fails, but never that it does not: a point that was not driven may fail.
"""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated, Any, NamedTuple

from pydantic import model_validator

from steersman.config import Of, Settings, build, param
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc_pid import MpcPid
from steersman.engine.jobs import Workers
from steersman.episode import Episode
from steersman.errors import ConfigError
from steersman.files import alone, make_folder
from steersman.paths.base import PathComponent
from steersman.plants.base import PlantComponent, has_one_car
from steersman.plants.simulator import SimulatorConfig
from steersman.rollout import RunConfig, attempt
from steersman.sensing import WaypointSensor
from steersman.speed import ConstantSpeed, SpeedComponent
from steersman.studies.findings import FalsifyResult, findings
from steersman.studies.folder import same_study
from steersman.studies.hunt import Bracket, Progress, Search
from steersman.studies.perturbation import Point, Ranges, scaled_fields
from steersman.studies.tried import opened
from steersman.vehicles import CarlaModel3, Vehicle

# Ranges of what only the simulator's cars can be: of another mass, on another road.
CARS_DIFFER = ("mass", "friction")
# Fields that may differ when a search goes on: they say how much is driven, not what.
_BUDGET = ("trials", "checks", "bisections")
_RUN = (
    *("controller", "path", "speed", "vehicle", "plant", "sensor"),
    *("duration", "laps", "corridor", "seed"),
)


class FalsifyConfig(Settings):
    """A search for the mildest disturbance under which a controller fails."""

    controller: Annotated[ControllerComponent, Of("controller")] = param(
        MpcPid(), "-", "Lateral controller."
    )
    path: Annotated[PathComponent, Of("path")] = param("circle", "-", "Path to follow.")
    speed: Annotated[SpeedComponent, Of("speed")] = param(
        ConstantSpeed(), "-", "Source of throttle and brake, undisturbed."
    )
    vehicle: Annotated[Vehicle, Of("vehicle")] = param(
        CarlaModel3(), "-", "Vehicle, undisturbed; the controller's model is of this one."
    )
    plant: Annotated[PlantComponent, Of("plant")] = param(
        SimulatorConfig(), "-", "What is driven; only cars that are computed here can be disturbed."
    )
    sensor: Annotated[WaypointSensor, Of("sensor")] = param(WaypointSensor(), "-", "Sensor.")
    duration: float | None = param(
        None,
        "s",
        "Length of a run; null with laps null: 60 s, or to the end of an open path.",
        gt=0,
    )
    laps: float | None = param(None, "-", "Laps of a closed path, instead of a duration.", gt=0)
    corridor: float = param(1.5, "m", "Half width of the corridor; leaving it is a failure.", gt=0)
    ranges: Ranges = param(Ranges(), "-", "How far each quantity is disturbed at most.")
    trials: int = param(100, "-", "Drives of the search over everything at once.", ge=0)
    checks: int = param(50, "-", "Drives at random points milder than the mildest failure.", ge=0)
    bisections: int = param(6, "-", "Halvings of an interval between failing and not.", ge=1, le=30)
    seed: int = param(0, "-", "Seed of the search and of the sensors' errors.", ge=0)

    @model_validator(mode="after")
    def _fits(self) -> FalsifyConfig:
        run, ranges = self.run(), self.ranges
        for name in () if run.plant.computed else CARS_DIFFER:
            if getattr(ranges, name):
                raise ConfigError(
                    f"{getattr(ranges, name):g} is not allowed; plant={run.plant.kind} has the one "
                    "car that it has: 0",
                    ("ranges", name),
                )
        if ranges.speed:
            scaled_fields(self.speed)
        if ranges.friction >= self.vehicle.friction:
            raise ConfigError(
                f"{ranges.friction:g} is not allowed; must be less than the vehicle's friction, "
                f"{self.vehicle.friction:g}",
                ("ranges", "friction"),
            )
        plant = run.plant.model_copy(update={"steering_delay": ranges.delay})
        try:
            plant.delay_of(self.vehicle)
        except ConfigError as error:
            raise ConfigError(str(error), ("ranges", "delay")) from None
        return self

    def run(self) -> RunConfig:
        """The undisturbed run."""
        return build(RunConfig, {name: getattr(self, name) for name in _RUN})


class DrivenAgain(NamedTuple):
    """A drive of a search, driven once more to be shown."""

    what: str
    """``fails`` or ``holds``."""
    point: Point
    values: dict[str, float]
    """Physical values by quantity."""
    episode: Episode


def driven_again(result: FalsifyResult) -> list[DrivenAgain]:
    """The mildest failure and the drive that holds nearest to it.

    None where nothing failed, and on plants that are not computed here, where each takes its time.

    Raises:
        ConfigError: the result's configuration is none of this version.
    """
    config = build(FalsifyConfig, result.config)
    run, ranges = config.run(), config.ranges
    rows = {"fails": result.mildest, "holds": result.nearest_holding()}
    points = {what: row.point for what, row in rows.items() if row and run.plant.computed}
    return [
        DrivenAgain(
            what,
            point,
            ranges.values(point, run),
            attempt(ranges.disturbed(run, point)).of_controller(),
        )
        for what, point in points.items()
    ]


def for_one_car(plant: Any) -> list[str]:
    """Assignments that leave the car as it is, if ``plant`` (a name or fields) has just one."""
    return [f"ranges.{name}=0" for name in CARS_DIFFER if has_one_car(plant)]


@alone("out")
def falsify(
    config: FalsifyConfig,
    out: FilePath,
    progress: Progress | None = None,
    *,
    engine: str | None = None,
    jobs: int | None = None,
) -> FalsifyResult:
    """Search for the mildest failure; the result is also written to ``falsify.json``.

    The undisturbed run comes first; if it fails, that is the result. Then each quantity is
    disturbed alone and its failing value is found by bisection; a sampler that learns (TPE,
    Bergstra et al., "Algorithms for Hyper-Parameter Optimization", NeurIPS 2011) searches over all
    of them at once for something milder; the mildest failure is pulled towards the nominal; and
    points at random, milder than it, are driven to find a milder one.

    ``config.yaml`` and ``drives.jsonl`` are kept in ``out``: a search that was interrupted goes on
    there, and ends as if it had not been.

    Args:
        config: what is driven, and how far it is disturbed.
        out: folder of the study.
        progress: called after each drive.
        engine: of :class:`steersman.engine.jobs.Workers`; the result does not depend on it.
        jobs: drives at a time; None: one for each core.

    Raises:
        ConfigError: ``out`` holds another study, or the parts of the run do not fit together.
        DataError: the folder cannot be written, or holds something else.
    """
    make_folder(out)
    same_study(config, out, _BUDGET)
    kept = opened(out / "drives.jsonl", config.ranges.names())
    singles: list[Bracket] = []
    with Workers(engine, jobs if config.plant.computed else 1) as workers:
        search = Search(config, kept.results, kept.add, progress, workers)
        if not search.nominal().failed:
            singles = search.singles()
            search.explore()
            search.pull_in()
            search.check()
    result = findings(config, list(search.tried.values()), singles)
    result.write(out / "falsify.json")
    return result
