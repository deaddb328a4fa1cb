"""What every feature of the observation has to fulfil; for the authors of plug-ins, too."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steersman.contracts import Contract
from steersman.encoding import Layout
from steersman.errors import SteersmanError
from steersman.features.base import Feature
from steersman.features.past import BaseCorrection
from steersman.kernels import encode as kernel
from steersman.kernels import observe
from steersman.types import FloatArray

_SPACING, _STEPS = 2.0, 12
_EVEN = (observe.O_VX,)
# Scaled features of a car on a road; far more or far less is no unit size.
_LARGEST, _SMALLEST = 10.0, 1e-3


def it_is_declared(feature: Feature) -> Iterator[str]:
    """Names with units, scales and signs."""
    yield from declared(_layout(feature))


def it_is_what_it_declares(feature: Feature) -> Iterator[str]:
    """Finite, mirrored as declared, the same when repeated, compiled as in Python."""
    layout = _layout(feature)
    try:
        _ = layout.table
    except SteersmanError as error:
        yield str(error)
        return
    yield from driven(layout)


check: Contract[Feature] = Contract(it_is_declared, it_is_what_it_declares)


def _layout(feature: Feature) -> Layout:
    return Layout((feature,), _SPACING, 0.05)


def declared(layout: Layout) -> Iterator[str]:
    """What is wrong with names, scales and signs."""
    names = layout.names
    if not len(names) == len(layout.scale) == len(layout.mirror):
        yield "names, scales and signs differ in their number"
    if not all(name.endswith("]") and " [" in name for name in names):
        yield f"a name has no unit in brackets: {names}"
    if len(set(names)) != len(names):
        yield f"a name is there twice: {names}"
    if not (layout.scale > 0.0).all():
        yield "a scale is not positive"
    if not np.isin(layout.mirror, (-1.0, 1.0)).all():
        yield "a sign under mirroring is neither 1 nor -1"


def driven(layout: Layout) -> Iterator[str]:
    """What is wrong with the numbers of a drive."""
    rows, commands = scenes(max(layout.reads, 1), _SPACING)
    found = drive(layout, rows, commands)
    if not np.isfinite(found).all():
        yield "is not finite over finite observations"
    if not np.array_equal(found, drive(layout, rows, commands)):
        yield "differs when the same drive is repeated: it keeps something outside its memory"
    plain = drive(layout, rows, commands, compiled=False)
    if not np.allclose(found, plain, rtol=1e-9, atol=1e-12):
        yield "compiled and as Python it differs"
    mirrored = drive(layout, mirrored_rows(rows), -commands)
    if not np.allclose(mirrored, found * layout.mirror, rtol=1e-9, atol=1e-12):
        yield "does not turn as its sign says where the scene is mirrored"
    size = float(np.abs(found * layout.scale).max())
    if not _SMALLEST < size < _LARGEST:
        yield f"is of size {size:.3g} after scaling; expected about 1"


def scenes(waypoints: int, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Observation rows (n, 7 + 2 waypoints) and commands (n,) of a car that sways along a bend."""
    k = np.arange(_STEPS)
    d, heading, kappa = 0.4 * np.sin(k + 0.5), 0.1 * np.cos(k), 0.01 + 0.01 * np.sin(0.3 * k)
    columns = [d, heading, 12.0 + np.sin(k), 0.3 * np.cos(k), 12.0 * kappa, 0.2 * np.sin(k + 1.0)]
    ahead = spacing * np.arange(waypoints)
    left = 0.5 * kappa[:, None] * ahead**2 - heading[:, None] * ahead - d[:, None]
    preview = np.stack([np.broadcast_to(ahead, left.shape), left], axis=2)
    rows = np.column_stack([*columns, kappa, preview.reshape(_STEPS, -1)])
    return rows, 0.2 * np.sin(k + 1.3)


def mirrored_rows(rows: FloatArray) -> FloatArray:
    """The same scenes with left and right exchanged."""
    out = -rows
    out[:, _EVEN] *= -1.0
    out[:, observe.O_PREVIEW :: 2] *= -1.0
    return out


def drive(
    layout: Layout, rows: FloatArray, commands: FloatArray, *, compiled: bool = True
) -> FloatArray:
    """The features (n, features) of a drive in SI units; a base steers half as much again."""
    names = ("encode", "tell_base", "remember")
    functions = [getattr(kernel, name) for name in names]
    encode, tell_base, remember = functions if compiled else [f.py_func for f in functions]
    table = layout.table
    memory, out = np.zeros(kernel.memory_size(table)), np.empty((len(rows), len(layout.names)))
    for k, (row, command, line) in enumerate(zip(rows, commands, out, strict=True)):
        kernel.see_wishes(10.0 + np.arange(5.0) + 0.1 * k, _SPACING, memory)
        kernel.see_lead(20.0 - k, -1.0 - 0.1 * k, 18.0 + 0.1 * k, memory)
        encode(table, row, memory, line)
        if isinstance(layout.features[-1], BaseCorrection):
            tell_base(table, row, memory, 1.5 * command, line)
        remember(table, row, memory, command)
    return out


__all__ = ["check", "drive", "mirrored_rows", "scenes"]
