"""The suites that come with the package, and those from the user's files.

``standard`` is the test suite, ``core`` a part of it. ``tuning`` is what gains are tuned on: it
shares no path with the test suite. ``quick`` shows in seconds that a controller drives at all.
``faults`` breaks sensors, actuators and controllers on the way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import Any, TypeAlias

from steersman.bench.disturbance import Disturbance, Mixed
from steersman.bench.suite import CLEAN, Course, Suite
from steersman.config import build, dump, override, read_yaml, to_yaml
from steersman.controllers.mpc_pid import ModelError
from steersman.errors import ConfigError, suggestion
from steersman.faults import Fault
from steersman.files import write_text
from steersman.paths.analytic import Circle, DoubleLaneChange, FigureEight, Lemniscate
from steersman.paths.base import PathComponent
from steersman.paths.random_road import RandomRoad
from steersman.paths.tracks import Monza, TrainingCircuit
from steersman.speed import ConstantSpeed, RandomProfile, SpeedComponent

Speeds: TypeAlias = dict[str, SpeedComponent]

# Roads that no training and no validation has seen: those draw seeds below 2000.
HELD_OUT = range(2000, 2020)
# A car that slides or whose model is wrong can still hold this lateral acceleration [m/s^2].
CAP = 6.0
SPORTY_CAP = 10.0
# ISO 3888-2 with a car of 2.16 m: lanes 1.1 b + 0.25 and b + 1, 1 m between them. Its changes of
# lane, 13.5 and 12.5 m, would need a radius of 6 to 7 m; stretched to 20 m it is 13.4 m.
_OBSTACLE = DoubleLaneChange(entry=12.0, out=20.0, beside=11.0, back=20.0, exit=12.0, offset=3.89)

# The disturbances of the suite ``core``.
_COMMON = (
    *(CLEAN, "delay_100ms", "delay_200ms", "noise_0.1m"),
    *("heavy", "light", "stiff", "soft", "understeer", "oversteer"),
)


def constant(speed: float, cap: float = CAP) -> ConstantSpeed:
    """A constant speed [m/s], less where it would exceed ``cap`` [m/s^2]."""
    return ConstantSpeed(speed=speed, a_lat_max=cap)


def changing(high: float, cap: float = CAP, seconds: float = 120.0) -> RandomProfile:
    """Speeds from 5 m/s to ``high`` that change by up to 2 m/s^2, drawn from the seed."""
    return RandomProfile(low=5.0, high=high, a_lat_max=cap, seconds=seconds)


def _course(path: PathComponent, speed: float, high: float, **words: Any) -> Course:
    speeds: Speeds = {"constant": constant(speed), "changing": changing(high)}
    return Course(path=path, speeds=speeds, **words)


def _sporty(course: Course, speed: float) -> Course:
    """The course with a clean run near what its car can do."""
    speeds: Speeds = {**course.speeds, "sporty": constant(speed, SPORTY_CAP)}
    return course.model_copy(update={"speeds": speeds, "only": {"sporty": (CLEAN,)}})


def disturbances() -> dict[str, Disturbance]:
    """Those of the test suite: what can be wrong, one thing at a time."""
    return {
        CLEAN: Disturbance(),
        "delay_50ms": Disturbance(delay=0.05),
        "delay_100ms": Disturbance(delay=0.1),
        "delay_200ms": Disturbance(delay=0.2),
        "noise_0.1m": Disturbance(waypoint_noise=0.1),
        "noise_0.3m": Disturbance(waypoint_noise=0.3),
        "heavy": Disturbance(mass=1.2, yaw_inertia=1.2),
        "light": Disturbance(mass=0.8, yaw_inertia=0.8),
        "stiff": Disturbance(c_f=1.3, c_r=1.3),
        "soft": Disturbance(c_f=0.7, c_r=0.7),
        "understeer": Disturbance(c_f=0.7, c_r=1.3),
        "oversteer": Disturbance(c_f=1.3, c_r=0.7),
        "slow_actuator": Disturbance(steer_rate=0.25),
        "bias_1deg": Disturbance(steer_bias=math.radians(1.0)),
        "friction_1.0": Disturbance(friction=1.0),
        "friction_0.7": Disturbance(friction=0.7),
        "friction_0.5": Disturbance(friction=0.5),
        "side_wind": Disturbance(wind=20.0),
        "pose_noise": Disturbance(position_noise=0.05, heading_noise=math.radians(0.5)),
        "speed_noise": Disturbance(speed_noise=0.2, yaw_rate_noise=0.01),
        **{f"model_{name}": Disturbance(model=model) for name, model in _wrong_models().items()},
    }


def _wrong_models() -> dict[str, ModelError]:
    """Every parameter wrong by 30 %, in the ways that add up and in those that turn the car."""
    soft, stiff = 0.7, 1.3
    return {
        "soft": ModelError(mass=stiff, yaw_inertia=stiff, c_f=soft, c_r=soft),
        "stiff": ModelError(mass=soft, yaw_inertia=soft, c_f=stiff, c_r=stiff),
        "understeer": ModelError(c_f=soft, c_r=stiff),
        "oversteer": ModelError(c_f=stiff, c_r=soft),
    }


def standard() -> Suite:
    """The test suite."""
    monza: Speeds = {"constant": constant(20.0), "changing": changing(28.0, seconds=900.0)}
    roads = {
        f"road_{seed}": _course(RandomRoad(seed=seed, distance=600.0), 15.0, 25.0)
        for seed in HELD_OUT
    }
    courses = {
        "circle_50_left": _sporty(_course(Circle(), 15.0, 20.0, duration=30.0), 21.0),
        "circle_50_right": _course(Circle(direction="right"), 15.0, 20.0, duration=30.0),
        "circle_100_left": _course(Circle(radius=100.0), 22.0, 25.0, duration=30.0),
        "lemniscate": _course(Lemniscate(), 12.0, 20.0, duration=40.0),
        "figure_eight": _course(FigureEight(), 11.0, 20.0, duration=40.0),
        "iso_3888_1": _course(DoubleLaneChange(), 15.0, 20.0),
        "iso_3888_2": _course(_OBSTACLE, 12.0, 18.0),
        "monza": _sporty(Course(path=Monza(), speeds=monza, laps=1), 28.0),
        **roads,
        "road_2000": _sporty(roads["road_2000"], 25.0),
    }
    mixed = {f"mixed_{i}": Mixed() for i in (1, 2, 3)}
    return Suite(courses=courses, disturbances=disturbances(), mixed=mixed)


def core() -> Suite:
    """A quarter of the test suite: every track, four roads, and the commonest disturbances.

    These are delay, waypoint noise, and a car whose mass and stiffness are not those of the model.
    """
    whole = standard()
    left_out = {f"road_{seed}" for seed in HELD_OUT[4:]}
    return Suite(
        courses={name: course for name, course in whole.courses.items() if name not in left_out},
        disturbances={name: whole.disturbances[name] for name in _COMMON},
        mixed=whole.mixed,
    )


def tuning() -> Suite:
    """Gains are tuned here: the training circuit at several speeds, clean and disturbed."""
    speeds: Speeds = {
        "30_km_h": constant(30.0 / 3.6, 8.0),
        "calm": changing(18.0, 4.0, 300.0),
        "brisk": changing(25.0, 8.0, 300.0),
    }
    only = {
        "30_km_h": (CLEAN, "delay_200ms", "noise_0.1m"),
        "calm": (CLEAN, "delay_100ms", "heavy", "noise_0.1m"),
        "brisk": (CLEAN, "delay_100ms", "soft"),
    }
    circuit = Course(path=TrainingCircuit(), speeds=speeds, laps=1, only=only)
    return Suite(courses={"training_circuit": circuit}, disturbances=disturbances())


def quick() -> Suite:
    """A handful of short runs."""
    known = disturbances()
    names = (CLEAN, "delay_100ms", "noise_0.1m", "soft")
    courses = {
        "circle_50_left": Course(path=Circle(), speeds={"constant": constant(12.0)}, duration=5.0),
        "road_2000": Course(
            path=RandomRoad(seed=2000, distance=150.0), speeds={"changing": changing(15.0)}
        ),
    }
    chosen = {name: known[name] for name in names}
    return Suite(courses=courses, disturbances=chosen, mixed={"mixed": Mixed()})


def faults() -> Suite:
    """What breaks, one thing at a time, on the test suite's loops and on half of its roads."""
    whole = standard().courses
    loops = ("circle_50_left", "circle_50_right", "lemniscate", "figure_eight")
    courses = {
        name: whole[name].model_copy(
            update={"speeds": {"constant": whole[name].speeds["constant"]}, "only": {}}
        )
        for name in (*loops, *(f"road_{seed}" for seed in HELD_OUT[:10]))
    }
    broken = {
        "frozen_0.5s": Fault(kind="frozen", length=0.5, every=8.0),
        "frozen_1s": Fault(kind="frozen", length=1.0, every=8.0),
        "dropped_50%": Fault(kind="dropped", share=0.5),
        "dropped_80%": Fault(kind="dropped", share=0.8),
        "nan_0.2s": Fault(kind="nan", length=0.2, every=2.0),
        "nan_1s": Fault(kind="nan", length=1.0, every=8.0),
        "stuck_0.5s": Fault(kind="stuck", length=0.5, every=8.0),
        "saturated": Fault(kind="saturated", limit=0.08),
        "raises": Fault(kind="raises"),
        "answers_nan": Fault(kind="answers_nan"),
    }
    chosen = {name: Disturbance(fault=fault) for name, fault in broken.items()}
    # Gaps are filled by reckoning with the car as it is known, which need not be the car.
    chosen["nan_1s_soft"] = Disturbance(fault=broken["nan_1s"], c_f=0.7, c_r=0.7)
    chosen["nan_1s_delay"] = Disturbance(fault=broken["nan_1s"], delay=0.1)
    chosen["nan_1s_noise"] = Disturbance(fault=broken["nan_1s"], waypoint_noise=0.1)
    return Suite(courses=courses, disturbances={CLEAN: Disturbance(), **chosen})


