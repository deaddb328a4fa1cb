"""A controller's C, compiled here: as a library's bytes, or as a controller to be called."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from pydantic import Field

from steersman.controllers.base import ControllerComponent
from steersman.delivery import controller_text as text
from steersman.delivery.controller import Setting, translated
from steersman.delivery.package import COMPILERS
from steersman.errors import ConfigError, ControllerError, one_line
from steersman.types import Decision, Observation, Status
from steersman.vehicles import Vehicle

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared")
_VISIBLE = "-fvisibility=default"
_LONGEST = 300.0
_SAME = 1e-9


def shared_library(
    sources: Mapping[str, str], files: Iterable[str], flags: Iterable[str] = FLAGS
) -> bytes:
    """The shared library of C ``files`` among ``sources``.

    Raises:
        ConfigError: there is no compiler, or it fails; the message says why.
    """
    compiler = next((found for found in map(shutil.which, COMPILERS) if found), None)
    if compiler is None:
        raise ConfigError("there is no C compiler here")
    with tempfile.TemporaryDirectory() as scratch:
        for each, content in sources.items():
            FilePath(scratch, each).write_text(content, encoding="utf-8")
        words = [compiler, *flags, *["-fPIC"] * (sys.platform != "win32")]
        try:
            done = subprocess.run(
                [*words, "-o", "out", *files, "-lm"],
                capture_output=True,
                text=True,
                check=False,
                cwd=scratch,
                timeout=_LONGEST,
            )
        except (OSError, subprocess.SubprocessError) as error:
            raise ConfigError(one_line(str(error))[:160]) from None
        if done.returncode != 0:
            why = one_line(done.stderr)[:160]
            raise ConfigError(f"{FilePath(compiler).name} says {why}")
        return FilePath(scratch, "out").read_bytes()


class CompiledController(ControllerComponent):
    """A compiled controller, called from Python; the bytes of its C state are its state."""

    code: Any = Field(exclude=True)
    prefix: str
    single: bool
    """What it is given and answers is float, else double."""
    waypoints: int | None = None
    """In each observation; None: not checked."""
    spacing: float = 0.0
    """Between them [m]."""
    limits: bool = False
    """Whether it limits the speed."""

    def function(self, name: str) -> Any:
        """One of its functions."""
        found = getattr(self.code, f"{self.prefix}_{name}")
        kinds = {"step": ctypes.c_int, "size": ctypes.c_int, "speed_limit": type(self.real())}
        found.restype = kinds.get(name)
        return found

    def packed(self, seen: Observation) -> Any:
        """An observation as C has it.

        Raises:
            ControllerError: it has other waypoints than the C code was made for.
        """
        if self.waypoints is not None and (
            len(seen.preview) != self.waypoints or abs(seen.spacing - self.spacing) > _SAME
        ):
            raise ControllerError(
                f"preview: {len(seen.preview)} waypoints {seen.spacing:g} m apart, the compiled "
                f"controller takes {self.waypoints}, {self.spacing:g} m apart (sensor.count, "
                "sensor.spacing)"
            )
        if self.limits and len(seen.wished) != len(seen.preview):
            raise ControllerError("no speed is wished; set speed=constant_speed or another")
        given = [*seen[:8], *seen.preview.ravel(), *(seen.wished if self.limits else ())]
        return np.array(given, np.float32 if self.single else np.float64)

    def real(self, value: float = 0.0) -> Any:
        """A number as C has it."""
        return ctypes.c_float(value) if self.single else ctypes.c_double(value)

    def init(self, vehicle: Vehicle, dt: float) -> bytes:
        """The state before the first step."""
        state = ctypes.create_string_buffer(self.function("size")())
        self.function("init")(state, None)
        return state.raw

    def decide(self, state: bytes, observation: Observation) -> Any:
        """Not called: a step of C is whole."""
        raise NotImplementedError

    def step(self, state: bytes, observation: Observation | None) -> tuple[Decision, bytes]:
        """The decision of the C code."""
        steer, after = self.real(), ctypes.create_string_buffer(state, len(state))
        given = None if observation is None else self.packed(observation)
        at = None if given is None else ctypes.c_void_p(given.ctypes.data)
        status = self.function("step")(after, at, ctypes.byref(steer))
        limit = self.speed_limit(after.raw)
        return Decision(float(steer.value), Status(status), speed_limit=limit), after.raw

    def limits_speed(self) -> bool:
        """Whether the C code does."""
        return self.limits

    def speed_limit(self, state: bytes) -> float:
        """What the C code allows [m/s]."""
        if not self.limits:
            return math.nan
        return float(self.function("speed_limit")(ctypes.create_string_buffer(state, len(state))))

    def executed(self, state: bytes, steer: float) -> bytes:
        """Another command was executed."""
        after = ctypes.create_string_buffer(state, len(state))
        self.function("executed")(after, self.real(steer))
        return after.raw


def compiled_controller(setting: Setting) -> CompiledController:
    """The controller in C, compiled and loaded into this process.

    Raises:
        ConfigError: C cannot be made of it, or there is no compiler.
    """
    made, prefix = translated(setting), setting.prefix
    size = f'#include "{prefix}.h"\nint {prefix}_size(void);\n'
    size += f"int {prefix}_size(void)\n{{\n    return (int)sizeof({prefix}_state);\n}}\n"
    sources = {**text.sources(made), "size.c": size}
    data = shared_library(sources, [f"{prefix}.c", "size.c"], [*FLAGS, _VISIBLE])
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:  # Windows holds it
        file = FilePath(folder, prefix)
        file.write_bytes(data)
        code = ctypes.CDLL(str(file))
    return CompiledController(
        code=code,
        prefix=prefix,
        single=setting.handed == "float",
        waypoints=setting.waypoints,
        spacing=setting.spacing,
        limits=setting.limits_speed,
    )
