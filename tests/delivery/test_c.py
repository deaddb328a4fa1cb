"""Policies in C: they compile strictly, and answer and drive as the same policy in Python."""

from __future__ import annotations

import ctypes
import math
import re
from functools import cache
from pathlib import Path as FilePath
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest

from steersman.controllers.policy import Policy
from steersman.delivery.graph import TOLERANCE, exact, normalised, random_features, rounding
from steersman.delivery.observations import drawn, with_value
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
    bench,
    build,
    export,
    needs_compiler,
    policy,
    run,
)

pytestmark = needs_compiler


@cache
def library(name: str, *, single: bool) -> InC:
    """A policy of the package, or of one of the architectures, compiled."""
    folder = FilePath(mkdtemp(prefix="steersman"))
    words = name if name in shipped() else policy(folder / "source", name)
    return build(words, folder, single=single)


# ------------------------------------------------------------------------------------ compiling


@pytest.mark.parametrize("name", ["history and trim", "residual"])
def test_the_vector_passes_with_sanitisers(name: str, tmp_path: FilePath) -> None:
    setting = export(policy(tmp_path / "source", name), tmp_path, single=True)
    short = setting.prefix.removeprefix("steersman_")
    files = [tmp_path / f"{setting.prefix}.c", tmp_path / f"test_{short}.c"]
    run(COMPILER, *STRICT, *SANITISERS, "-o", tmp_path / "test", *files, "-lm")
    said = run(tmp_path / "test")
    assert "0 other statuses: as expected" in said
    assert re.match(rf"{setting.name}: [1-9]\d\d steps", said)


@pytest.mark.parametrize(
    "flags",
    [
        ("-O2", "-D__FP_FAST_FMAF=1"),  # the library's fused operation, on any machine
        ("-O0",),
        ("-O3", "-march=native", "-ffp-contract=fast", "-std=gnu99"),
        ("-Os", "-ffreestanding"),
    ],
    ids=str,
)
def test_it_is_as_exact_however_it_is_compiled(flags: tuple[str, ...], tmp_path: FilePath) -> None:
    compiled = build(policy(tmp_path / "source", "little"), tmp_path, *flags, single=True)
    seen = random_features(compiled.layers.scale, 2000)
    assert abs(compiled.network(seen) - exact(compiled.layers, seen)[:, 0]).max() < TOLERANCE


def test_fast_math_is_refused() -> None:
    folder = library("precision", single=True).folder
    with pytest.raises(AssertionError, match="compile without -ffast-math"):
        run(COMPILER, "-ffast-math", "-c", folder / "steersman_precision.c", "-o", "/dev/null")


def test_make_builds_a_library_of_several_policies(tmp_path: FilePath) -> None:
    prefixes = [
        export(policy(tmp_path / folder, "little"), tmp_path, single=True).prefix
        for folder in ("first", "x */ #error 1")
    ]
    said = run("make", "-C", tmp_path, "test", f"CC={COMPILER}", "CFLAGS=-O1 -ffp-contract=off")
    assert said.count(": as expected") == 2
    both = tmp_path / "both.c"
    includes = "".join(f'#include "{prefix}.h"\n' for prefix in prefixes)
    states = "".join(f"{p}_state {p}; {p}_init(&{p}, 0);\n" for p in prefixes)
    both.write_text(f"{includes}int main(void) {{ {states} return 0; }}\n")
    library = tmp_path / "libsteersman.a"
    run(COMPILER, *STRICT, "-o", tmp_path / "both", both, library, "-lm")
    run(tmp_path / "both")


def test_it_needs_nothing_but_mathematics_and_keeps_nothing(tmp_path: FilePath) -> None:
    folder = library("precision", single=True).folder
    source, made = folder / "steersman_precision.c", tmp_path / "policy.o"
    run(COMPILER, "-std=c99", "-O1", "-c", source, "-o", made)
    symbols = [line.split()[-2:] for line in run("nm", made).splitlines()]
    # Copies of structures and loops may become calls of these, which every C compiler needs.
    copies = {"memcpy", "memmove", "memset"}
    used = {name for kind, name in symbols if kind == "U"}
    assert used - copies <= {"tanhf", "fmaf", "remainder", "atan2f", "sinf", "cosf", "hypotf"}
    assert {kind.lower() for kind, _ in symbols} <= {"u", "t", "r", "n"}  # no writable data
    public = {name for kind, name in symbols if kind == "T"}
    functions = ("set", "init", "reset", "step", "executed", "network")
    assert public == {f"steersman_precision_{n}" for n in functions}
    assert [line for line in source.read_text().splitlines() if line.startswith("#include")] == [
        '#include "steersman_precision.h"', "#include <math.h>", "#include <stddef.h>",
    ]  # fmt: skip


# -------------------------------------------------------------------------------------- network


