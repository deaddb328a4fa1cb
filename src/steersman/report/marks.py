"""Moments of a drive that are worth a look: where it was worst, clipped, helped, or ended early."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steersman.config import build
from steersman.disturbances import FrictionPatch
from steersman.episode import Episode
from steersman.errors import SteersmanError
from steersman.report.pack import stretches
from steersman.report.seen import recorded
from steersman.report.tables import text
from steersman.types import Driver, Status

WORST, END = "worst", "end"
SATURATED, FALLBACK, INTERVENTION = "saturated", "fallback", "intervention"
FAULT, FRICTION = "fault", "friction"
WORDS = {
    WORST: "largest |d|",
    END: "ended early",
    FAULT: "fault",
    FRICTION: "other friction",
    INTERVENTION: "intervention",
    FALLBACK: "fallback",
    SATURATED: "command clipped",
}
"""Every kind of mark, and how the page calls it."""
# So many of the largest deviations, so far apart [s].
_WORST, _APART = 3, 5.0
# Deviations below this share of the largest are not worth a look.
_SMALL = 0.1
# ... nor are those below this [m].
_NOTHING = 1e-5
# Spans of the same kind with a shorter break between them are one [s].
_BREAK = 0.5
MOST = 40
"""Marks of one kind and drive that a page shows; of more, the longest."""


def marks(episode: Episode) -> list[dict[str, Any]]:
    """The marks of a drive, plain data: kind by kind, the largest deviation first.

    Each has ``kind`` (of ``WORDS``), ``row`` and ``until`` (its first and last row), ``text``; and,
    at the first of a kind of which not all are shown, ``of``: how many there are.
    """
    if not len(episode):
        return []
    return [
        *_worst(episode),
        *_spans(episode, episode["status"] == Status.SATURATED, SATURATED),
        # Under a supervisor every other driver counts as a fallback; that is an intervention.
        *_spans(
            episode,
            (episode["status"] == Status.FALLBACK) & (episode["driver"] == Driver.INNER),
            FALLBACK,
        ),
        *_faults(episode),
        *_friction(episode),
        *_interventions(episode),
        *_end(episode),
    ]


def _worst(episode: Episode) -> list[dict[str, Any]]:
    """The largest deviations, each the largest within ``_APART`` of it."""
    error = np.nan_to_num(np.abs(episode["lateral_error"]))
    time = episode["time"]
    out: list[dict[str, Any]] = []
    free = np.ones(len(error), dtype=bool)
    while len(out) < _WORST and free.any():
        row = int(np.argmax(np.where(free, error, -1.0)))
        if error[row] < max(_SMALL * error.max(), _NOTHING):
            break
        free &= np.abs(time - time[row]) > _APART
        if not _is_peak(error, row):
            continue
        d = 1e3 * float(episode["lateral_error"][row])
        side = "left" if d > 0.0 else "right"
        words = f"{_ordinal(len(out))}{WORDS[WORST]}: {text(abs(d), 3)} mm {side}"
        out.append({"kind": WORST, "row": row, "until": row, "text": words})
    return out


def _is_peak(error: Any, row: int) -> bool:
    """Whether it is larger than nothing, and not just the shoulder of a larger one."""
    around = error[max(row - 1, 0) : row + 2]
    return bool(error[row] > 0.0 and error[row] >= around.max())


def _ordinal(k: int) -> str:
    return ("", "2nd ", "3rd ")[k]


def _spans(episode: Episode, marked: NDArray[np.bool_], kind: str) -> list[dict[str, Any]]:
    most = max(round(_BREAK / episode.dt), 1)
    joined: list[list[int]] = []
    for first, behind in stretches(marked):
        if joined and first - joined[-1][1] < most:
            joined[-1][1] = behind
        else:
            joined.append([first, behind])
    out = [
        {"kind": kind, "row": first, "until": behind - 1,
         "text": f"{WORDS[kind]}, {(behind - first) * episode.dt:.3g} s"}
        for first, behind in joined
    ]  # fmt: skip
    return _longest(out)


def _longest(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    if len(found) <= MOST:
        return found
    kept = sorted(found, key=lambda mark: mark["row"] - mark["until"])[:MOST]
    first = min(kept, key=lambda mark: int(mark["row"]))
    first["of"] = len(found)
    return kept


def _interventions(episode: Episode) -> list[dict[str, Any]]:
    """Where a supervisor's fallback steered."""
    out = []
    for one in episode.interventions():
        rows = np.searchsorted(episode["time"], [one.begin, one.end])
        row, behind = (min(int(k), len(episode) - 1) for k in rows)
        reason, who = one.reason.replace("_", " "), one.controller.replace("_", " ")
        words = f"{WORDS[INTERVENTION]}: {reason}, {who} steers"
        out.append({"kind": INTERVENTION, "row": row, "until": max(row, behind - 1), "text": words})
    return _longest(out)


def _faults(episode: Episode) -> list[dict[str, Any]]:
    """What a benchmark broke on purpose, each time that it did."""
    fault = _fault(recorded(episode))
    begin, length, every = (_number(fault.get(name)) for name in ("begin", "length", "every"))
    if begin is None:
        return []
    time = episode["time"]
    end = float(time[-1]) + episode.dt
    starts = np.arange(begin, end - 1e-9, every) if every else np.array([begin])
    out: list[dict[str, Any]] = []
    for start in starts[starts < end]:
        row, behind = np.searchsorted(time, [start - 1e-9, start + (length or end) - 1e-9])
        out.append(
            {"kind": FAULT, "row": int(row), "until": max(int(row), int(behind) - 1),
             "text": f"{WORDS[FAULT]}: {str(fault.get('kind')).replace('_', ' ')}"}
        )  # fmt: skip
    return _longest([mark for mark in out if mark["row"] < len(episode)])


def _friction(episode: Episode) -> list[dict[str, Any]]:
    """Where the road has another friction, and its factor under the left and right wheels."""
    patches = []
    for one in recorded(episode).get("disturbances", ()):
        if isinstance(one, Mapping) and one.get("kind") == FrictionPatch.kind:
            with contextlib.suppress(SteersmanError):
                patches.append(build(FrictionPatch, {k: v for k, v in one.items() if k != "kind"}))
    out: list[dict[str, Any]] = []
    for patch in patches:
        under = np.array([patch.covers(s) for s in episode["s"].tolist()], dtype=bool)
        found = _spans(episode, under, FRICTION)
        words = f"{WORDS[FRICTION]}: x {patch.left:.3g} left, x {patch.right:.3g} right"
        out += [{**mark, "text": words} for mark in found]
    return _longest(out)


def _fault(config: Any) -> Mapping[str, Any]:
    """The first fault in a dumped configuration, however deep; empty without one.

    Episodes of earlier versions have it in their controller.
    """
    if not isinstance(config, Mapping):
        return {}
    fault = config.get("fault")
    if isinstance(fault, Mapping):
        return fault
    return next((found for v in config.values() if (found := _fault(v))), {})


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, (int, float)) and value >= 0 else None


def _end(episode: Episode) -> list[dict[str, Any]]:
    if episode.completed:
        return []
    last = len(episode) - 1
    words = f"{WORDS[END]}: {episode.end.replace('_', ' ')}"
    return [{"kind": END, "row": last, "until": last, "text": words}]
