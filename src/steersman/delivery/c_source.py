"""A policy as one header and one source in C99."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np

from steersman.controllers.plausible import ACROSS, MOST, REVERSE, WALK, reach
from steersman.controllers.policy import Policy, card_layout
from steersman.delivery import c_text
from steersman.delivery.c_formula import Writer
from steersman.delivery.c_network import activations, arrays, layers
from steersman.delivery.c_text import decimal, fill
from steersman.delivery.graph import CLIP, TANH, Network
from steersman.delivery.source import Source
from steersman.encoding import Layout
from steersman.errors import DataError
from steersman.features.base import UPDATES, Feature
from steersman.kernels.formula import numbers_of, own_group
from steersman.policy_file import PolicyCard

# Hidden values beyond this leave no room for what is done with them in float32.
_LARGEST = 1e30
# What a sensor gives.
_WAYPOINTS = 100


class Parts(NamedTuple):
    """What C text is made of."""

    source: Source
    network: Network
    layout: Layout
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
    if card.joint:
        raise DataError(f"{source.file}: its second action is the speed, which C does not have yet")
    if card.parameters:
        kind = (card.base or {}).get("kind")
        raise DataError(f"{source.file}: sets parameters of {kind!r}, which is not written in C")
    layout = card_layout(card)
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
    return Parts(source, network, layout, card.trim, Policy(file=str(source.file)))


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
        empty = dict.fromkeys((*none, "base_clip", "residual_note"), "")
        return {**empty, "step_indent": pad, "base": "0.0f"}
    head = (
        f"void {prefix}_base_observation(const {prefix}_state *state,\n"
        f"    const {prefix}_observation *seen, {prefix}_observation *out)"
    )
    share = p.card.base_share
    factor = "" if share == 1.0 else f"{decimal(share, 'base_share')} * "
    return {
        "step_indent": pad,
        "base": "base",
        "base_parameter": "float base, ",
        "base_check": " || !isfinite(base)",
        "base_comment": "\n * base: the command of the controller that is corrected.",
        "base_clip": f"    base = {factor}clip(base, 1.0f);\n",
        "base_declaration": (
            "\n/* The corrected controller's observation in this period; before step(). */\n"
            f"{head};\n"
        ),
        "base_function": f"{head}\n{{\n    shifted(seen, next_shift(state, seen), out);\n}}\n\n",
        "residual_note": _residual_note(p),
    }


def _residual_note(p: Parts) -> str:
    kind = c_text.comment(str((p.card.base or {}).get("kind")))
    return f""" *
 * CORRECTS ANOTHER CONTROLLER ({kind}; its settings are base in the card), which is
 * the caller's part: in each period get its observation from ..._base_observation(), and give its
 * command, normalised steering in [-1, 1], to step(). If it remembers its commands, give it the
 * command that step() returned, which is the executed one. The correction is at most
 * {p.card.authority:g} of full lock. Failures of the other controller are for the caller to detect.
"""


def header(p: Parts) -> str:
    """The header."""
    card = p.card
    widest = max(len(p.network.scale), *(len(layer.bias) for layer in p.network.layers))
    weights = sum(layer.weights.size + layer.bias.size for layer in p.network.layers)
    observation, remembered = 7 + 2 * card.waypoints, 4 + p.layout.cells
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
            "memory_size": max(p.layout.cells, 1),
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
            **_formulas(p),
            "command": _command(p.card),
        },
    )


def _constants(p: Parts) -> str:
    widest = max(len(p.network.scale), *(len(layer.bias) for layer in p.network.layers))
    values = {
        "FEATURE_LIMIT": decimal(p.network.limit, "feature limit"),
        "WIDEST": widest,
        "MEMORY": max(p.layout.cells, 1),
        "TRIM": f"{decimal(p.trim, 'trim')} /* rate of the integral loop [1/s] */",
        "TRIM_SPEED": f"{decimal(p.policy.trim_speed, 'trim_speed')} /* [m/s] */",
        "TRIM_LIMIT": f"{decimal(p.policy.trim_limit, 'trim_limit')} /* [m] */",
        "ACROSS": f"{decimal(ACROSS, 'heading')} /* [rad] */",
        "WALK": f"{decimal(WALK, 'pace')} /* [m/s] */",
        "REVERSE": f"{decimal(REVERSE, 'speed')} /* [m/s] */",
        "REACH": f"{decimal(reach(p.card.waypoints, p.card.spacing), 'reach')} /* [m] */",
        **{f"MOST_{name.upper()}": decimal(x, name) for name, x in MOST.items()},
    }
    return "".join(f"#define {name} {value}\n" for name, value in values.items())


def _command(card: PolicyCard) -> str:
    if card.base is not None:
        return f"base + {decimal(card.authority, 'authority')} * action[0]"
    if card.rate_limit is None:
        return "action[0]"
    step = decimal(card.rate_limit * card.dt, "rate_limit")
    return f"next.last_command + {step} * action[0]"


_SEEN = tuple(MOST)


def _writer(p: Parts, feature: Feature, first: int) -> Writer:
    """What names mean in a feature's C functions; its cells begin at ``first``."""
    prefix = common(p)["PREFIX"]
    numbers = {
        **{f"seen.{name}": f"trimmed->{name}" for name in _SEEN},
        **{
            f"self.{name}": decimal(x, f"{feature.kind}.{name}")
            for name, x in numbers_of(feature).items()
        },
        "loop.last_command": "state->last_command",
        "loop.base_command": "base",
        "loop.dt": f"{prefix}_PERIOD",
        "loop.spacing": f"{prefix}_SPACING",
    }
    cells = f"(state->memory + {first})" if first else "state->memory"
    whole = {f"self.{name}": getattr(feature, name) for name in own_group(feature).whole}
    return Writer(feature.kind, numbers, whole, {"seen.preview": "trimmed->preview"}, cells)


def _formulas(p: Parts) -> dict[str, str]:
    """The functions of all features, and the lines that call them."""
    state = f"const {common(p)['prefix']}_state *state"
    head = f"({state}, const {common(p)['prefix']}_observation *trimmed, float base, int i)"
    given = "(state, trimmed, base, i)"
    functions, first = [], 0
    calls: dict[str, list[str]] = {name: [] for name in ("value", *UPDATES)}
    for k, feature in enumerate(p.layout.features):
        writer = _writer(p, feature, first)
        for name, formula in feature.formulas.items():
            function = f"f{k}_{feature.kind}" + ("" if name == "value" else f"_{name}")
            unused = [f"(void){each};" for each in ("state", "trimmed", "base", "i")]
            lines = "".join(f"    {line}\n" for line in [*unused, *writer.body(formula)])
            functions.append(f"static float {function}{head}\n{{\n{lines}}}\n\n")
            if name == "value":
                loop, cell = f"for (i = 0; i < {feature.size}; ++i) {{", "*out++"
            else:
                loop, cell = f"for (i = {feature.cells} - 1; i >= 0; --i) {{", f"{writer.memory}[i]"
            calls[name] += [loop, f"    {cell} = {function}{given};", "}"]
        first += feature.cells
    return {"functions": "".join(functions), **{k: _indented(v) for k, v in calls.items()}}


def _indented(lines: list[str]) -> str:
    start = ["int i;", ""] if lines else []
    return "".join(f"    {line}\n" if line else "\n" for line in [*start, *lines])
