"""What every plant has to fulfil; for packages with plants of their own, too."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from steersman.bench.disturbance import Disturbance
from steersman.contracts import Contract
from steersman.paths.analytic import Circle
from steersman.plants.base import PlantComponent
from steersman.rollout import RunConfig, run
from steersman.types import Command, FloatArray, Pose, VehicleState
from steersman.vehicles import CarlaModel3, Vehicle

# Each disturbance that a plant may list in ``cannot``, in a strength that no plant overlooks.
DISTURBED = {
    "delay": Disturbance(delay=0.2),
    "mass": Disturbance(mass=1.3),
    "yaw_inertia": Disturbance(yaw_inertia=1.3),
    "c_f": Disturbance(c_f=0.7),
    "c_r": Disturbance(c_r=0.7),
    "friction": Disturbance(friction=0.5),
    "steer_rate": Disturbance(steer_rate=0.1),
    "steer_bias": Disturbance(steer_bias=0.02),
    "wind": Disturbance(wind=25.0),
}
_POSE, _SPEED, _STEPS = Pose(3.0, -2.0, 0.7), 12.0, 60
# Differences at the start that count [m], [rad].
_NEAR = 1e-3
_PATH = Circle(radius=60.0)


def driven(
    plant: PlantComponent,
    vehicle: Vehicle | None = None,
    steer: Callable[[int], float] = lambda k: 0.05 * np.sin(0.3 * k),
) -> list[VehicleState]:
    """States under a fixed steering, throttle 0.4, from :data:`_POSE` at 12 m/s straight on."""
    made = plant.make(vehicle or CarlaModel3())
    try:
        made.enter(_PATH)
        states = [made.reset(_POSE, _SPEED, 0.0)]
        for k in range(_STEPS):
            states.append(made.step(Command(float(steer(k)), 0.4, 0.0)))
        return states
    finally:
        made.close()


def what_it_cannot_is_declared(plant: PlantComponent) -> Iterator[str]:
    """``cannot`` lists what has no effect on it, and every other disturbance changes the motion."""
    unknown = sorted(plant.cannot - set(DISTURBED))
    if unknown:
        yield f"cannot names {', '.join(unknown)}; allowed: {', '.join(DISTURBED)}"
    for name, disturbance in DISTURBED.items():
        if name not in plant.cannot and not _changes(plant, disturbance):
            yield f"ignores {name}; let it act, or list it in cannot"


def its_motion_repeats(plant: PlantComponent) -> Iterator[str]:
    """Finite, in steps of the control period, and the same from the same start."""
    once, again = driven(plant), driven(plant)
    if not np.isfinite(np.array(once)).all():
        yield "its state is not finite"
    if once != again:
        yield "the same commands from the same start give another motion"
    times = [state.time for state in once]
    if not np.allclose(times, plant.dt * np.arange(len(once)), atol=1e-9):
        yield f"time goes on in other steps than dt, {plant.dt} s"


def reset_puts_it_on_the_pose(plant: PlantComponent) -> Iterator[str]:
    """With the speed that is wanted, in the direction of the pose."""
    first = driven(plant)[0]
    place = (first.x - _POSE.x, first.y - _POSE.y)
    if np.hypot(*place) > _NEAR:
        yield f"reset puts it {np.hypot(*place):.3g} m beside the pose"
    speed = float(np.hypot(first.v_x, first.v_y))
    if abs(speed - _SPEED) > 0.01 * _SPEED:
        yield f"reset gives it {speed:.4g} m/s instead of {_SPEED:g}"
    turned = first.psi + np.arctan2(first.v_y, first.v_x) - _POSE.psi
    if abs(np.sin(0.5 * turned)) > _NEAR:
        yield f"reset turns its velocity by {turned:.3g} rad from the pose"


def _changes(plant: PlantComponent, disturbance: Disturbance) -> bool:
    """Whether a closed loop moves otherwise under a disturbance."""
    usual = RunConfig(plant=plant, path=_PATH, duration=_STEPS * plant.dt, corridor=20.0)
    usual = usual.model_copy(update={"nominal": usual.vehicle})
    other = disturbance.apply(usual).model_copy(
        update={"nominal": usual.vehicle, "speed": usual.speed}
    )
    one, two = _motion(usual), _motion(other)
    return one.shape != two.shape or not np.allclose(one, two, rtol=0.0, atol=1e-6)


def _motion(config: RunConfig) -> FloatArray:
    episode = run(config)
    return np.stack([episode[name] for name in ("x", "y", "psi", "v_x", "v_y", "yaw_rate")])


def a_delay_is_later_commands(plant: PlantComponent) -> Iterator[str]:
    """Delayed by whole control periods, it moves as if the commands came later."""
    if "delay" in plant.cannot:
        return
    steps = max(round(0.2 / plant.dt), 1)

    def pulse(k: int) -> float:
        return 0.1 if k >= 5 else 0.0  # noqa: PLR2004 - some steps after the start

    def later(k: int) -> float:
        return held if k < steps else pulse(k - steps)

    held = driven(plant)[0].steer  # until the first command acts
    late = plant.model_copy(update={"steering_delay": steps * plant.dt})
    found = [state.yaw_rate for state in driven(late, steer=pulse)]
    expected = [state.yaw_rate for state in driven(plant, steer=later)]
    if not np.allclose(found, expected, atol=1e-6):
        yield f"a steering delay of {steps * plant.dt:g} s is not one of {steps} control periods"


check: Contract[PlantComponent] = Contract(
    what_it_cannot_is_declared,
    its_motion_repeats,
    reset_puts_it_on_the_pose,
    a_delay_is_later_commands,
)
"""Drives a plant for some seconds at a time, on a circle of radius 60 m at 12 m/s."""
