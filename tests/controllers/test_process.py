"""A program outside as a controller: lines of JSON, in time, and an end with its parent."""

from __future__ import annotations

import copy
import gc
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.config import resolve
from steersman.controllers.card import check_base
from steersman.controllers.process import Process
from steersman.errors import ConfigError, ControllerError
from steersman.learning.demonstration import Demonstrator
from steersman.sensing import to_observation
from steersman.vehicles import CarlaModel3

SCRIPT = str(FilePath(__file__).parents[1] / "outside.py")


def program(*words: str, timeout: float = 5.0) -> Process:
    command = [sys.executable, "-I", "-S", SCRIPT, *words]
    found = resolve("controller", {"kind": "process", "command": command, "timeout": timeout})
    assert isinstance(found, Process)
    return found


def seen(k: int, left: float = 1.0) -> Any:
    row = np.zeros(7 + 2 * 10)
    row[2] = 10.0
    row[7::2], row[8::2] = 2.0 * np.arange(10), left * np.arange(10) ** 2 / 50.0
    return to_observation(row, 0.05 * k, 2.0)


def running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_several_drives_ask_one_program_and_it_ends_with_them() -> None:
    driver = Demonstrator(program(), CarlaModel3(), 0.05)
    for n in range(2):
        driver.restart(n)
    left, right = (driver.propose(n, seen(0, side)).steer for n, side in ((0, 1.0), (1, -1.0)))
    assert left == -right > 0.01
    drives = [state.drive for state in driver._states.values()]
    assert drives == [0, 1]
    driver.executed(0, 0.3)
    assert driver._states[0].executed == 0.3
    saved = driver.snapshot()
    inner = driver._states[0].program._process
    driver.restart(0)
    driver.propose(0, seen(0))
    assert driver._states[0].drive == 2
    again = Demonstrator(program(), CarlaModel3(), 0.05)
    again.restore(saved)
    assert again._states[0].program is driver._states[0].program
    assert again.propose(0, seen(1)).steer == left
    assert copy.deepcopy(driver._states[0]) == driver._states[0]
    assert pickle.loads(pickle.dumps(driver._states[0])) == driver._states[0]
    del driver, again
    gc.collect()
    assert inner.poll() == 0


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("ends", r"outside.py ends' ended with exit code 1: no petrol left$"),
        ("sleeps", r"gave no answer within timeout: 0\.4 s$"),
        ("babbles", r"answered 'left, I think', which is no line of JSON$"),
        ("nothing", r"answered .*nan.*; a line like .* is expected, in \[-1, 1\], left positive$"),
    ],
)
def test_a_fault_is_one_line(fault: str, message: str) -> None:
    controller = program(fault, timeout=0.4 if fault == "sleeps" else 5.0)
    state = controller.init(CarlaModel3(), 0.05)
    for k in range(2):
        _, state = controller.step(state, seen(k))
    with pytest.raises(ControllerError, match=message) as raised:
        controller.step(state, seen(2))
    assert "\n" not in str(raised.value)
    assert state.program._process.poll() is not None
    with pytest.raises(ControllerError, match=message):
        controller.step(state, seen(3))
    fresh = controller.init(CarlaModel3(), 0.05)
    assert fresh.program is not state.program
    controller.step(fresh, seen(0))


def test_a_program_that_is_not_there() -> None:
    missing = Process(command=("no-such-program-here",))
    with pytest.raises(ConfigError, match="command: 'no-such-program-here' cannot be started"):
        missing.init(CarlaModel3(), 0.05)
    with pytest.raises(ConfigError, match="command"):
        resolve("controller", {"kind": "process", "command": []})


def test_no_card_starts_a_program() -> None:
    for kind in (program(), resolve("controller", {"kind": "estimated", "controller": program()})):
        with pytest.raises(ValueError, match="a program cannot be the base"):
            check_base(kind, joint=False)  # type: ignore[arg-type]


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_it_ends_with_a_parent_that_is_killed() -> None:
    code = (
        "import subprocess, sys; from steersman.controllers.outside import OutsideProgram;"
        "import steersman.controllers.outside as o;"
        f"p = o.OutsideProgram((sys.executable, '-I', '-S', {SCRIPT!r}), 5.0);"
        "print(p._process.pid, flush=True); sys.stdin.read()"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        assert running(child)
        parent.send_signal(signal.SIGKILL)
    end = time.monotonic() + 10.0
    while running(child) and time.monotonic() < end:
        time.sleep(0.02)
    assert not running(child)
