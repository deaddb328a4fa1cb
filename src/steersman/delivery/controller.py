"""A controller as a C program: its step, its state and its parameters, from its Python source."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from steersman.controllers.base import ControllerComponent, designed
from steersman.controllers.policy import PolicyState
from steersman.delivery.c_text import identifier
from steersman.delivery.design_settings import DesignSettings
from steersman.delivery.graph import ExactNetwork, read_network
from steersman.delivery.state_fields import StateField, fields, named, settled
from steersman.delivery.translate.adaptive import ADAPTIVE_CALLS, begun
from steersman.delivery.translate.functions import CALLS
from steersman.delivery.translate.policies import POLICY_CALLS
from steersman.delivery.translate.program import Parameter, Program
from steersman.delivery.translate.statements import Statements
from steersman.delivery.translate.values import (
    BOOL,
    NEVER,
    REAL,
    Array,
    Bundle,
    Maybe,
    NotTranslatable,
    Pinned,
    Root,
    Scalar,
    Static,
    Type,
    Value,
    join,
    type_of,
)
from steersman.errors import ConfigError
from steersman.kernels.encode import EncodingTable
from steersman.network_file import PolicyNetwork
from steersman.types import NO_WISH, Observation
from steersman.vehicles import Vehicle

CALLS.update(POLICY_CALLS | ADAPTIVE_CALLS)
_PASSES = 8
DESIGN = "design"
"""What the names of numbers begin with that the controller makes before the first step."""
_NUMBERS = Observation._fields[:8]


class Setting(NamedTuple):
    """What a controller is exported for."""

    name: str
    controller: ControllerComponent
    vehicle: Vehicle
    dt: float
    """Control period [s]."""
    waypoints: int
    spacing: float
    """Distance between waypoints [m]."""
    precision: str = "double"
    """What --precision says: double, single, or mixed."""
    values: Mapping[str, float] = {}
    """Numbers of the design that are not what the controller makes, by their names."""
    table: frozenset[str] = frozenset()
    """Names in the table of parameters that was given; none if no table was."""

    @property
    def limits_speed(self) -> bool:
        """Whether observations have wished speeds, and decisions a largest one."""
        return self.controller.limits_speed()

    def start(self) -> Any:
        """The controller's state before the first step.

        Raises:
            ConfigError: its equations have no solution for this vehicle.
        """
        return _prepared(designed(self.controller, self.vehicle, self.dt), self.values)

    @property
    def single(self) -> bool:
        """Whether all numbers are float; mixed: what it is given and answers alone."""
        return self.precision == "single"

    @property
    def real(self) -> str:
        """What its numbers are in C: parameters, state, arithmetic."""
        return "float" if self.single else "double"

    @property
    def handed(self) -> str:
        """What observations and steering are in C."""
        return "double" if self.precision == "double" else "float"

    @property
    def prefix(self) -> str:
        """What all names in C begin with."""
        return f"steersman_{identifier(self.name)}"


class Translated(NamedTuple):
    """A controller in C."""

    setting: Setting
    program: Program
    fields: tuple[StateField, ...]
    step: tuple[str, ...]
    """Lines of the step: its status is returned, its steering stands in ``*steer``."""
    executed: tuple[str, ...]
    """Lines after another command was executed."""
    design_settings: tuple[str, ...] = ()
    """Settings that its step reads and its design is made of: constants."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """In the order of the table."""
        return tuple(self.program.parameters.values())


def translated(setting: Setting) -> Translated:
    """Make C of a controller.

    Raises:
        ConfigError: its Python holds what C cannot be made of; the message says where.
    """
    if setting.controller.follows():
        what = "it reads the gap to a car ahead, which observations in C do not have"
        raise ConfigError(f"no C code can be made of this controller: {what}", ("controller",))
    start = abstract(setting)
    pinned: frozenset[str] = frozenset()
    known = begun = type_of(start)
    design = DesignSettings(setting.controller, setting.vehicle, setting.dt)
    made_of: list[str] = []
    try:
        for _ in range(_PASSES):
            try:
                made = _Pass(setting, start, known, pinned)
                found = made.found
            except Pinned as error:
                pinned |= error.names
                continue
            paths = [each for each in made.program.parameters if not each.startswith(DESIGN)]
            late = [each for each in paths if design.acts(each)]
            if found == known and not late:
                return made.translated()._replace(design_settings=tuple(made_of))
            made_of += late
            pinned |= set(late)
            known = settled(found)
            pinned |= set(_changing(begun, known))
    except NotTranslatable as error:
        where = re.sub(r".*/steersman/", "", getattr(error, "where", "?"))
        raise ConfigError(
            f"no C code can be made of this controller: {error} ({where})", ("controller",)
        ) from None
    raise ConfigError("no C code can be made of this controller: its state keeps growing")


def _prepared(start: Any, values: Mapping[str, float]) -> Any:
    """A first state with other numbers in its arrays, and with exact networks."""
    done: dict[int, Any] = {}

    def part(value: Any, path: str) -> Any:
        if isinstance(value, tuple):
            names = getattr(value, "_fields", range(len(value)))
            parts = [part(v, f"{path}.{k}") for k, v in zip(names, value, strict=True)]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        if not isinstance(value, np.ndarray | PolicyNetwork):
            return value
        if id(value) not in done:  # what two fields hold stays one
            done[id(value)] = _replaced(value, path, values)
        return done[id(value)]

    return part(start, DESIGN)


def _replaced(value: Any, path: str, values: Mapping[str, float]) -> Any:
    if isinstance(value, PolicyNetwork):
        return ExactNetwork(read_network(*value.made_of[:2]))
    changed = {i: values[f"{path}[{i}]"] for i in range(value.size) if f"{path}[{i}]" in values}
    if changed:
        value = value.copy()
        value.flat[list(changed)] = list(changed.values())
    return value


def abstract(setting: Setting) -> Value:
    """A controller's first state; its arrays are parameters, unless they change."""
    paths: dict[int, str] = {}

    def part(value: Any, path: str) -> Value:
        if isinstance(value, Observation):
            value = value._replace(spacing=setting.spacing)  # that of all observations
        if isinstance(value, EncodingTable):  # what the network was trained with is no parameter
            return Static(value)
        if isinstance(value, tuple) and value:
            names = getattr(value, "_fields", range(len(value)))
            parts = [part(v, f"{path}.{k}") for k, v in zip(names, value, strict=True)]
            if isinstance(value, PolicyState) and value.adjuster is not None:
                at = value._fields.index("base_state")
                parts[at] = begun(value.adjuster, value.base_state, parts[at])
            return Bundle(type(value), tuple(parts))
        if isinstance(value, np.ndarray):  # what two fields hold is one parameter
            return Static(value, paths.setdefault(id(value), path))
        return Static(value)

    return part(setting.start(), DESIGN)


