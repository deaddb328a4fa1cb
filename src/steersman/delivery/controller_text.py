"""The files of a controller in C: header, source, test vector, table of parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from importlib.metadata import version
from typing import Any

import numpy as np

from steersman.controllers.policy import Policy
from steersman.delivery import c_text
from steersman.delivery.c_text import fill
from steersman.delivery.controller import Setting, Translated
from steersman.delivery.parameter_table import described, entries, entries_of
from steersman.delivery.translate.emitter import c_type
from steersman.delivery.translate.lines import indented, without_unused
from steersman.delivery.translate.policies import NETWORK
from steersman.delivery.translate.program import Parameter
from steersman.types import Driver, Reason

# Limits that are above zero are at least this.
_SMALLEST = 1e-30
TOLERANCE = {"double": 1e-9, "mixed": 1e-6, "single": 1e-6}
"""How far the steering in C may be from Python's."""


def words(made: Translated) -> dict[str, Any]:
    """Words that all files hold."""
    s = made.setting
    return {
        "title": c_text.comment(s.name),
        "name": c_text.identifier(s.name),
        "prefix": s.prefix,
        "PREFIX": s.prefix.upper(),
        "version": version("steersman"),
        "real": s.real,
        "handed": s.handed,
        "precision": f"double between {s.handed}s" if s.precision == "mixed" else s.real,
        "waypoints": s.waypoints,
        "tolerance": f"{TOLERANCE[s.precision]:g}",
        **_speeds(s),
    }


def _speeds(setting: Setting) -> dict[str, str]:
    """Words of controllers that limit the speed."""
    handed, prefix = setting.handed, setting.prefix
    head = f"{handed} {prefix}_speed_limit(const {prefix}_state *state)"
    texts = {
        "wished": f"    {handed} wished[{setting.waypoints}];"
        " /* speeds at the waypoints [m/s] */\n",
        "speed_limit_declared": "/* After step(): the largest speed for the next period [m/s];"
        f" NaN: as wished. */\n{head};\n\n",
        "speed_limit": f"{head}\n{{\n    return ({handed})state->decided_limit;\n}}\n\n",
        "limit_expected": f"    {handed} speed_limit; /* expected */\n",
        "limit_checked": fill("limit_test.c.in", {"prefix": prefix}),
    }
    return texts if setting.limits_speed else dict.fromkeys(texts, "")


# An observation that did not arrive has no numbers to be widened.
_UNLESS = """\
    if (given == NULL) {
        status = step_in_double(state, NULL, &answer);
        *steer = (float)answer;
        return status;
    }
"""
# What a header says of observations that cannot be used.
_HELD = """\
 * get the measured steering in [-1, 1] (0 if that is not finite either) and ..._FALLBACK; the state
 * stays as it was."""
_BRIDGED = """\
 * and observations that do not arrive, are bridged for a while by what the supervisor reckons, with
 * ..._SOLVED; then another controller steers, or the steering is held, with ..._FALLBACK. Count
 * faults by the state's driver and reason, not by what step() returns."""


def sources(made: Translated) -> dict[str, str]:
    """Source and header by the names of their files."""
    prefix = made.setting.prefix
    return {f"{prefix}.c": source(made), f"{prefix}.h": header(made)}


def header(made: Translated) -> str:
    """The header."""
    s, literal = made.setting, made.program.literal
    real = s.real
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
    prefix, mixed = made.setting.prefix, made.setting.precision == "mixed"
    observation = "wide_observation" if mixed else f"{prefix}_observation"
    given = "given" if gaps else "seen"
    arguments = f"{prefix}_state *state, const {observation} *{given}"
    widened = {**common, "unless_given": _UNLESS * gaps, **_wide_wishes(made.setting)}
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
            "gap": fill("gap.c.in", {**common, "observation": observation}) if gaps else "",
            "observation": observation,
            "step_head": f"static int step_in_double({arguments}, double *steer)"
            if mixed
            else f"int {prefix}_step({arguments}, {made.setting.handed} *steer)",
            "widened": fill("widened.h.in", widened) if mixed else "",
            "narrowed": fill("narrowed.c.in", widened) if mixed else "",
        },
    )


def _wide_wishes(setting: Setting) -> dict[str, str]:
    """Words of the wished speeds in double."""
    wishes = {
        "wide_wished": f"    double wished[{setting.waypoints}];\n",
        "copied_wished": "        wide.wished[i] = (double)given->wished[i];\n",
    }
    return wishes if setting.limits_speed else dict.fromkeys(wishes, "")


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
