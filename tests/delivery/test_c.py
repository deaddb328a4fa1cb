"""Policies in C: they compile strictly, and answer and drive as the same policy in Python."""

from __future__ import annotations

import ctypes
import math
from functools import cache
from pathlib import Path as FilePath
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest

from steersman.controllers.policy import Policy
from steersman.delivery.graph import TOLERANCE, exact, normalised, random_features, rounding
from steersman.delivery.observations import Row, drawn, single, with_value
from steersman.delivery.vector import answers, rows
from steersman.kernels.encode import FEATURE_LIMIT
from steersman.network_file import PolicyNetwork
from steersman.policy_file import shipped
from steersman.types import Status

from ..loops import Posed, drive
from .building import (
    ARCHITECTURES,
    COMPILER,
    SANITISERS,
    STRICT,
    InC,
    Library,
    build,
    export,
    needs_compiler,
    policy,
    read,
    run,
)

pytestmark = needs_compiler


@cache
def library(name: str) -> Library:
    """A policy of the package, or of one of the architectures, compiled."""
    folder = FilePath(mkdtemp(prefix="steersman"))
    words = name if name in shipped() else policy(folder / "source", name)
    return build(export(words, folder), folder)


EVERY = (*ARCHITECTURES, "precision")


# ------------------------------------------------------------------------------------ compiling


@pytest.mark.parametrize("name", EVERY)
def test_the_vector_passes_with_sanitisers(name: str, tmp_path: FilePath) -> None:
    words = name if name in shipped() else policy(tmp_path / "source", name)
    p = export(words, tmp_path)
    files = [tmp_path / f"steersman_{p.name}.c", tmp_path / f"test_{p.name}.c"]
    run(COMPILER, *STRICT, *SANITISERS, "-o", tmp_path / "test", *files, "-lm")
    said = run(tmp_path / "test")
    assert "0 other statuses: passed" in said
    assert said.startswith(f"{p.name}: 100 features")


@pytest.mark.parametrize(
    "flags",
    [
        ("-O0",),
        ("-O2", "-D__FP_FAST_FMAF=1"),  # the library's fused operation, on any machine
        ("-O3", "-march=native", "-ffp-contract=fast", "-std=gnu99"),
        ("-Os", "-ffreestanding"),
    ],
    ids=str,
)
def test_it_is_as_exact_however_it_is_compiled(flags: tuple[str, ...], tmp_path: FilePath) -> None:
    p = export("precision", tmp_path)
    compiled = build(p, tmp_path, flags)
    seen = random_features(p.network.scale, 2000)
    assert abs(compiled.network(seen) - exact(p.network, seen)[:, 0]).max() < TOLERANCE


def test_fast_math_is_refused(tmp_path: FilePath) -> None:
    export("precision", tmp_path)
    with pytest.raises(AssertionError, match="compile without -ffast-math"):
        run(COMPILER, "-ffast-math", "-c", tmp_path / "steersman_precision.c", "-o", "/dev/null")


def test_make_builds_a_library_of_several_policies(tmp_path: FilePath) -> None:
    export("precision", tmp_path)
    p = export(policy(tmp_path / "x */ #error 1", "residual"), tmp_path)
    said = run("make", "-C", tmp_path, "test", f"CC={COMPILER}")
    assert said.count(": passed") == 2
    both = tmp_path / "both.c"
    names = ("precision", p.name)
    includes = "".join(f'#include "steersman_{name}.h"\n' for name in names)
    states = "".join(f"steersman_{n}_state {n}; steersman_{n}_init(&{n});\n" for n in names)
    both.write_text(f"{includes}int main(void) {{ {states} return 0; }}\n")
    library = tmp_path / "libsteersman.a"
    run(COMPILER, *STRICT, "-o", tmp_path / "both", both, library, "-lm")
    run(tmp_path / "both")


