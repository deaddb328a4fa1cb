"""The suites that come with the package, and those from the user's files.

``standard`` is the test suite, ``core`` a part of it; ``standard_1`` and ``core_1`` are those of
the first stage. ``tuning`` is what gains are tuned on. ``quick`` shows in seconds that a controller
drives at all. ``faults`` breaks sensors, actuators and controllers on the way. ``beyond_grip``
wishes more speed than grip allows. ``acc`` drives behind another car, and ``acc_tuning`` is what
gains for that are tuned on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path as FilePath

from steersman.bench.beyond import beyond_grip
from steersman.bench.courses import changing, constant
from steersman.bench.disturbance import Disturbance, Mixed
from steersman.bench.first_stage import HELD_OUT, core_1, first_disturbances, standard_1
from steersman.bench.following import acc, acc_tuning
from steersman.bench.standard import core, standard
from steersman.bench.suite import CLEAN, Course, Suite
from steersman.bench.tuning import tuning
from steersman.config import build, dump, override, read_yaml, to_yaml
from steersman.errors import ConfigError, suggestion
from steersman.faults import Fault
from steersman.files import write_text
from steersman.paths.analytic import Circle
from steersman.paths.random_road import RandomRoad


def quick() -> Suite:
    """A handful of short runs."""
    known = first_disturbances()
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
    whole = standard_1().courses
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
    "standard_1": standard_1,
    "core_1": core_1,
    "tuning": tuning,
    "quick": quick,
    "faults": faults,
    "beyond_grip": beyond_grip,
    "acc": acc,
    "acc_tuning": acc_tuning,
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
