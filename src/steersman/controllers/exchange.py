"""What a controller and a program beside it exchange at each step: lines of JSON, or records.

One protocol for both directions: ``controller=process`` asks a program outside, ``steersman node``
is asked by one. A message is an object of JSON on a line, or a record of fixed layout (below),
little-endian, which its first byte tells apart. SI units, ISO 8855 signs.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from steersman.bounds import from_json
from steersman.types import Decision, Driver, FloatArray, Observation, Reason

MOST_WAYPOINTS, LONGEST = 1000, 100_000
"""Most waypoints of an observation, and the longest line [bytes]."""
ASKED, ANSWERED = b"\x02SQ1", b"\x02SA1"
"""What records begin with: a question, an answer."""
QUESTION = struct.Struct("<4s3I11d")
"""Mark, drive, sequence, number of waypoints; executed (NaN: none), dt (0: not said), time,
lateral_error, heading_error, v_x, v_y, yaw_rate, steer, curvature, spacing. The waypoints follow,
x and y as doubles."""
ANSWER = struct.Struct("<4s2I2Hd")
"""Mark, drive, sequence, status (REFUSED: see below), 1 if it is late, steer (NaN if refused)."""
REFUSED = 255
"""Status of an answer to a question that cannot be used."""
_POINT = 16
# Full lock, as an actuator may report it.
_LOCK = 1.1
_LARGEST = 2**32 - 1
_NUMBERS = Observation._fields[:8]


class Question(NamedTuple):
    """An observation that is to be answered with a steering command."""

    seen: Observation
    drive: int = 0
    """Number of the drive: each has a memory of its own."""
    sequence: int | None = None
    """Of the observation in its drive; 0 begins the drive anew; None: not counted."""
    dt: float | None = None
    """Control period [s]; None: not said."""
    executed: float | None = None
    """Steering executed in the step before; None: the one that was answered."""
    record: bool = False
    """Whether it came as a record, and so gets one."""


class NoQuestion(ValueError):
    """A message that is no question; what is wrong with it."""


def to_json(question: Question) -> dict[str, Any]:
    """The question as a line's object, without what is not said."""
    seen = question.seen
    numbers: dict[str, Any] = seen._asdict()
    numbers |= {name: numbers[name].tolist() for name in ("preview", "wished")}
    ahead = numbers.pop("ahead")
    numbers |= {} if ahead is None else {"ahead": ahead._asdict()}
    counted = {} if question.sequence is None else {"sequence": question.sequence}
    context = {"drive": question.drive, "dt": question.dt, "executed": question.executed}
    return context | counted | numbers


def read_question(message: bytes) -> Question:
    """The question in a line or record.

    Raises:
        NoQuestion: it is none; the text says where, what was given, and what is allowed.
    """
    if message[:1] == ASKED[:1]:
        return _from_record(message)
    try:
        data = from_json(message)
    except ValueError as error:
        raise NoQuestion(f"no line of JSON: {error}") from None
    if not isinstance(data, dict):
        raise NoQuestion(f"expected an object of JSON, given {type(data).__name__}")
    numbers = [_number(data, each) for each in _NUMBERS]
    seen = _seen(numbers, _points(data), _number(data, "spacing"))
    dt, executed = (data.get(name) for name in ("dt", "executed"))
    return Question(
        seen,
        _whole(data, "drive", 0) or 0,
        _whole(data, "sequence", None),
        None if dt is None else _number(data, "dt"),
        None if executed is None else _steering(_number(data, "executed")),
    )


def _seen(numbers: Sequence[float], points: FloatArray, spacing: float) -> Observation:
    values: dict[str, Any] = dict(zip(_NUMBERS, numbers, strict=True))
    return Observation(**values, preview=points, spacing=spacing)


def _from_record(message: bytes) -> Question:
    if len(message) < QUESTION.size or message[:4] != ASKED:
        raise NoQuestion(
            f"a record of {len(message)} bytes, expected {QUESTION.size} and waypoints"
        )
    _, drive, sequence, count, executed, dt, *numbers = QUESTION.unpack_from(message)
    if count > MOST_WAYPOINTS or len(message) != QUESTION.size + _POINT * count:
        size = f"{QUESTION.size} + {_POINT} x {count}, at most {MOST_WAYPOINTS} waypoints"
        raise NoQuestion(f"a record of {len(message)} bytes, expected {size}")
    points = np.frombuffer(message, "<f8", 2 * count, QUESTION.size).reshape(count, 2)
    seen = _seen(numbers[:-1], points.astype(np.float64), numbers[-1])
    other = None if math.isnan(executed) else _steering(executed)
    return Question(seen, drive, sequence, dt or None, other, record=True)


