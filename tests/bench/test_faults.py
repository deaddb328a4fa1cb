"""Faults on the way: what a controller meets, what it costs, and what a supervisor makes of it."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
import pytest

from steersman.bench import drive, suites
from steersman.bench.disturbance import Disturbance
from steersman.bench.entrants import Entrant, entrant, entrants
from steersman.bench.suite import Course, Scenario, Suite
from steersman.config import dump
from steersman.controllers.base import ControllerComponent, Wrapper
from steersman.controllers.pid import Pid
from steersman.controllers.supervisor import Supervisor
from steersman.episode import Episode
from steersman.faults import Dead, Dying, Fault
from steersman.paths.analytic import Circle, Straight
from steersman.types import Decision, Observation, Status

from ..loops import CAR, DT, beside, observe
from ..loops import drive as drive_

SEEN: list[Observation] = []


class Watching(Wrapper):
    """Keeps every observation that it gets; steers with a ramp."""

    family: ClassVar[str] = "controller"
    kind: ClassVar[str] = "watching"
    steer: float = 0.01

    def init(self, vehicle: Any, dt: float) -> None:
        SEEN.clear()

    def step(self, state: Any, observation: Observation) -> Any:
        SEEN.append(observation)
        return Decision(self.steer * observation.time), state


def seen(
    fault: Fault, n: int = 40, steer: float = 0.01
) -> tuple[Episode, list[Observation], list[float]]:
    """What was there, what the controller got of it, and what arrived at the actuator."""
    controller = Watching(steer=steer)
    episode = drive_(controller, Straight(), fault=fault, seed=3, duration=n * DT, corridor=50.0)
    return episode, SEEN[-n:], episode["steer_command"].tolist()


def test_frozen_numbers_stay_while_time_goes_on() -> None:
    there, told, _ = seen(Fault(kind="frozen", begin=0.5, length=0.5))
    for k in range(40):
        frozen = 10 <= k < 20
        assert told[k].time == there["time"][k]
        assert told[k].lateral_error == there["lateral_error"][9 if frozen else k]
        assert told[k].v_x == there["v_x"][9 if frozen else k]
        assert np.array_equal(told[k].preview, told[9].preview) == (frozen or k == 9)


def test_dropped_samples_are_the_last_ones_again() -> None:
    there, told, _ = seen(Fault(kind="dropped", begin=0.0, share=0.5), 200)
    lost = 0
    for k in range(1, 200):
        assert told[k].time in {there["time"][k], told[k - 1].time}
        lost += told[k].time != there["time"][k]
    assert 70 < lost < 130
    assert [o.time for o in seen(Fault(kind="dropped", begin=0.0), 200)[1]] == [
        o.time for o in told
    ]


def test_nan_comes_in_bursts() -> None:
    _, told, _ = seen(Fault(kind="nan", begin=0.5, length=0.2, every=1.0))
    bad = [math.isnan(o.lateral_error) and np.isnan(o.preview).all() for o in told]
    assert [k for k in range(40) if bad[k]] == [*range(10, 14), *range(30, 34)]
    assert all(math.isfinite(o.time) for o in told)


def test_an_actuator_sticks_or_does_not_go_far() -> None:
    _, _, stuck = seen(Fault(kind="stuck", begin=0.5, length=0.5))
    assert stuck[9:20] == [stuck[9]] * 11
    assert stuck[20] == pytest.approx(0.01 * 20 * DT)
    _, _, short = seen(Fault(kind="saturated", begin=0.5, limit=0.0075))
    assert short[10] == pytest.approx(0.005)
    assert set(short[15:]) == {0.0075}


def test_who_dies_stays_dead_also_when_started_anew() -> None:
    path, controller = Circle(), Dying(inner=Pid(), fault=Fault(kind="raises", begin=0.5))
    o = observe(path, beside(path, 1.0, time=0.3), 1.0)
    state = controller.init(CAR, DT)
    assert controller.step(state, o)[0] == Pid().step(Pid().init(CAR, DT), o)[0]
    for begun in (state, controller.init(CAR, DT)):
        with pytest.raises(Dead):
            controller.step(begun, o._replace(time=0.6))
    straight = o._replace(time=0.6, curvature=0.001)
    assert controller.step(state, straight)[0].status is Status.SOLVED
    silent = Dying(inner=Pid(), fault=Fault(kind="answers_nan", begin=0.5))
    decision, dead = silent.step(silent.init(CAR, DT), o._replace(time=0.6, steer=0.07))
    assert decision == Decision(0.07, Status.FALLBACK)  # as every controller of the package
    assert silent.step(dead, straight)[0].status is Status.FALLBACK


def test_what_breaks_inside_breaks_inside_a_supervisor() -> None:
    death, frozen = Fault(kind="raises"), Fault(kind="frozen")
    guarded = death.within(Supervisor(inner="pid"))
    assert isinstance(guarded, Supervisor)
    assert guarded.inner == Dying(inner=Pid(), fault=death)
    assert isinstance(death.within(Pid()), Dying)
    assert frozen.within(guarded) == guarded


def scenarios(**faults: Fault) -> list[Scenario]:
    course = Course(path=Circle(), speeds={"slow": suites.constant(10.0)}, duration=9.0)
    disturbances = {name: Disturbance(fault=fault) for name, fault in faults.items()}
    return Suite(courses={"circle": course}, disturbances=disturbances).scenarios()


BARE, GUARDED = entrant("tuned/mpc_delay"), entrant("supervised/tuned/mpc_delay")


@pytest.mark.parametrize("kind", ["raises", "nan", "frozen"])
def test_a_fault_is_a_failure_without_a_supervisor_and_none_with_one(kind: Any) -> None:
    """It never is one of the benchmark itself."""
    (scenario,) = scenarios(broken=Fault(kind=kind, begin=3.0, length=1.5))
    broken = drive.measure(scenario, BARE).plain()
    row = drive.measure(scenario, GUARDED).plain()
    # A controller of this package that is told of NaN holds its steering, which on a circle is
    # right for a while.
    if kind == "raises":
        assert (broken["end"], broken["completed"]) == ("error", False)
        assert broken["driven_share"] < 0.4
    assert broken["interventions"] == 0
    assert row["completed"]
    assert row["interventions"] == 1
    assert 0.5 < row["intervened_s"] < 6.1
    assert row["charged_rms_m"] < 0.1
    assert row["disturbance_fault"] == kind


def test_the_key_of_a_row_changes_with_the_fault() -> None:
    faults = [Fault(kind="nan"), Fault(kind="nan", length=1.0), Fault(kind="frozen")]
    digests = {drive.digest(scenarios(broken=fault)[0]) for fault in faults}
    assert len(digests) == 3


def test_the_same_fault_is_the_same_drive() -> None:
    (scenario,) = scenarios(broken=Fault(kind="dropped", begin=1.0, share=0.8))
    rows = [drive.measure(scenario, GUARDED).plain() for _ in range(2)]
    timed = {name for name in rows[0] if "time" in name or "deadline" in name}
    assert all(rows[0][name] == rows[1][name] for name in set(rows[0]) - timed)


def test_supervised_entrants_by_name() -> None:
    pid, guarded, policy = entrants(["pid", "supervised/pid", "x=supervised/precision"])
    assert guarded.name == "supervised/pid"
    assert isinstance(guarded.controller, Supervisor)
    assert guarded.controller.inner == pid.controller
    assert policy.learned
    assert policy.waypoints > 0
    assert isinstance(policy, Entrant)
    assert guarded.digest != pid.digest
    assert isinstance(guarded.controller, ControllerComponent)


def test_every_fault_of_the_suite_can_be_written_down() -> None:
    kinds = {one.fault.kind for one in suites.faults().disturbances.values() if one.fault}
    assert kinds == set(Fault.model_fields["kind"].annotation.__args__)
    assert all(dump(one) for one in suites.faults().disturbances.values())
