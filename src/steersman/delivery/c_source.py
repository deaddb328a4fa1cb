"""A policy as one header and one source in C99."""

from __future__ import annotations

from importlib.metadata import version
from importlib.resources import files
from string import Template
from typing import Any, NamedTuple

import numpy as np

from steersman.controllers.policy import Policy, card_table
from steersman.delivery import c_text
from steersman.delivery.c_network import activations, arrays, layers
from steersman.delivery.c_text import decimal
from steersman.delivery.graph import CLIP, TANH, Network
from steersman.delivery.source import Source, controller
from steersman.errors import DataError
from steersman.kernels.encode import EncodingTable
from steersman.policy_file import PolicyCard

# Hidden values beyond this leave no room for what is done with them in float32.
_LARGEST = 1e30
# What a sensor gives.
_WAYPOINTS = 100


class Parts(NamedTuple):
    """What C text is made of."""

    source: Source
    network: Network
    table: EncodingTable
    trim: float
    policy: Policy

    @property
    def card(self) -> PolicyCard:
        """The policy's card."""
        return self.source.card

    @property
    def name(self) -> str:
        """The policy's name as a part of C names."""
        return c_text.identifier(self.source.name)


def parts(source: Source, network: Network) -> Parts:
    """Check that C can be made of a policy.

    Raises:
        DataError: its network or its card holds what the C text has no place for.
    """
    card = source.card
    table = card_table(card)
    if not len(network.scale) == len(card.scale) == len(card.observation):
        raise DataError(
            f"{source.file}: the network takes {len(network.scale)} features, but its card names "
            f"{len(card.observation)} with {len(card.scale)} scales"
        )
    if card.waypoints > _WAYPOINTS:
        raise DataError(f"{source.file}: {card.waypoints} waypoints, at most {_WAYPOINTS} expected")
    if len(network.layers[-1].bias) != 1:
        raise DataError(f"{source.file}: {len(network.layers[-1].bias)} actions, expected 1")
    size = np.full(len(network.scale), network.limit)
    for layer in network.layers:
        size = abs(layer.weights).astype(np.float64) @ size + abs(layer.bias)
        if size.max() > _LARGEST:
            raise DataError(f"{source.file}: hidden values up to {size.max():.1e} leave float32")
        if layer.activation in {TANH, CLIP}:
            size = np.minimum(size, 1.0)
    return Parts(source, network, table, card.trim, controller(source))


def fill(template: str, words: dict[str, Any]) -> str:
    """A template of this package with its words filled in."""
    text = files("steersman.delivery.templates").joinpath(template).read_text(encoding="utf-8")
    return Template(text).substitute(words)


def common(p: Parts) -> dict[str, Any]:
    """Words that all files hold."""
    return {
        "title": c_text.comment(p.source.name),
        "name": p.name,
        "prefix": f"steersman_{p.name}",
        "PREFIX": f"STEERSMAN_{p.name.upper()}",
        "version": version("steersman"),
        "features": len(p.network.scale),
        "waypoints": p.card.waypoints,
    }


def _signature(p: Parts) -> dict[str, str]:
    """Words of the functions that a residual policy has beside the others."""
    names = common(p)
    prefix, pad = names["prefix"], " " * len(f"int {names['prefix']}_step(")
    none = ("base_comment", "base_parameter", "base_declaration", "base_function", "base_check")
    if p.card.base is None:
        empty = dict.fromkeys((*none, "base_feature", "residual_note"), "")
        return {**empty, "step_indent": pad}
    head = (
        f"void {prefix}_base_observation(const {prefix}_state *state,\n"
        f"    const {prefix}_observation *seen, {prefix}_observation *told)"
    )
    return {
        "step_indent": pad,
        "base_parameter": "float base, ",
        "base_check": " || !isfinite(base)",
        "base_comment": "\n * base: the command of the controller that is corrected.",
        "base_feature": (
            "    base = clip(base, 1.0f);\n"
            f"    features[{names['features'] - 1}] = base - next.last_command;\n"
        ),
        "base_declaration": (
            "\n/* What the corrected controller is to be told in this period, before step(). */\n"
            f"{head};\n"
        ),
        "base_function": f"{head}\n{{\n    shifted(seen, next_shift(state, seen), told);\n}}\n\n",
        "residual_note": _residual_note(p),
    }


def _residual_note(p: Parts) -> str:
    kind = c_text.comment(str((p.card.base or {}).get("kind")))
    return f""" *
 * CORRECTS ANOTHER CONTROLLER ({kind}; its settings are base in the card), which is
 * the caller's part: in each period ask ..._base_observation() what it is to be told, and give its
 * command, normalised steering in [-1, 1], to step(). Then tell it what step() answered if it
 * remembers its commands: that was executed, and not its own. The correction is at most
 * {p.card.authority:g} of full lock. The other controller's own failures are the caller's to see.
"""


