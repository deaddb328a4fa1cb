"""The files of a controller in C: header, source, test vector, table of parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from importlib.metadata import version
from typing import Any

import numpy as np

from steersman.controllers import quadratic
from steersman.controllers.policy import Policy
from steersman.delivery import c_text
from steersman.delivery.c_text import fill
from steersman.delivery.controller import Setting, Translated
from steersman.delivery.observations import Row, observations, with_gaps, with_wishes
from steersman.delivery.parameter_table import described, entries, entries_of
from steersman.delivery.translate.emitter import c_type
from steersman.delivery.translate.lines import indented, without_unused
from steersman.delivery.translate.policies import NETWORK
from steersman.delivery.translate.program import Parameter
from steersman.types import Decision, Driver, Reason

# How far the steering in C may be from Python's.
# Limits that are above zero are at least this.
_SMALLEST = 1e-30
TOLERANCE = {False: 1e-9, True: 1e-5}


def tolerance(setting: Setting) -> float:
    """How far the steering in C may be from Python's; a network's float is summed more exactly."""
    return 1e-6 if alone(setting) and setting.single else TOLERANCE[setting.single]


def alone(setting: Setting) -> bool:
    """Whether it is a policy that steers without another controller."""
    return isinstance(setting.controller, Policy) and setting.start().base is None


def words(made: Translated) -> dict[str, Any]:
    """Words that all files hold."""
    s = made.setting
    return {
        "title": c_text.comment(s.name),
        "name": c_text.identifier(s.name),
        "prefix": s.prefix,
        "PREFIX": s.prefix.upper(),
        "version": version("steersman"),
        "real": "float" if s.single else "double",
        "precision": "float" if s.single else "double",
        "waypoints": s.waypoints,
        "tolerance": f"{tolerance(s):g}",
        **_speeds(s),
    }


def _speeds(setting: Setting) -> dict[str, str]:
    """Words of controllers that limit the speed."""
    real, prefix = "float" if setting.single else "double", setting.prefix
    head = f"{real} {prefix}_speed_limit(const {prefix}_state *state)"
    texts = {
        "wished": f"    {real} wished[{setting.waypoints}]; /* speeds at the waypoints [m/s] */\n",
        "speed_limit_declared": "/* After step(): the largest speed for the next period [m/s];"
        f" NaN: as wished. */\n{head};\n\n",
        "speed_limit": f"{head}\n{{\n    return state->speed_limit;\n}}\n\n",
        "limit_expected": f"    {real} speed_limit; /* expected */\n",
        "limit_checked": fill("limit_test.c.in", {"prefix": prefix}),
    }
    return texts if setting.limits_speed else dict.fromkeys(texts, "")


# What a header says of observations that cannot be used.
_HELD = """\
 * get the measured steering in [-1, 1] (0 if that is not finite either) and ..._FALLBACK; the state
 * stays as it was."""
_BRIDGED = """\
 * and observations that do not arrive, are bridged for a while by what the supervisor reckons, with
 * ..._SOLVED; then another controller steers, or the steering is held, with ..._FALLBACK. Count
 * faults by the state's driver and reason, not by what step() returns."""


def header(made: Translated) -> str:
    """The header."""
    s, literal = made.setting, made.program.literal
    real = "float" if s.single else "double"
    parameters = [
        f"{real} {each.name}{_size(each)}; /* {_meaning(s, each)} */" for each in made.parameters
    ] or [f"{real} none; /* there are no parameters */"]
    fields = [
        f"{real if c_type(each.kind) == 'real' else 'int'} {each.name}"
        + ("" if each.size is None else f"[{each.size}]")
        + ";"
        for each in made.fields
    ]
    return fill(
        "controller.h.in",
        {
            **words(made),
            "period": f"{s.dt:g}",
            "period_literal": literal(s.dt),
            "spacing": literal(s.spacing),
            "spacing_plain": f"{s.spacing:g}",
            "count": len(entries(made)),
            "gaps": fill("gap.h.in", _named_numbers(made)) if s.controller.gaps else "",
            "unusable": _BRIDGED if s.controller.gaps else _HELD,
            "network": _network_header(made),
            "parameter_fields": _block(parameters),
            "state_fields": _block(fields),
        },
    )


def _network_header(made: Translated) -> str:
    """What a header says of the network of a policy."""
    if not isinstance(made.setting.controller, Policy):
        return ""
    card = made.setting.controller.read()[1]
    rows = zip(card.observation, card.scale, strict=True)
    table = "".join(
        f" *   {i:5d}  {c_text.comment(name):39s}  {scale:.6g}\n"
        for i, (name, scale) in enumerate(rows)
    )
    sizes = {"features": len(card.scale), "actions": card.actions, "feature_table": table}
    return fill("network.h.in", {**words(made), **sizes})


def _named_numbers(made: Translated) -> dict[str, str]:
    """The names of those that steer, and of the reasons, as constants in C."""
    prefix = made.setting.prefix.upper()

    def lines(numbers: type[IntEnum]) -> str:
        kind = numbers.__name__.upper()
        return ",\n".join(f"    {prefix}_{kind}_{each.name} = {each.value}" for each in numbers)

    return {"drivers": lines(Driver), "reasons": lines(Reason)}


def _size(parameter: Parameter) -> str:
    value = parameter.value
    return f"[{value.size}]" if isinstance(value, np.ndarray) else ""


def _meaning(setting: Setting, parameter: Parameter) -> str:
    first, *_, last = described(setting, parameter) * 2
    if isinstance(parameter.value, np.ndarray):
        return c_text.comment(f"Row by row, from: {first.meaning} to: {last.meaning}")
    return c_text.comment(f"{first.meaning} [{first.unit}]")


