"""Exported policies, compiled and called."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
import pytest

from steersman.cli.exported import ToExport, setting_of
from steersman.delivery.compiled import CompiledController
from steersman.delivery.controller import Setting
from steersman.delivery.controller_package import write_controller
from steersman.delivery.graph import Network
from steersman.learning.config import TrainConfig
from steersman.learning.export import export_policy

from ..learning.problems import problem
from ..loops import random_net
from ..scripts import script

COMPILER = next((each for each in ("gcc", "cc", "clang") if shutil.which(each)), "")
needs_compiler = pytest.mark.skipif(not COMPILER, reason="there is no C compiler")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic", "-Wshadow")
SANITISERS = (
    "-g", "-O1", "-fsanitize=address,undefined,float-cast-overflow,float-divide-by-zero",
    "-fno-sanitize-recover=all",
)  # fmt: skip
bench = script("benchmarks/controllers_in_c.py")
# What else a policy can be: its problem, the operators of its network, and its trim.
ARCHITECTURES: dict[str, tuple[dict[str, Any], tuple[str, str], float]] = {
    "history and trim": ({"encoding": {"kind": "extended", "history": 8}}, ("Relu", "Tanh"), 1.0),
    "rate": ({"encoding": {"kind": "extended"}}, ("Relu", "Tanh"), 0.0),
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
        {"action": "residual", "base": {"kind": "stanley"}, "authority": 0.2,
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


def export(words: str | FilePath, folder: FilePath, *, single: bool = False) -> Setting:
    """Write the C package of a policy into a folder."""
    folder.mkdir(exist_ok=True)
    setting = setting_of(ToExport(str(words), (), "single" if single else "double"))
    write_controller(setting, folder)
    return setting


def run(*words: str | FilePath, cwd: FilePath | None = None) -> str:
    """What a command prints; it must succeed and say nothing on stderr."""
    done = subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, check=False, cwd=cwd,
        timeout=120,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, ""), done.stderr + done.stdout
    return done.stdout


class InC(NamedTuple):
    """A compiled policy."""

    setting: Setting
    folder: FilePath
    code: CompiledController
    """Of the class that is a controller, too."""

    @property
    def layers(self) -> Network:
        """The network in the file."""
        return self.setting.start().run.network  # type: ignore[no-any-return]

    def network(self, features: Any) -> Any:
        """Actions of rows of raw features, by the C function of the network alone."""
        kind = np.float32 if self.setting.single else np.float64
        rows, out = np.ascontiguousarray(features, kind), np.empty(len(features), kind)
        call, start, to = self.code.function("network"), rows.ctypes.data, out.ctypes.data
        for i in range(len(rows)):
            at = start + i * rows.strides[0], to + i * out.itemsize
            call(*map(ctypes.c_void_p, at))
        return out.astype(np.float64)


def build(words: str | FilePath, folder: FilePath, *flags: str, single: bool = False) -> InC:
    """A policy in C as a shared library."""
    setting = export(words, folder, single=single)
    code = bench.compiled(setting, folder, (COMPILER, *(flags or ("-O1",))))
    return InC(setting, folder, code)
