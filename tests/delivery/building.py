"""Exported policies, compiled and called."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from pydantic import Field

from steersman.controllers.base import ControllerComponent
from steersman.controllers.policy import PolicyState, card_base
from steersman.delivery.c_source import Parts, parts
from steersman.delivery.graph import read_network
from steersman.delivery.package import write_c
from steersman.delivery.source import read_source
from steersman.learning.config import TrainConfig
from steersman.learning.export import export_policy
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle

from ..learning.problems import problem
from ..loops import random_net

COMPILER = next((each for each in ("gcc", "cc", "clang") if shutil.which(each)), "")
needs_compiler = pytest.mark.skipif(not COMPILER, reason="there is no C compiler")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic", "-Wshadow")
SANITISERS = (
    "-g", "-O1", "-fsanitize=address,undefined,float-cast-overflow,float-divide-by-zero",
    "-fno-sanitize-recover=all",
)  # fmt: skip
# What else a policy can be: its problem, the operators of its network, and its trim.
ARCHITECTURES: dict[str, tuple[dict[str, Any], tuple[str, str], float]] = {
    "rate": ({"encoding": {"kind": "extended"}}, ("Relu", "Tanh"), 0.0),
    "history and trim": ({"encoding": {"kind": "extended", "history": 8}}, ("Relu", "Tanh"), 1.0),
    "one step of history": (
        {"action": "direct", "encoding": {"kind": "extended", "history": 1, "roads": 1}},
        ("Relu", "Tanh"), 0.3,
    ),
    "paper": ({"encoding": {"kind": "waypoints"}}, ("Relu", "Tanh"), 0.0),
    "paper, direct": (
        {"action": "direct", "encoding": {"kind": "waypoints", "waypoints": 3}},
        ("Tanh", "Clip"), 0.0,
    ),
    "little": (
        {"encoding": {"kind": "extended", "errors": False, "integral": False, "roads": 0,
                      "command": False}},
        ("Relu", "Clip"), 2.0,
    ),
    "residual": (
        {"action": "residual", "base": {"kind": "mpc_delay"}, "authority": 0.2,
         "encoding": {"kind": "extended", "history": 3, "waypoints": 4}},
        ("Relu", "Tanh"), 0.5,
    ),
}  # fmt: skip


def policy(folder: FilePath, name: str, hidden: int = 12) -> FilePath:
    """A random policy of one of the architectures."""
    fields, operators, trim = ARCHITECTURES[name]
    config = TrainConfig(problem=problem(**fields), trim=trim)
    net = random_net(len(config.problem.layout.scale), hidden)
    return export_policy(net, config, folder, {}, operators, 0.6 if "base" in fields else 1.0)


def read(words: str | FilePath) -> Parts:
    """What the C text of a policy is made of."""
    source = read_source(str(words))
    return parts(source, read_network(source.data, str(source.file)))


def export(words: str | FilePath, folder: FilePath) -> Parts:
    """Write the C package of a policy into a folder."""
    folder.mkdir(exist_ok=True)
    write_c(str(words), folder)
    return read(words)


def run(*words: str | FilePath, cwd: FilePath | None = None) -> str:
    """What a command prints; it must succeed and say nothing on stderr."""
    done = subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, check=False, cwd=cwd,
        timeout=120,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, ""), done.stderr + done.stdout
    return done.stdout


def build(p: Parts, folder: FilePath, flags: Sequence[str] = ("-O3",)) -> Library:
    """The policy in a folder as a shared library."""
    file = folder / "policy.so"
    source = folder / f"steersman_{p.name}.c"
    run(COMPILER, *STRICT, *flags, "-shared", "-fPIC", "-o", file, source, "-lm")
    return Library(file, p)


class Library:
    """The functions of a compiled policy."""

    def __init__(self, file: FilePath, p: Parts) -> None:
        self.p = p
        self.code = ctypes.CDLL(str(file))
        self.cells = max(p.layout.cells, 1)
        self.waypoints = max(p.card.waypoints, 1)
        self.call_network = self._function("network")
        self.call_network.restype = None

    def _function(self, name: str) -> Any:
        return getattr(self.code, f"steersman_{self.p.name}_{name}")

    def network(self, features: Any) -> Any:
        """Actions of rows of raw features."""
        rows = np.ascontiguousarray(features, np.float32)
        out = np.empty(len(rows), np.float32)
        call, width = self.call_network, rows.strides[0]
        start, to = rows.ctypes.data, out.ctypes.data
        for i in range(len(rows)):
            call(ctypes.c_void_p(start + i * width), ctypes.c_void_p(to + 4 * i))
        return out.astype(np.float64)

    def init(self) -> Any:
        """A state before its first step."""
        # One int and floats, all of four bytes.
        state = np.full(3 + self.cells, 77.0, np.float32)
        self._function("init")(ctypes.c_void_p(state.ctypes.data))
        return state

    def pack(self, seen: Observation) -> Any:
        """An observation as C sees it."""
        row = np.zeros(7 + 2 * self.waypoints, np.float32)
        with np.errstate(over="ignore"):
            row[:7] = seen[1:8]
            given = seen.preview[: self.p.card.waypoints].ravel()
            row[7 : 7 + len(given)] = given
        return row

    def step(self, state: Any, seen: Observation, base: float = 0.0) -> tuple[float, Status]:
        """One step; the state changes in place."""
        row, steer = self.pack(seen), ctypes.c_float(77.0)
        before = [ctypes.c_float(base)] * (self.p.card.base is not None)
        status = self._function("step")(
            ctypes.c_void_p(state.ctypes.data), ctypes.c_void_p(row.ctypes.data), *before,
            ctypes.byref(steer),
        )  # fmt: skip
        return steer.value, Status(status)

    def executed(self, state: Any, steer: float) -> None:
        """Tell what was executed."""
        self._function("executed")(ctypes.c_void_p(state.ctypes.data), ctypes.c_float(steer))

    def trimmed(self, state: Any, seen: Observation) -> Observation:
        """The observation for the corrected controller."""
        row = self.pack(seen)
        out = np.zeros_like(row)
        pointers = [ctypes.c_void_p(each.ctypes.data) for each in (state, row, out)]
        self._function("base_observation")(*pointers)
        numbers = out.astype(np.float64)
        return Observation(
            seen.time, *numbers[:7].tolist(), numbers[7:].reshape(-1, 2), seen.spacing
        )


class InC(ControllerComponent):
    """A compiled policy as a controller; its state is (C's, the base's)."""

    library: Any = Field(exclude=True)
    base: Any = None

    def init(self, vehicle: Vehicle, dt: float) -> Any:
        base = card_base(self.library.p.card)
        return self.library.init(), base, None if base is None else base.init(vehicle, dt)

    def decide(self, state: Any, observation: Observation) -> tuple[float, Status, Any]:
        mine, base, its = state
        mine, command = mine.copy(), 0.0
        if base is not None:
            decision, its = base.step(its, self.library.trimmed(mine, observation))
            command = decision.steer
        steer, status = self.library.step(mine, observation, command)
        if base is not None:
            its = base.executed(its, steer)
        return steer, status, (mine, base, its)


__all__ = ["ARCHITECTURES", "InC", "Library", "PolicyState"]