SUITES: dict[str, Callable[[], Suite]] = {
    "standard": standard,
    "core": core,
    "tuning": tuning,
    "quick": quick,
    "faults": faults,
}


def suite(name: str, assignments: Sequence[str] = ()) -> Suite:
    """A suite by its name, or from a YAML file (a name that ends in ``.yaml`` or ``.yml``).

    ``assignments`` (``plant=carla``, ``corridor=1``) are laid over it.

    Raises:
        ConfigError: there is no such suite, the message names the nearest; or a setting is wrong.
        DataError: the file cannot be read.
    """
    if name.endswith((".yaml", ".yml")):
        try:
            found = build(Suite, read_yaml(FilePath(name)))
        except ConfigError as error:
            raise ConfigError(f"{name}: {error}") from None
    elif name not in SUITES:
        raise ConfigError(f"unknown suite {name!r}{suggestion(name, SUITES)}")
    else:
        found = SUITES[name]()
    return laid_over(found, assignments)


def write_suite(found: Suite, folder: FilePath) -> None:
    """Write ``suite.yaml``, from which the same suite is read.

    Raises:
        DataError: it cannot be written.
    """
    write_text(folder / "suite.yaml", to_yaml(found))


def laid_over(found: Suite, assignments: Sequence[str]) -> Suite:
    """The suite with settings over it.

    Raises:
        ConfigError: a setting is unknown or wrong.
    """
    return build(Suite, override(dump(found) or {}, assignments)) if assignments else found
