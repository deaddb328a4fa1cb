"""What an FMU is made of: its variables, its C sources, and the lines that call them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from steersman.delivery import c_text
from steersman.delivery.controller import Setting
from steersman.delivery.controller_package import controller_card, prepared
from steersman.delivery.package import Tell, unsaid
from steersman.delivery.parameter_limits import limits
from steersman.delivery.parameter_table import entries, table_text
from steersman.delivery.plant import FIGURES, SEEN, TranslatedPlant
from steersman.vehicles import Vehicle

INPUT, OUTPUT, PARAMETER, INDEPENDENT = "input", "output", "parameter", "independent"


class Variable(NamedTuple):
    """A number of an FMU; its value reference is its place among the others."""

    name: str
    unit: str
    causality: str
    start: float
    meaning: str = ""
    whole: bool = False
    """An integer."""
    low: float = -math.inf
    high: float = math.inf


class FmuModel(NamedTuple):
    """What becomes an FMU."""

    prefix: str
    """What all names in C begin with; the identifier of the model."""
    title: str
    period: float
    """Control period [s]."""
    any_step: bool
    """Whether communication steps may be other than whole multiples of the period."""
    variables: tuple[Variable, ...]
    """Inputs, outputs, parameters, time, in this order."""
    sources: Mapping[str, str]
    """C files by their names."""
    resources: Mapping[str, str]
    """The card, and the table of parameters."""
    parameters: str
    """C type of the parameters, empty where there are none."""
    real: str
    """C type of a number."""
    lines: Mapping[str, Sequence[str]]
    """C lines: ``begin`` before the first step, ``advance`` for one control period."""

    def those(self, causality: str) -> list[Variable]:
        """The inputs, outputs or parameters."""
        return [each for each in self.variables if each.causality == causality]


_TIME = Variable("time", "s", INDEPENDENT, 0.0)
_STEER = Variable("steer_command", "-", OUTPUT, 0.0, "Normalised steering for the next period.")
_STATUS = Variable(
    "status", "-", OUTPUT, 0.0, "0 solved, 1 saturated at a limit, 2 fallback.", whole=True
)
_OVERRULED = (
    Variable("overruled", "-", INPUT, 0.0, "1: other steering was executed before.", whole=True),
    Variable("executed", "-", INPUT, 0.0, "The normalised steering that was executed then."),
)


_MISSING = Variable("missing", "-", INPUT, 0.0, "1: no observation arrived.", whole=True)


def _seen(waypoints: int, spacing: float) -> list[Variable]:
    """What a controller sees; a straight road until inputs are set."""
    out = [Variable(name, unit, INPUT, 0.0, "As observed.") for name, unit in SEEN]
    for i in range(waypoints):
        where = f"Waypoint {i * spacing:g} m ahead, in the vehicle's frame."
        out.append(Variable(f"preview[{i}].x", "m", INPUT, i * spacing, where))
        out.append(Variable(f"preview[{i}].y", "m", INPUT, 0.0, where))
    return out


_LIMIT = Variable("speed_limit", "m/s", OUTPUT, 0.0, "Largest speed; NaN: as wished.")


def _observed(prefix: str, real: str, waypoints: int, wishes: int) -> list[str]:
    """C lines that make an observation of the inputs, which begin with it."""
    names = [name for name, _ in SEEN]
    first = len(names) + 2 * waypoints
    return [
        f"{prefix}_observation seen;",
        f"{real} steer = 0;",
        "int i;",
        "",
        f"seen.time = ({real})time;",
        *(f"seen.{name} = ({real})m->value[{i}];" for i, name in enumerate(names)),
        f"for (i = 0; i < {waypoints}; ++i) {{",
        f"    seen.preview[i][0] = ({real})m->value[{len(names)} + 2 * i];",
        f"    seen.preview[i][1] = ({real})m->value[{len(names) + 1} + 2 * i];",
        *[f"    seen.wished[i] = ({real})m->value[{first} + i];"] * bool(wishes),
        "}",
    ]


def _steered(prefix: str, real: str, variables: Iterable[Variable]) -> list[str]:
    """C lines that call a controller: other steering that was executed, then the step."""
    at = {each.name: i for i, each in enumerate(variables)}
    seen = "&seen"
    if _MISSING.name in at:
        seen = f"m->value[{at[_MISSING.name]}] != 0.0 ? NULL : &seen"
    return [
        f"if (m->value[{at['overruled']}] != 0.0) {{",
        f"    {prefix}_executed(&m->state, ({real})m->value[{at['executed']}]);",
        "}",
        f"m->value[{at['status']}] = {prefix}_step(&m->state, {seen}, &steer);",
        f"m->value[{at['steer_command']}] = (double)steer;",
        *[
            f"m->value[{at[_LIMIT.name]}] = (double){prefix}_speed_limit(&m->state);"
            for _ in [_LIMIT.name] * (_LIMIT.name in at)
        ],
    ]


def _structured(name: str) -> str:
    """A dotted name by FMI's structured naming convention, in which a place stands in brackets.

    >>> _structured("design.chain.0.settings[2]")
    'design.chain[0].settings[2]'
    """
    return re.sub(r"\.(\d+)(?![^.[])", r"[\1]", name)


def controller_model(setting: Setting, tell: Tell = unsaid) -> FmuModel:
    """A controller of which C can be made.

    Raises:
        ConfigError: its Python holds what C cannot be made of.
        DataError: a number of the design that was given is none of its own.
    """
    made, sources = prepared(setting, tell)
    s, real, handed = setting, setting.real, setting.handed
    wishes = s.waypoints if s.limits_speed else 0
    meaning = "Speed wished at the waypoint."
    wished = [Variable(f"wished[{i}]", "m/s", INPUT, 0.0, meaning) for i in range(wishes)]
    inputs = [*_seen(s.waypoints, s.spacing), *wished, *_OVERRULED, *[_MISSING] * s.controller.gaps]
    variables = [*inputs, _STEER, _STATUS, *[_LIMIT] * s.limits_speed]
    table = [
        Variable(
            _structured(e.name), e.unit, PARAMETER, e.value, e.meaning, False, e.minimum, e.maximum
        )
        for e in entries(made)
    ]
    name = c_text.identifier(s.name)
    card = controller_card(made, sources)
    return FmuModel(
        s.prefix,
        s.name,
        s.dt,
        True,
        (*variables, *table, _TIME),
        sources,
        {f"{name}.csv": table_text(made), f"{name}.json": card},
        f"{s.prefix}_parameters",
        real,
        {
            "begin": [f"{s.prefix}_init(&m->state, &m->parameters);"],
            "advance": [
                *_observed(s.prefix, handed, s.waypoints, wishes),
                *_steered(s.prefix, handed, variables),
            ],
        },
    )


_ENDED = Variable(
    "ended", "-", OUTPUT, 0.0,
    "0 drives, 1 has left its corridor, 2 has rolled over, 3 is at the end, 4 time is up.",
    whole=True,
)  # fmt: skip


def _limits(figure: str) -> tuple[float, float]:
    """Of a figure of the car; those that are no field of its file have none."""
    field = Vehicle.model_fields.get(figure)
    return (-math.inf, math.inf) if field is None else limits(field)


def plant_model(made: TranslatedPlant) -> FmuModel:
    """The simulated car on its road."""
    p = made.prefix
    pedals = [
        Variable("throttle", "-", INPUT, made.throttle, "Throttle.", low=0.0, high=1.0),
        Variable("brake", "-", INPUT, 0.0, "Brake.", low=0.0, high=1.0),
    ]
    steer = next(each.start for each in made.outputs if each.name == "car.steer")
    inputs = [
        Variable("steer_command", "-", INPUT, steer, "Normalised steering.", low=-1.0, high=1.0),
        *(pedals if made.pedals else []),
    ]
    outputs = [Variable(o.name, o.unit, OUTPUT, o.start) for o in made.outputs]
    figures = zip(FIGURES, made.figures.tolist(), strict=True)
    parameters = [
        Variable(name, unit, PARAMETER, value, "Of the car.", False, *_limits(name))
        for (name, unit), value in figures
    ]
    first = len(inputs)
    given = [f"given.{name} = m->value[{i}];" for i, (name, *_) in enumerate(inputs)]
    return FmuModel(
        p,
        made.name,
        made.dt,
        False,
        (*inputs, *outputs, _ENDED, *parameters, _TIME),
        {f"{p}.c": made.source, f"{p}.h": made.header},
        {f"{c_text.identifier(made.name)}.json": json.dumps(made.card(), indent=1) + "\n"},
        f"{p}_parameters",
        "double",
        {
            "begin": [
                f"{p}_init(&m->state, &m->parameters);",
                f"{p}_look(&m->state, m->value + {first});",
            ],
            "advance": [
                f"{p}_inputs given = {{0.0, 0.0, 0.0}};",
                "",
                "(void)time;",
                *given,
                f"m->value[{first + len(outputs)}] = {p}_step(&m->state, &given);",
                f"{p}_look(&m->state, m->value + {first});",
            ],
        },
    )