def _block(lines: Sequence[str]) -> str:
    return "".join(f"    {each}\n" for each in lines)


def source(made: Translated) -> str:
    """The source."""
    program, common, gaps = made.program, words(made), made.setting.controller.gaps
    network = ""
    if isinstance(made.setting.controller, Policy):
        name = next(f.name for k, f in program.functions.items() if k[0] == NETWORK)
        network = fill("network.c.in", {**common, "function": name})
    texts = program.needed([*made.step, *made.executed, network])
    return fill(
        "controller.c.in",
        {
            **common,
            "helpers": "".join(f"{each}\n" for each in program.helpers.values()),
            "constants": program.constants_of([*made.step, *made.executed, *texts]),
            "defaults": _defaults(made),
            **_limits(made),
            "functions": "".join(f"{each}\n" for each in texts) + network,
            "reset": _block(_reset(made) or ["(void)state;"]),
            "step": _lines(made.step),
            "executed": _lines(("(void)p;", "(void)steer;", *made.executed)),
            "given": "given" if gaps else "seen",
            "gap": fill("gap.c.in", common) if gaps else "",
        },
    )


def _limits(made: Translated) -> dict[str, object]:
    """The limits of those parameters that have any."""
    rows = [
        f"    {{{i}, {_limit(made, each.minimum)}, {_limit(made, each.maximum)}}},\n"
        for i, each in enumerate(entries(made))
        if math.isfinite(each.minimum) or math.isfinite(each.maximum)
    ]
    body = "".join(rows) or "    {-1, 0, 0},\n"
    text = "static const struct {\n    int index;\n    real low;\n    real high;\n} limits[] = {\n"
    return {"limits": f"{text}{body}}};\n\n", "limit_count": max(len(rows), 1)}


def _limit(made: Translated, limit: float) -> str:
    """A limit in C, where above zero is above what float holds."""
    beside = math.copysign(_SMALLEST, limit)
    return made.program.literal(beside if 0.0 < abs(limit) < _SMALLEST else limit)


def _lines(lines: Sequence[str]) -> str:
    return "".join(f"{each}\n" for each in indented(without_unused(list(lines))))


def _defaults(made: Translated) -> str:
    literal, out = made.program.literal, []
    for each in made.parameters:
        numbers = [literal(entry.value) for entry in entries_of(made.setting, each)]
        text = ", ".join(numbers)
        out.append(f"{{{text}}}," if isinstance(each.value, np.ndarray) else f"{text},")
    return _block(out or [f"{literal(0.0)},"])


def _reset(made: Translated) -> list[str]:
    literal, out = made.program.literal, []
    for each in made.fields:
        numbers = [literal(x if c_type(each.kind) == "real" else int(x)) for x in each.start]
        if each.size is None:
            out.append(f"state->{each.name} = {numbers[0]};")
        elif len(set(numbers)) == 1:
            out += ["{", "    int i;", "", f"    for (i = 0; i < {each.size}; ++i) {{",
                    f"        state->{each.name}[i] = {numbers[0]};", "    }", "}"]  # fmt: skip
        else:
            out += [f"state->{each.name}[{i}] = {x};" for i, x in enumerate(numbers)]
    return out


@contextmanager
def counted_steps() -> Iterator[list[int]]:
    """The steps of all quadratic programs that are solved meanwhile in Python; -1: unsolved."""
    steps: list[int] = []
    quadratic.COUNTED.append(steps)
    try:
        yield steps
    finally:
        quadratic.COUNTED.pop()


def answers(setting: Setting, rows: Sequence[Row]) -> list[Decision]:
    """What Python's controller says to ``rows``."""
    start = state = setting.start()
    out = []
    for row in rows:
        state = start if row.restart else state
        decision, state = setting.controller.step(state, row.given)  # type: ignore[arg-type]
        out.append(decision)
        if row.executed is not None:
            state = setting.controller.executed(state, row.executed)
    return out


def rows_of(setting: Setting) -> list[Row]:
    """The test vector's steps."""
    rows = observations(setting, np.random.default_rng(0))
    rows = with_wishes(rows) if setting.limits_speed else rows
    return with_gaps(rows) if setting.controller.gaps else rows


def vector(made: Translated) -> str:
    """The test vector."""
    rows = rows_of(made.setting)
    pairs = zip(rows, answers(made.setting, rows), strict=True)
    text = "".join(_row(made, row, decision) for row, decision in pairs)
    return fill("controller_vector.h.in", {**words(made), "rows": text})


def _row(made: Translated, row: Row, decision: Decision) -> str:
    def number(value: float) -> str:
        return ("-" if value < 0.0 else "") + "INFINITY" if math.isinf(value) else _plain(value)

    def _plain(value: float) -> str:
        return "NAN" if math.isnan(value) else made.program.literal(value)

    pairs = [c_text.braces([number(x), number(y)]) for x, y in row.seen.preview.tolist()]
    seen = [number(x) for x in row.seen[:8]] + [c_text.braces(pairs)]
    limit = []
    if made.setting.limits_speed:
        seen.append(c_text.braces([number(x) for x in row.seen.wished.tolist()]))
        limit = [number(decision.speed_limit)]
    values = [
        str(int(row.restart)), str(int(row.missing)), c_text.braces(seen), number(decision.steer),
        str(int(decision.status)), *limit, str(int(row.executed is not None)),
        number(row.executed or 0.0),
    ]  # fmt: skip
    return f"    {c_text.braces(values)},\n"


def program(made: Translated) -> str:
    """The program that runs the test vector."""
    return fill("controller_test.c.in", words(made))
