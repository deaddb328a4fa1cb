"""The test vector of a controller in C: steps, what Python answers, the program that compares."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from steersman.controllers import quadratic
from steersman.delivery import c_text
from steersman.delivery.c_text import fill
from steersman.delivery.controller import Setting, Translated
from steersman.delivery.controller_text import words
from steersman.delivery.observations import Row, observations, with_gaps, with_wishes
from steersman.delivery.translate.program import Program
from steersman.types import Decision


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
    handed = Program(single=made.setting.handed == "float")

    def number(value: float) -> str:
        return ("-" if value < 0.0 else "") + "INFINITY" if math.isinf(value) else _plain(value)

    def _plain(value: float) -> str:
        return "NAN" if math.isnan(value) else handed.literal(value)

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
