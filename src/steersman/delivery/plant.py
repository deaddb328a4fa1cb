"""The simulated car on its road as a C program: one control period, from the world's kernels."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.delivery import c_text
from steersman.delivery.c_text import fill
from steersman.delivery.translate.lines import indented, without_unused
from steersman.delivery.translate.program import Program
from steersman.delivery.translate.statements import Statements
from steersman.delivery.translate.values import (
    NEVER,
    REAL,
    Array,
    Bundle,
    NotTranslatable,
    Root,
    Scalar,
    Static,
    Value,
)
from steersman.errors import ConfigError
from steersman.kernels import observe as obs
from steersman.kernels import vehicle as car
from steersman.kernels import world as kernel
from steersman.kernels.fleet import Fleet, World
from steersman.kernels.speed import CONSTANT_THROTTLE, IS_PROFILE
from steersman.provenance import provenance
from steersman.rollout import RunConfig, RunningDrive
from steersman.types import FloatArray

_FIGURES = "figures"
_KEPT = frozenset({
    "state", "tracking", "rows", "late", "delayed", "clock", "ended", "sent",
    "work", "command", "measured", "place",
})  # fmt: skip
"""What of a fleet a step changes; the rest is known."""
SEEN = (
    *(("lateral_error", "m"), ("heading_error", "rad"), ("v_x", "m/s"), ("v_y", "m/s")),
    *(("yaw_rate", "rad/s"), ("steer", "-"), ("curvature", "1/m")),
)
"""Names and units of what a controller sees before the waypoints."""
_STATE = (
    *(("x", "m"), ("y", "m"), ("psi", "rad"), ("v_x", "m/s"), ("v_y", "m/s")),
    *(("yaw_rate", "rad/s"), ("load_a_x", "m/s^2"), ("load_a_y", "m/s^2"), ("steer", "-")),
    *(("throttle", "-"), ("brake", "-"), ("a_x", "m/s^2"), ("a_y", "m/s^2")),
    ("wheel_angle", "rad"),
)
_TRACKING = (
    *(("s", "m"), ("lateral_error", "m"), ("heading_error", "rad"), ("course_error", "rad")),
    *(("curvature", "1/m"), ("x", "m"), ("y", "m")),
)
# Of the rows of figures, in the order of the columns of steersman.kernels.vehicle.
FIGURES = (
    *(("mass", "kg"), ("yaw_inertia", "kg m^2"), ("l_f", "m"), ("l_r", "m")),
    *(("track_width", "m"), ("roll_arm", "m"), ("c_f", "N/rad"), ("c_r", "N/rad")),
    *(("friction", "-"), ("drag", "kg/m"), ("drive_front", "-"), ("brake_force", "N")),
    *(("brake_front", "-"), ("max_wheel_angle", "rad"), ("ackermann", "-")),
    *(("steer_rate_up", "1/s"), ("steer_rate_down", "1/s")),
    *(("pedal_rate_up", "1/s"), ("pedal_rate_down", "1/s"), ("map_mass", "kg")),
    *(("map_drag", "kg/m"), ("load_lag", "s"), ("fade_speed", "m/s"), ("slip_speed", "m/s")),
    *(("steer_bias", "-"), ("side_force", "N"), ("yaw_moment", "N m"), ("steer_lag", "s")),
    *(("stiffness_load_limit", "-"), ("rotating_mass", "kg"), ("grip_left", "-")),
    ("grip_right", "-"),
)


class PlantOutput(NamedTuple):
    """A number that the plant gives after each step, and where it stands in the C state."""

    name: str
    unit: str
    text: str
    start: float


class TranslatedPlant(NamedTuple):
    """A plant in C."""

    name: str
    config: RunConfig
    pedals: bool
    """Whether throttle and brake are inputs, else the speed is controlled inside."""
    throttle: float
    """Before the first step."""
    dt: float
    """Control period [s]."""
    figures: FloatArray
    """(N_PARAMS,) the vehicle's parameters."""
    outputs: tuple[PlantOutput, ...]
    source: str
    header: str

    @property
    def prefix(self) -> str:
        """What all names in C begin with."""
        return f"steersman_{c_text.identifier(self.name)}"

    def card(self) -> dict[str, Any]:
        """What it was made from."""
        return {"name": self.name, "drive": self.config.model_dump(mode="json"), **provenance()}


def translated_plant(name: str, config: RunConfig) -> TranslatedPlant:
    """The car of a drive on its road, with actuators, delay, pedals and sensor.

    Raises:
        ConfigError: it has something that is drawn at random, or is not computed by the
            embedded simulator.
    """
    _check(config)
    drive = RunningDrive(config)
    simulation = drive.simulation
    simulation.look(0)
    # What is wished is for controllers beside the pedals, which have no C.
    world, fleet = simulation.world, simulation.fleet._replace(wishes=np.zeros((1, 0)))
    program = Program(single=False)
    writer = Statements(program, {}, {"__builtins__": {}}, NEVER)
    inputs = [Scalar(f"given->{each}", REAL) for each in ("steer_command", "throttle", "brake")]
    try:
        writer.call(_driven, [_constants(world), _state(fleet), *inputs])
    except NotTranslatable as error:
        raise ConfigError(f"no C code can be made of this plant: {error}", ("plant",)) from None
    lines = [*writer.top, *writer.lines]
    speed = world.speed.rows[0]
    pedals = speed[IS_PROFILE] == 0.0
    outputs = tuple(_outputs(fleet))
    figures = world.vehicles.rows[0].copy()
    made = TranslatedPlant(
        name, config, pedals, float(speed[CONSTANT_THROTTLE]), simulation.dt, figures, outputs,
        "", "",
    )  # fmt: skip
    return made._replace(source=_source(made, program, lines, fleet), header=_header(made, fleet))