def _changing(begun: Type, found: Type) -> Iterator[str]:
    """The paths of arrays that steps change, of which the first numbers are no parameters."""
    if begun.form == "static":
        if found != begun and begun.detail[1] is not None:
            yield begun.detail[1]
    elif found.form == begun.form == "record":
        for one, other in zip(begun.parts, found.parts, strict=True):
            yield from _changing(one, other)


class _Pass:
    """One translation, for a state of a type."""

    def __init__(self, setting: Setting, start: Value, known: Type, pinned: frozenset[str]) -> None:
        self.setting, self.start, self.known = setting, start, known
        self.program = Program(single=setting.single, pinned=pinned)
        self.state = named(known, "state->")
        controller = Static(setting.controller, "")
        self.step = self._writer()
        kind = type(setting.controller)
        answer = self.step.call(kind.step, [controller, self.state, self._seen()])
        assert isinstance(answer, Bundle)
        self.decision, self.after = answer.items
        self.executed = self._writer()
        self.held = self.executed.call(
            kind.executed, [controller, self.state, Scalar("steer", REAL)]
        )
        self.found = join(known, join(type_of(self.after), type_of(self.held)))

    def _writer(self) -> Statements:
        return Statements(self.program, {}, {"__builtins__": {}}, NEVER)

    def _seen(self) -> Value:
        numbers = [Scalar(f"seen->{name}", REAL) for name in _NUMBERS]
        preview = Array("&seen->preview[0][0]", (self.setting.waypoints, 2), Root("seen"))
        spacing, wished = Static(self.setting.spacing), self._wished()
        seen = Bundle(Observation, (*numbers, preview, spacing, wished, Static(None)))
        return (
            Maybe(Scalar("(given != NULL)", BOOL), seen) if self.setting.controller.gaps else seen
        )

    def _wished(self) -> Value:
        if not self.setting.limits_speed:
            return Static(NO_WISH)
        return Array("seen->wished", (self.setting.waypoints,), Root("seen"))

    def translated(self) -> Translated:
        """The C program, once the state's type is that of what a step makes of it."""
        for writer, after in ((self.step, self.after), (self.executed, self.held)):
            writer.store(self.state, writer.local(after), self.known)
        assert isinstance(self.decision, Bundle)
        steer, status = (self.decision[name] for name in ("steer", "status"))
        kept = [*fields(self.state, self.start)]
        if self.setting.limits_speed:
            kept.append(StateField("decided_limit", REAL, None, (math.nan,)))
            limit = self.step.real(self.decision["speed_limit"])
            self.step.lines.append(f"state->decided_limit = {limit};")
        self.step.lines += [
            f"*steer = {self.step.real(steer)};",
            f"return {self.step.number(status).text};",
        ]
        return Translated(
            self.setting,
            self.program,
            tuple(kept),
            (*self.step.top, *self.step.lines),
            (*self.executed.top, *self.executed.lines),
        )