def test_it_needs_nothing_but_mathematics_and_keeps_nothing(tmp_path: FilePath) -> None:
    export("precision", tmp_path)
    source, made = tmp_path / "steersman_precision.c", tmp_path / "policy.o"
    run(COMPILER, "-std=c99", "-O2", "-c", source, "-o", made)
    symbols = [line.split()[-2:] for line in run("nm", made).splitlines()]
    # Copies of structures and loops may become calls of these, which every C compiler needs.
    copies = {"memcpy", "memmove", "memset"}
    assert {name for kind, name in symbols if kind == "U"} <= {
        "tanhf",
        "fmaf",
        "remainder",
    } | copies
    assert {kind.lower() for kind, _ in symbols} <= {"u", "t", "r", "n"}  # no writable data
    public = {name for kind, name in symbols if kind == "T"}
    assert public == {f"steersman_precision_{n}" for n in ("init", "step", "executed", "network")}
    assert [line for line in source.read_text().splitlines() if line.startswith("#include")] == [
        '#include "steersman_precision.h"', "#include <math.h>",
    ]  # fmt: skip


# -------------------------------------------------------------------------------------- network


def test_100_000_observations_agree_with_onnx() -> None:
    compiled = library("precision")
    p = compiled.p
    seen = random_features(p.network.scale, 100_000)
    given, expected = compiled.network(seen), exact(p.network, seen)[:, 0]
    assert abs(given - expected).max() < TOLERANCE
    assert (abs(normalised(p.network, seen)) == FEATURE_LIMIT).any(axis=1).mean() > 0.1
    assert np.std(expected) > 0.3
    # ONNX Runtime is itself further away where hidden values are large.
    some = seen[:5000]
    session = PolicyNetwork(p.source.data, "precision", some.shape[1])
    onnx = np.array([session(row[None, :])[0] for row in some])
    assert (abs(given[: len(some)] - onnx) <= TOLERANCE + rounding(p.network, some)).all()


def test_observations_of_a_drive_agree_with_onnx_runtime(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled, seen = library("precision"), []

    def listening(*words: Any) -> Any:
        run = PolicyNetwork(*words)

        def heard(x: Any) -> Any:
            actions = run(x)
            seen.append((x[0].copy(), actions[0]))
            return actions

        return heard

    monkeypatch.setattr("steersman.controllers.policy.PolicyNetwork", listening)
    drive(Policy(file="precision"), Posed(), duration=15.0)
    features, actions = (np.array(each) for each in zip(*seen, strict=True))
    assert len(features) > 250
    assert abs(compiled.network(features) - actions).max() < TOLERANCE


@pytest.mark.parametrize("name", ARCHITECTURES)
def test_every_architectures_network_agrees(name: str) -> None:
    compiled = library(name)
    seen = random_features(compiled.p.network.scale, 3000)
    away = compiled.network(seen) - exact(compiled.p.network, seen)[:, 0]
    assert abs(away).max() < TOLERANCE


def test_network_with_nan_and_infinity() -> None:
    compiled = library("precision")
    seen = random_features(compiled.p.network.scale, 33)
    huge = seen.copy()
    seen[np.arange(33), np.arange(33)] = np.inf
    huge[np.arange(33), np.arange(33)] = 1e30
    assert np.array_equal(compiled.network(seen), compiled.network(huge))
    seen[np.arange(33), np.arange(33)] = np.nan
    assert np.isnan(compiled.network(seen)).all()


# ------------------------------------------------------------------------------------------ steps


@pytest.mark.parametrize("name", EVERY)
def test_whole_steps_agree(name: str) -> None:
    """Those of the test vector, and random ones of every size."""
    compiled, rng = library(name), np.random.default_rng(7)
    sizes = 10.0 ** rng.uniform(-42.0, 15.0, 1500)
    sizes[::2] = rng.uniform(0.0, 2.0, 750)
    bases = rng.uniform(-1.5, 1.5, 1500)
    given = [
        Row(i % 30 == 0, drawn(compiled.p.card, rng, size), single(base), None)
        for i, (size, base) in enumerate(zip(sizes, bases, strict=True))
    ]
    given = rows(compiled.p) + given
    state, said = compiled.init(), []
    for row in given:
        state = compiled.init() if row.restart else state
        said.append(compiled.step(state, row.seen, row.base))
        if row.executed is not None:
            compiled.executed(state, row.executed)
    expected = answers(compiled.p, given)
    assert [status for _, status in said] == [answer.status for answer in expected]
    away = [steer - answer.steer for (steer, _), answer in zip(said, expected, strict=True)]
    assert np.abs(away).max() < TOLERANCE
    steers = [answer.steer for answer in expected]
    assert np.std(steers) > 0.01
    assert {Status.SOLVED, Status.FALLBACK} <= {status for _, status in said}


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["history and trim", "residual"])
def test_a_step_that_is_not_finite_holds_and_forgets_nothing(name: str, value: float) -> None:
    compiled, rng = library(name), np.random.default_rng(2)
    state = compiled.init()
    for _ in range(5):
        compiled.step(state, drawn(compiled.p.card, rng))
    before = state.copy()
    for index in range(7 + 2 * compiled.p.card.waypoints):
        seen = with_value(drawn(compiled.p.card, rng), index, value)
        steer, status = compiled.step(state, seen)
        assert status is Status.FALLBACK
        held = min(max(seen.steer, -1.0), 1.0) if math.isfinite(seen.steer) else 0.0
        assert steer == pytest.approx(held, abs=1e-7)
        assert np.array_equal(state, before)
    if name == "residual":
        assert compiled.step(state, drawn(compiled.p.card, rng), value)[1] is Status.FALLBACK
        assert np.array_equal(state, before)
    compiled.executed(state, value)
    assert np.array_equal(state, before)