def record_length(head: bytes) -> int:
    """Bytes of a whole record, from its first ones.

    Raises:
        NoQuestion: it does not begin one, or announces too many waypoints.
    """
    if len(head) < QUESTION.size or head[:4] != ASKED:
        raise NoQuestion("no record of a question")
    count = QUESTION.unpack(head)[3]
    if count > MOST_WAYPOINTS:
        raise NoQuestion(f"{count} waypoints, at most {MOST_WAYPOINTS} are allowed")
    return QUESTION.size + _POINT * int(count)


def to_record(question: Question) -> bytes:
    """The question as a record."""
    seen, executed = question.seen, question.executed
    head = QUESTION.pack(
        ASKED,
        question.drive,
        question.sequence or 0,
        len(seen.preview),
        math.nan if executed is None else executed,
        question.dt or 0.0,
        *seen[:8],
        seen.spacing,
    )
    return head + seen.preview.astype("<f8").tobytes()


def answer_to(question: Question, decision: Decision, *, late: bool) -> bytes:
    """The answer in the form of its question; in JSON with what a supervisor found, if anything."""
    drive, sequence = question.drive, question.sequence
    steer, status = decision.steer, decision.status
    if question.record:
        return ANSWER.pack(ANSWERED, drive, sequence or 0, int(status), int(late), steer)
    said: dict[str, Any] = {"steer": steer, "status": status.name.lower(), "drive": drive}
    if sequence is not None:
        said["sequence"] = sequence
    if decision.reason != Reason.NONE or decision.driver != Driver.INNER:
        said |= {"driver": decision.driver.name.lower(), "reason": decision.reason.name.lower()}
    if late:
        said["late"] = True
    return json.dumps(said).encode() + b"\n"


def refusal(why: str, message: bytes) -> bytes:
    """The answer to what is no question, with its drive and sequence where they can be read."""
    if message[:1] == ASKED[:1]:
        whole = len(message) >= QUESTION.size and message[:4] == ASKED
        drive, sequence = QUESTION.unpack_from(message)[1:3] if whole else (0, 0)
        return ANSWER.pack(ANSWERED, drive, sequence, REFUSED, 0, math.nan)
    return json.dumps({"error": why} | _counted(message)).encode() + b"\n"


def _counted(message: bytes) -> dict[str, int]:
    """What of drive and sequence a line holds."""
    try:
        data = from_json(message)
    except ValueError:
        return {}
    found: dict[str, int] = {}
    for name in ("drive", "sequence") if isinstance(data, dict) else ():
        with suppress(NoQuestion):
            number = _whole(data, name, None)
            found |= {} if number is None else {name: number}
    return found


def _number(data: Mapping[str, Any], name: str) -> float:
    value = data.get(name)
    if type(value) not in {int, float}:
        given = "nothing" if value is None else repr(value)[:40]
        raise NoQuestion(f"{name}: given {given}, expected a number")
    return float(value)  # type: ignore[arg-type]


def _steering(value: float) -> float:
    """What a controller may remember."""
    if not abs(value) <= _LOCK:
        raise NoQuestion(f"executed: given {value:g}, expected steering in [-1, 1]")
    return value


def _whole(data: Mapping[str, Any], name: str, missing: int | None) -> int | None:
    value = data.get(name)
    if value is None:
        return missing
    if type(value) is not int or not 0 <= value <= _LARGEST:
        raise NoQuestion(f"{name}: given {repr(value)[:40]}, expected a whole number from 0 on")
    return value


def _points(data: Mapping[str, Any]) -> Any:
    rows = data.get("preview")
    if not isinstance(rows, list) or len(rows) > MOST_WAYPOINTS:
        raise NoQuestion(f"preview: expected a list of at most {MOST_WAYPOINTS} pairs [x, y]")
    for row in rows:
        if not isinstance(row, list) or [type(each) in {int, float} for each in row] != [True] * 2:
            raise NoQuestion(f"preview: given {repr(row)[:40]}, expected pairs of numbers [x, y]")
    return np.array(rows, dtype=np.float64).reshape(-1, 2)