def header(p: Parts) -> str:
    """The header."""
    card, table = p.card, p.table
    widest = max(len(p.network.scale), *(len(layer.bias) for layer in p.network.layers))
    weights = sum(layer.weights.size + layer.bias.size for layer in p.network.layers)
    observation, remembered = 7 + 2 * card.waypoints, 4 + 2 * table.history
    meaning = "action: steering in [-1, 1]"
    if card.rate_limit is not None:
        meaning = f"action in [-1, 1]: rate of steering over {card.rate_limit:g} per second"
    if card.base is not None:
        meaning = "action in [-1, 1]: correction of the other controller's command over authority"
    return fill(
        "policy.h.in",
        {
            **common(p),
            **_signature(p),
            "period": f"{card.dt:g}",
            "period_literal": decimal(card.dt, "dt"),
            "spacing": decimal(card.spacing, "spacing"),
            "spacing_plain": f"{card.spacing:g}",
            "preview": max(card.waypoints, 1),
            "history_size": max(table.history, 1),
            "stack": 4 * (4 * widest + len(p.network.scale) + observation + remembered + 100),
            "bytes": 4 * (weights + len(p.network.scale)),
            "limit": f"{p.network.limit:g}",
            "action_meaning": meaning,
            "feature_table": _features(p),
        },
    )


def _features(p: Parts) -> str:
    rows = zip(p.card.observation, p.network.scale, strict=True)
    return "".join(
        f" *   {i:5d}  {c_text.comment(name):39s}  {scale:.6g}\n"
        for i, (name, scale) in enumerate(rows)
    )


def source_text(p: Parts) -> str:
    """The source."""
    return fill(
        "policy.c.in",
        {
            **common(p),
            **_signature(p),
            "constants": _constants(p),
            "arrays": arrays(p.network),
            "activations": activations(p.network),
            "layers": layers(p.network),
            "encode": _encode(p.table),
            "command": _command(p.card),
        },
    )


def _constants(p: Parts) -> str:
    table = p.table
    widest = max(len(p.network.scale), *(len(layer.bias) for layer in p.network.layers))
    values = {
        "FEATURE_LIMIT": decimal(p.network.limit, "feature limit"),
        "WIDEST": widest,
        "HISTORY": table.history,
        "HISTORY_SIZE": max(table.history, 1),
        "INTEGRAL_LIMIT": f"{decimal(table.integral_limit, 'integral_limit')} /* [m s] */",
        "TRIM": f"{decimal(p.trim, 'trim')} /* rate of the integral loop [1/s] */",
        "TRIM_SPEED": f"{decimal(p.policy.trim_speed, 'trim_speed')} /* [m/s] */",
        "TRIM_LIMIT": f"{decimal(p.policy.trim_limit, 'trim_limit')} /* [m] */",
        "FINE_ERROR": f"{decimal(table.fine_error, 'fine_error')} /* [m] */",
        "FINE_HEADING": f"{decimal(table.fine_heading, 'fine_heading')} /* [rad] */",
    }
    return "".join(f"#define {name} {value}\n" for name, value in values.items())


def _command(card: PolicyCard) -> str:
    if card.base is not None:
        return f"base + {decimal(card.authority, 'authority')} * action[0]"
    if card.rate_limit is None:
        return "action[0]"
    step = decimal(card.rate_limit * card.dt, "rate_limit")
    return f"next.last_command + {step} * action[0]"


def _encode(table: EncodingTable) -> str:
    """The body of ``encode``: the same features in the same order as kernels/encode.py."""
    remembers = table.integral or table.command or table.history
    lines = [] if remembers else ["(void)state; /* nothing of it is a feature */"]
    if table.waypoints:
        lines += _loop(f"j = 0; j < {table.waypoints}; ++j", [
            "*out++ = told->preview[j][0];",
            "*out++ = told->preview[j][1];",
        ])  # fmt: skip
    if table.roads:
        lines.append("*out++ = told->curvature;")
    if table.roads > 1:
        lines += _loop(f"j = 1; j < {table.roads}; ++j", [
            f"const float u = (float)(2 * j) * {decimal(table.spacing, 'spacing')};",
            "const float ahead = told->preview[2 * j][0] - told->preview[0][0];",
            "const float left = told->preview[2 * j][1] - told->preview[0][1];",
            "",
            "*out++ = 2.0f * (left + told->heading_error * ahead) / (u * u);",
        ])  # fmt: skip
    lines += [f"*out++ = told->{name};" for name in ("v_x", "v_y", "yaw_rate")]
    lines += ["*out++ = told->steer;"] * table.steer
    lines += _ERRORS * table.errors
    lines += ["*out++ = state->integral;"] * table.integral
    lines += ["*out++ = state->last_command;"] * table.command
    for name in ("errors", "commands"):
        if table.history:
            lines += _loop("j = 0; j < HISTORY; ++j", [f"*out++ = state->{name}[j];"])
    lines += ["*out = 0.0f; /* the other controller's command: step() */"] * table.base
    start = ["int j;", ""] if any("++j" in line for line in lines) else []
    return "".join(f"    {line}\n" if line else "\n" for line in start + lines)


_ERRORS = [
    "*out++ = told->lateral_error;",
    "*out++ = told->heading_error;",
    "*out++ = told->lateral_error / (FINE_ERROR + fabsf(told->lateral_error));",
    "*out++ = told->heading_error / (FINE_HEADING + fabsf(told->heading_error));",
]


def _loop(head: str, body: list[str]) -> list[str]:
    return [f"for ({head}) {{", *(f"    {line}" if line else "" for line in body), "}"]