def _check(config: RunConfig) -> None:
    """Refuse what a program that repeats to the bit has no place for."""
    if not config.plant.embedded:
        raise ConfigError(f"{config.plant.kind}: only the embedded simulator leaves", ("plant",))
    drawn = {
        "sensor": config.sensor.make(1, 0) is not None,
        "fault": config.fault is not None,
        "disturbances": any((*config.disturbances, *config.plant.disturbances(1, 0))),
    }
    for field, given in drawn.items():
        if given:
            raise ConfigError("random errors and disturbances have no C; leave them out", (field,))


def _driven(world: World, fleet: Fleet, steer: float, throttle: float, brake: float) -> None:
    """One control period of vehicle 0: C is made of this; ``steer`` in [-1, 1]."""
    near = kernel.decide(world, fleet, 0, steer)
    if world.speed.rows[0, IS_PROFILE] == 0.0:
        fleet.command[0, car.CMD_THROTTLE] = throttle
        fleet.command[0, car.CMD_BRAKE] = brake
    kernel.carry_out(world, fleet, 0, near)


def _constants(world: World) -> Value:
    """The world, known but for the vehicle's figures, which are parameters."""
    table = world.vehicles
    vehicle = [
        Static(value, _FIGURES if name == "rows" else None)
        for name, value in table._asdict().items()
    ]
    parts = {k: Static(v) for k, v in world._asdict().items()}
    return Bundle(
        World, tuple((parts | {"vehicles": Bundle(type(table), tuple(vehicle))}).values())
    )


def _changing(fleet: Fleet) -> dict[str, Any]:
    return {k: v for k, v in fleet._asdict().items() if k in _KEPT and v.size}


def _state(fleet: Fleet) -> Value:
    changing, parts = _changing(fleet), dict[str, Value]()
    for name, known in fleet._asdict().items():
        kind = "int" if known.dtype.kind in "iu" else REAL
        root = Root("state", written=True)
        kept = Array(f"state->{name}", known.shape, root, (), kind)
        parts[name] = kept if name in changing else Static(known)
    return Bundle(Fleet, tuple(parts.values()))


def _outputs(fleet: Fleet) -> list[PlantOutput]:
    """What a controller sees, then the truth about car and road, then how the drive ended."""
    row = fleet.rows[0]
    count = (len(row) - obs.O_PREVIEW) // 2
    seen = [*SEEN, *((f"preview[{i}].{axis}", "m") for i in range(count) for axis in "xy")]
    out = []
    for array, names, before in (
        ("rows", seen, ""),
        ("state", _STATE, "car."),
        ("tracking", _TRACKING, "road."),
    ):
        start = getattr(fleet, array)[0]
        out += [
            PlantOutput(before + name, unit, f"state->{array}[{i}]", float(start[i]))
            for i, (name, unit) in enumerate(names)
        ]
    sent = [("sent.steer", "state->sent[0]"), ("sent.throttle", "state->command[1]")]
    sent += [("sent.brake", "state->command[2]")]
    return [*out, *(PlantOutput(name, "-", text, 0.0) for name, text in sent)]


def _words(made: TranslatedPlant) -> dict[str, Any]:
    return {
        "title": c_text.comment(made.name),
        "prefix": made.prefix,
        "PREFIX": made.prefix.upper(),
        "period": f"{made.dt:g}",
        "period_literal": repr(made.dt),
        "figures": len(FIGURES),
        "outputs": len(made.outputs),
    }


def _header(made: TranslatedPlant, fleet: Fleet) -> str:
    fields = [
        f"{'int' if known.dtype.kind in 'iu' else 'double'} {name}[{known.size}];"
        for name, known in _changing(fleet).items()
    ]
    order = [f" *   {i:3}  {o.name} [{o.unit}]" for i, o in enumerate(made.outputs)]
    figures = [f" *   {i:3}  {name} [{unit}]" for i, (name, unit) in enumerate(FIGURES)]
    return fill(
        "plant.h.in",
        {
            **_words(made),
            "state_fields": "".join(f"    {each}\n" for each in fields),
            "output_table": "\n".join(order),
            "figure_table": "\n".join(figures),
        },
    )


def _source(made: TranslatedPlant, program: Program, lines: list[str], fleet: Fleet) -> str:
    start = []
    for name, known in _changing(fleet).items():
        numbers = ", ".join(program.literal(each) for each in known.ravel().tolist())
        start.append(f"    {{{numbers}}}, /* {name} */\n")
    return fill(
        "plant.c.in",
        {
            **_words(made),
            "helpers": "".join(f"{each}\n" for each in program.helpers.values()),
            "constants": "".join(f"{text}\n" for _, text in program.constants.values()),
            "defaults": ", ".join(program.literal(each) for each in made.figures.tolist()),
            "functions": "".join(f"{each}\n" for each in program.needed(lines)),
            "start": "".join(start),
            "step": "\n".join(indented(without_unused(lines))),
            "out": "\n".join(f"    out[{i}] = {each.text};" for i, each in enumerate(made.outputs)),
        },
    )
