"""Python as C: what the translator makes of plain functions computes what they compute."""

from __future__ import annotations

import ctypes
import math
import subprocess
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
import pytest

from steersman.delivery.translate.program import Program
from steersman.delivery.translate.values import (
    REAL,
    Array,
    NotTranslatable,
    Pinned,
    Scalar,
    Static,
    Value,
)
from steersman.types import FloatArray

from .building import COMPILER, STRICT, needs_compiler

N = 5
TABLE = np.array([3.0, -1.0, 0.5, 2.0, 0.25])


class Pair(NamedTuple):
    first: float
    second: float | None

    @property
    def whole(self) -> float:
        return self.first + (0.0 if self.second is None else self.second)


def branches(a: float, b: float, x: FloatArray) -> float:
    pair, sign = Pair(a, None), 1
    if a > b:
        pair = pair._replace(second=b)
        sign = -1
    elif not math.isfinite(b) or abs(a) > 1e3:
        return -1.0
    low, *rest = sorted_three(a, b, x[0])
    return sign * pair.whole + low - rest[1] + (b if pair.second is None else 2.0 * b)


def sorted_three(a: float, b: float, c: float) -> tuple[float, float, float]:
    if a > b:
        a, b = b, a
    if b > c:
        b, c = c, b
    return (b, a, c) if a > b else (a, b, c)


def loops(a: float, b: float, x: FloatArray) -> float:
    best, where, last = math.inf, 0, None
    for i in range(N):
        if x[i] < 0.0:
            continue
        if x[i] > 2.0:
            break
        if x[i] < best:
            best, where = x[i], i
        last = a * x[i]
    count = 0
    while count < 4 and b * count < a:
        count += 1
    return where + count + (0.0 if last is None else last) + min(best, 9.0)


def nested(a: float, b: float, x: FloatArray) -> float:
    out = np.zeros((N, N))
    for i in range(N):
        for j in range(i, N):
            total = 0.0
            for k in range(i + 1):
                total += x[k] * TABLE[j]
            out[i, j] = total
    change(out[1], a)
    return float(out.sum() + (out @ x)[2] + x @ TABLE)


def change(row: FloatArray, by: float) -> None:
    for i in range(row.shape[0]):
        row[i] += by


def whole_arrays(a: float, b: float, x: FloatArray) -> float:
    moved = np.append(x[1:], a)
    spread = np.where(np.abs(moved) < b, moved, TABLE) * 2.0 - x
    both = np.concatenate([spread, np.maximum(moved, 0.0)])
    matrix = np.array([[a, b], [b, 1.0]]) @ np.array([x[0], x[-1]])
    square = (np.eye(N) - np.eye(N, k=-1)).T @ x
    square[1:3] = a
    square[-1] += 1.0
    rows = both.reshape(N, -1)  # (N, 2)
    change(rows[2], b)
    rest = np.diff(square, 2).sum() + np.isfinite(x).all() + rows[:, 1].sum()
    return float(both.mean() + matrix[1] + rest)


def numbers(a: float, b: float, x: FloatArray) -> float:
    i = int(min(max(a, 0.0), N - 1.001))
    turned = math.remainder(a, math.tau) + math.copysign(b, -a) + a**2 + max(abs(b), 0.1) ** 1.5
    turned += [v * b for v in (a, b, x[1])][i % 3] if i in {0, 1, 4} else 0.0
    looked_at(x)  # its answer is not read
    return turned + x[i] + round(b) // 2 * 1.0 + sum(v for v in (a, b)) + (a > b) + -i % 3


def looked_at(x: FloatArray) -> bool:
    x[0] += 1.0
    return x[0] > 2.0


FUNCTIONS = (branches, loops, nested, whole_arrays, numbers)


def translate(functions: Any, *, single: bool = False) -> str:
    program = Program(single=single)
    texts = []
    for each in functions:
        given: dict[str, Value] = {
            "a": Scalar("a", REAL), "b": Scalar("b", REAL), "x": Array("x", (N,))
        }  # fmt: skip
        name = program.function(each, given).name
        texts.append(
            f"double call_{each.__name__}(double a, double b, double *x);\n"
            f"double call_{each.__name__}(double a, double b, double *x)\n"
            f"{{\n    return {name}(NULL, a, b, x);\n}}\n"
        )
    parts = [
        "#include <math.h>\n#include <stddef.h>\ntypedef double real;\n"
        "typedef struct {\n    int none;\n} parameters;\n",
        *program.helpers.values(),
        *(text for _, text in program.constants.values()),
        *(each.text for each in program.functions.values()),
        *texts,
    ]
    return "\n".join(parts)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("translated")
    (folder / "made.c").write_text(translate(FUNCTIONS), encoding="ascii")
    words = [COMPILER, *STRICT, "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-o", "made.so"]
    subprocess.run([*words, "made.c", "-lm"], check=True, cwd=folder)
    return ctypes.CDLL(str(folder / "made.so"))


@needs_compiler
@pytest.mark.parametrize("function", FUNCTIONS)
def test_c_computes_what_python_computes(library: Any, function: Callable[..., float]) -> None:
    call = getattr(library, f"call_{function.__name__}")
    call.restype = ctypes.c_double
    rng = np.random.default_rng(0)
    found = set()
    for i in range(400):
        a, b = (rng.normal(0.0, 3.0, 2) if i % 4 else rng.integers(-3, 4, 2) / 1.0).tolist()
        x = rng.normal(0.5, 1.5, N)
        at = ctypes.c_void_p(x.ctypes.data)
        expected = function(a, b, x.copy())
        assert call(ctypes.c_double(a), ctypes.c_double(b), at) == pytest.approx(
            expected, rel=1e-14, abs=1e-13
        )
        found.add(round(expected, 6))
    assert len(found) > 100


def recursive(a: float, b: float, x: FloatArray) -> float:
    return a if a < 0.0 else recursive(a - 1.0, b, x)


def ragged(a: float, b: float, x: FloatArray) -> float:
    part = x[: int(a)]
    return float(part.sum())


def raising(a: float, b: float, x: FloatArray) -> float:
    if a > b:
        raise ValueError("a")
    return a


def inheriting(a: float, b: float, x: FloatArray) -> float:
    return float(super().whole)  # type: ignore[misc]


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (inheriting, "a call of super"),
        (recursive, "recursive calls itself"),
        (ragged, "where C needs a constant"),
        (raising, "raise ValueError"),
    ],
)
def test_what_c_cannot_be_made_of_is_named_with_its_place(
    function: Callable[..., float], message: str
) -> None:
    with pytest.raises(NotTranslatable, match=message) as found:
        translate([function])
    assert FilePath(__file__).name in found.value.where


def windowed(x: FloatArray, width: float) -> float:
    count = round(width)
    return float(x[:count].sum())


def test_a_parameter_that_a_shape_depends_on_becomes_a_constant() -> None:
    given = {"x": Array("x", (N,)), "width": Static(2.0, "gains.width")}
    with pytest.raises(Pinned) as found:
        Program(single=False).function(windowed, given)
    assert found.value.names == {"gains.width"}
    program = Program(single=False, pinned=found.value.names)
    program.function(windowed, given)
    assert not program.parameters