def test_20_000_features_agree_with_onnx() -> None:
    compiled = library("precision", single=True)
    layers = compiled.layers
    seen = random_features(layers.scale, 20_000)
    given, expected = compiled.network(seen), exact(layers, seen)[:, 0]
    assert abs(given - expected).max() < TOLERANCE
    assert (abs(normalised(layers, seen)) == FEATURE_LIMIT).any(axis=1).mean() > 0.1
    assert np.std(expected) > 0.3
    # ONNX Runtime is itself further away where hidden values are large.
    some = seen[:5000]
    data, _ = compiled.setting.controller.read()  # type: ignore[attr-defined]
    session = PolicyNetwork(data, "precision", some.shape[1])
    onnx = np.array([session(row[None, :])[0] for row in some])
    assert (abs(given[: len(some)] - onnx) <= TOLERANCE + rounding(layers, some)).all()


def test_features_of_a_drive_agree_with_onnx_runtime(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled, seen = library("precision", single=True), []

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


@pytest.mark.parametrize("single", [True, False])
def test_network_with_nan_and_infinity(single: bool) -> None:
    compiled = library("precision", single=single)
    count = len(compiled.layers.scale)
    seen, each = random_features(compiled.layers.scale, count), np.arange(count)
    huge = seen.copy()
    seen[each, each] = np.inf
    huge[each, each] = 1e30
    assert np.array_equal(compiled.network(seen), compiled.network(huge))
    seen[each, each] = np.nan
    assert np.isnan(compiled.network(seen)).all()


# ------------------------------------------------------------------------------------------ steps


@pytest.mark.parametrize(
    ("name", "single"),
    [*((name, True) for name in [*ARCHITECTURES, "precision"]), ("precision", False)],
)
def test_whole_steps_agree(name: str, single: bool) -> None:
    """Those of the test vector, and random ones of every size."""
    compiled = library(name, single=single)
    setting = compiled.setting
    known = bench.known(setting, bench.drawn_rows(setting, 600))
    found = bench.parity(setting, compiled.code, known)
    assert found.other_statuses == 0
    assert found.steering <= (TOLERANCE if single else 1e-12)
    assert 400 < found.usable < 590
    assert known.answers[:, 0].std() > 0.01


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["history and trim", "residual"])
def test_a_step_that_is_not_finite_holds_and_forgets_nothing(name: str, value: float) -> None:
    compiled, rng = library(name, single=True), np.random.default_rng(2)
    code, setting = compiled.code, compiled.setting
    state = code.init(setting.vehicle, setting.dt)
    for _ in range(5):
        _, state = code.step(state, drawn(setting, rng))
    for index in range(7 + 2 * setting.waypoints):
        seen = with_value(drawn(setting, rng), index, value)
        decision, after = code.step(state, seen)
        assert decision.status is Status.FALLBACK
        held = min(max(seen.steer, -1.0), 1.0) if math.isfinite(seen.steer) else 0.0
        assert decision.steer == pytest.approx(held, abs=1e-7)
        assert after == state
    assert code.executed(state, value) == state
    assert code.executed(state, 0.5) != state


def test_numbers_that_overflow_on_their_way_hold_too() -> None:
    compiled, rng = library("history and trim", single=True), np.random.default_rng(2)
    code, setting = compiled.code, compiled.setting
    seen = drawn(setting, rng)._replace(heading_error=1e30)
    seen.preview[:, 0] = 3e38 * (-1.0) ** np.arange(len(seen.preview))
    seen.preview[:, 1] = -3e38 * (-1.0) ** np.arange(len(seen.preview))
    decision, _ = code.step(code.init(setting.vehicle, setting.dt), seen)
    assert abs(decision.steer) <= 1.0


def test_states_that_memory_lost_are_answered_with_finite_steering() -> None:
    compiled, rng = library("history and trim", single=True), np.random.default_rng(2)
    code, setting = compiled.code, compiled.setting
    start = code.init(setting.vehicle, setting.dt)
    kept = ctypes.sizeof(ctypes.c_void_p)  # where the parameters are
    for _ in range(300):
        state = start[:kept] + rng.bytes(len(start) - kept)
        assert abs(code.step(state, drawn(setting, rng))[0].steer) <= 1.0


# ------------------------------------------------------------------------------------ closed loop


@pytest.mark.parametrize("name", ["history and trim", "residual", "precision"])
def test_it_drives_as_the_policys_controller(name: str) -> None:
    compiled = library(name, single=True)
    file = getattr(compiled.setting.controller, "file", "")
    python, c = (
        drive(each, Posed(), duration=6.0, corridor=50.0)
        for each in (Policy(file=file), compiled.code)
    )
    assert len(python) == len(c) > 25  # random ones leave the road
    assert c["steer_command"] == pytest.approx(python["steer_command"], abs=2e-5)
    assert c["lateral_error"] == pytest.approx(python["lateral_error"], abs=1e-4)
    assert np.array_equal(c["status"], python["status"])
    assert np.ptp(python["steer_command"]) > 0.01