def test_numbers_that_overflow_on_their_way_hold_too() -> None:
    compiled, rng = library("history and trim"), np.random.default_rng(2)
    seen = drawn(compiled.p.card, rng)._replace(heading_error=1e30)
    seen.preview[:, 0] = 3e38 * (-1.0) ** np.arange(len(seen.preview))
    seen.preview[:, 1] = -3e38 * (-1.0) ** np.arange(len(seen.preview))
    steer, _ = compiled.step(compiled.init(), seen)
    assert abs(steer) <= 1.0


def test_states_that_memory_lost_are_answered_with_finite_steering() -> None:
    compiled, rng = library("history and trim"), np.random.default_rng(2)
    for _ in range(300):
        state = compiled.init()
        state.view(np.uint32)[:] = rng.integers(0, 2**32, state.size)
        steer, _ = compiled.step(state, drawn(compiled.p.card, rng))
        assert abs(steer) <= 1.0


# ------------------------------------------------------------------------------------ closed loop


@pytest.mark.parametrize("name", EVERY)
def test_it_drives_as_the_policys_controller(name: str) -> None:
    compiled = library(name)
    controller = Policy(file=str(compiled.p.source.file))
    python, c = (
        drive(each, Posed(), duration=6.0, corridor=50.0)
        for each in (controller, InC(library=compiled))
    )
    assert len(python) == len(c) > 25  # random ones leave the road
    assert c["steer_command"] == pytest.approx(python["steer_command"], abs=2e-5)
    assert c["lateral_error"] == pytest.approx(python["lateral_error"], abs=1e-4)
    assert np.array_equal(c["status"], python["status"])
    assert np.ptp(python["steer_command"]) > 0.01


def test_the_state_is_as_large_as_the_test_takes_it_for(tmp_path: FilePath) -> None:
    """Other tests lay C's structures out by hand."""
    p = export("precision", tmp_path)
    text = f"""#include <stdio.h>
#include "steersman_{p.name}.h"
int main(void) {{ printf("%u %u", (unsigned)sizeof(steersman_{p.name}_state),
    (unsigned)sizeof(steersman_{p.name}_observation)); return 0; }}
"""
    (tmp_path / "size.c").write_text(text)
    run(COMPILER, *STRICT, "-o", tmp_path / "size", tmp_path / "size.c")
    state, observation = map(int, run(tmp_path / "size").split())
    compiled = library("precision")
    assert state == compiled.init().nbytes
    assert observation == compiled.pack(rows(p)[0].seen).nbytes
    assert ctypes.sizeof(ctypes.c_float) == 4


def test_read_gives_what_export_gave(tmp_path: FilePath) -> None:
    export("precision", tmp_path)
    assert read(tmp_path / "precision.json").source.data == read("precision").source.data
