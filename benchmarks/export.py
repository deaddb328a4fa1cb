"""One decision of a delivered policy: in C, in ONNX Runtime, and by Stable-Baselines3's predict.

    python benchmarks/export.py [--policy precision] [--out results/benchmarks/export.json]

All sides run in one process on one thread and take turns; a figure is the median over rounds.
Machines differ and are noisy: the ratios mean more than the times. C is timed from C, and once
more as Python calls it. How far each side is from exact arithmetic stands beside the times.
Needs a C compiler (gcc or cc).
"""

from __future__ import annotations

import argparse
import ctypes
import json
import platform
import shutil
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ddpg_mpc_pid.timing import read_weights, sb3_predict
from steersman.cli.exported import ToExport, setting_of
from steersman.controllers.policy import Policy
from steersman.delivery.controller import Setting
from steersman.delivery.controller_package import write_controller
from steersman.delivery.graph import TOLERANCE, Network, exact, random_features
from steersman.delivery.observations import Row, drawn
from steersman.delivery.vector_text import answers, rows_of
from steersman.files import write_text
from steersman.network_file import PolicyNetwork
from steersman.provenance import provenance
from steersman.types import Observation

ROUNDS = 15
CALLS = 1000
COMPARED = 100_000
DRIVE = 30
COMPILED = {
    "portable": ("-O3",),
    "this machine's instructions": ("-O3", "-march=native"),
    "small": ("-Os",),
}
LOOPS = """#include "{prefix}.h"
void many_networks(const float *obs, int count, float *actions)
{{
    int i;
    for (i = 0; i < count; ++i) {{
        {prefix}_network(obs + i * {features}, actions + i);
    }}
}}
void many_steps(const {prefix}_observation *seen, int count, float *steers)
{{
    {prefix}_state state;
    int i;
    {prefix}_init(&state, 0);
    for (i = 0; i < count; ++i) {{
        (void){prefix}_step(&state, seen + i, steers + i);
    }}
}}
"""


class ExportedPolicy(NamedTuple):
    """A policy, and what its C is made of."""

    setting: Setting
    controller: Policy
    data: bytes
    """The network's file."""
    network: Network


def exported(word: str) -> ExportedPolicy:
    """The policy in float."""
    setting = setting_of(ToExport(word, (), True))
    assert isinstance(setting.controller, Policy)
    network = setting.start().run.network
    return ExportedPolicy(setting, setting.controller, setting.controller.read()[0], network)


class Compiled:
    """A policy in C, with loops around it."""

    def __init__(
        self, p: ExportedPolicy, folder: Path, compiler: str, flags: tuple[str, ...]
    ) -> None:
        """Compile what was written into ``folder``."""
        prefix = p.setting.prefix
        text = LOOPS.format(prefix=prefix, features=len(p.network.scale))
        (folder / "loops.c").write_text(text, encoding="ascii")
        file = folder / f"policy{'_'.join(flags)}.so"
        sources = [f"{prefix}.c", "loops.c"]
        words = ["-std=c99", *flags, "-shared", "-fPIC", "-o", str(file), *sources, "-lm"]
        subprocess.run([compiler, *words], check=True, cwd=folder)
        code = ctypes.CDLL(str(file))
        self.one = getattr(code, f"{prefix}_network")
        self.networks, self.steps = code.many_networks, code.many_steps
        self.one.restype = self.networks.restype = self.steps.restype = None

    def actions(self, features: Any) -> Any:
        """Of many rows."""
        out = np.empty(len(features), np.float32)
        self.networks(pointer(features), len(features), pointer(out))
        return out

    def drive(self, seen: Any, steers: Any) -> None:
        """The steering of many observations."""
        self.steps(pointer(seen), len(seen), pointer(steers))


def pointer(values: Any) -> ctypes.c_void_p:
    """Where an array lies."""
    return ctypes.c_void_p(values.ctypes.data)


def packed(seen: list[Observation]) -> Any:
    """Observations as C sees them."""
    return np.array([[*row[:8], *row.preview.ravel()] for row in seen], np.float32)


def seconds(work: Callable[[], Any], count: int) -> float:
    """Time of one of the ``count`` decisions in a call."""
    begun = time.thread_time()  # others use the machine, too
    work()
    return (time.thread_time() - begun) / count


def each(work: Callable[[Any], Any], values: Any) -> Callable[[], None]:
    """One call for each value, as Python has to."""

    def run() -> None:
        for value in values:
            work(value)

    return run


def sides(
    p: ExportedPolicy, compiled: dict[str, Compiled], features: Any
) -> dict[str, Callable[[], Any]]:
    """What is timed: each makes ``CALLS`` decisions."""
    sound = [row.seen for row in rows_of(p.setting) if np.isfinite(packed([row.seen])).all()]
    seen = [sound[i % len(sound)] for i in range(CALLS)]
    in_c, steers = packed(seen), np.empty(CALLS, np.float32)
    action = np.empty(1, np.float32)
    singles = [row[None, :] for row in features]
    session = PolicyNetwork(p.data, p.setting.name, features.shape[1])
    weights = read_weights(p.data)
    predict = sb3_predict(features.shape[1], [len(weights["b1"]), len(weights["b2"])])
    state = p.controller.init(p.setting.vehicle, p.setting.dt)
    portable = compiled["portable"]
    at, to = [pointer(row) for row in features], pointer(action)
    work: dict[str, Callable[[], Any]] = {}
    for name, code in compiled.items():
        work[f"network, C, {name}"] = partial(code.actions, features)
        work[f"step, C, {name}"] = partial(code.drive, in_c, steers)
    work["network, C called from Python"] = each(lambda row: portable.one(row, to), at)
    work["network, ONNX Runtime"] = each(session, singles)
    work["network, SB3 predict"] = each(predict, list(features * p.network.scale))
    work["step, Python with ONNX Runtime"] = each(lambda row: p.controller.step(state, row), seen)
    return work


def latency(work: dict[str, Callable[[], Any]]) -> dict[str, float]:
    """Microseconds of one decision: the median over rounds in which all sides take turns."""
    times: dict[str, list[float]] = {name: [] for name in work}
    for run in work.values():
        run()
    for _ in range(ROUNDS):
        for name, run in work.items():
            times[name].append(seconds(run, CALLS))
    return {name: 1e6 * statistics.median(values) for name, values in times.items()}


def parity(p: ExportedPolicy, code: Compiled) -> dict[str, float]:
    """Largest differences of an action over random observations, extremes included."""
    seen = random_features(p.network.scale, COMPARED)
    expected = exact(p.network, seen)[:, 0]
    session = PolicyNetwork(p.data, p.setting.name, seen.shape[1])
    c = abs(code.actions(seen) - expected)
    onnx = abs(np.array([session(row[None, :])[0] for row in seen]) - expected)
    return {
        "observations": COMPARED,
        "tolerance": TOLERANCE,
        "c_from_exact": float(c.max()),
        "onnxruntime_from_exact": float(onnx.max()),
        "share_of_onnxruntime_beyond_tolerance": float((onnx > TOLERANCE).mean()),
    }


def steps_parity(p: ExportedPolicy, code: Compiled) -> dict[str, float]:
    """Largest differences of steering over whole steps of every size, thirty to a drive."""
    rng = np.random.default_rng(1)
    sizes = 10.0 ** rng.uniform(-42.0, 15.0, COMPARED)
    sizes[::2] = rng.uniform(0.0, 2.0, COMPARED // 2)
    given = [Row(i % DRIVE == 0, drawn(p.setting, rng, x)) for i, x in enumerate(sizes)]
    seen = packed([row.seen for row in given])
    steers = np.empty(COMPARED, np.float32)
    for i in range(0, COMPARED, DRIVE):
        drive = seen[i : i + DRIVE]
        code.steps(pointer(drive), len(drive), pointer(steers[i:]))
    expected = np.array([answer.steer for answer in answers(p.setting, given)])
    start = state = p.controller.init(p.setting.vehicle, p.setting.dt)
    onnx = np.empty(COMPARED)
    for i, row in enumerate(given):
        decision, state = p.controller.step(start if row.restart else state, row.seen)
        onnx[i] = decision.steer
    return {
        "steps": COMPARED,
        "steps_c_from_exact_network": float(abs(steers - expected).max()),
        "steps_c_beyond_tolerance": int((abs(steers - expected) > TOLERANCE).sum()),
        "steps_python_with_onnxruntime_from_exact_network": float(abs(onnx - expected).max()),
    }


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--policy", default="precision")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        parser.error("there is no C compiler")
    p = exported(arguments.policy)
    if p.setting.start().base is not None:
        parser.error(f"{p.setting.name} corrects another controller, whose time would count too")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_controller(p.setting, folder)
        compiled = {how: Compiled(p, folder, compiler, flags) for how, flags in COMPILED.items()}
        # As large as they are at speed.
        rng = np.random.default_rng(0)
        usual = rng.uniform(-1.0, 1.0, (CALLS, len(p.network.scale))) / p.network.scale
        times = latency(sides(p, compiled, np.ascontiguousarray(usual, np.float32)))
        agreement = parity(p, compiled["portable"])
        agreement |= steps_parity(p, compiled["portable"])
    for what, value in times.items():
        print(f"{what:50s} {value:8.2f} us")  # noqa: T201 - its output
    for what, value in agreement.items():
        print(f"{what:50s} {value:8.2g}")  # noqa: T201 - its output
    if arguments.out is not None:
        version = subprocess.run(
            [compiler, "--version"], capture_output=True, text=True, check=True
        )
        record = {
            "policy": p.setting.name,
            "layers": [list(layer.weights.shape) for layer in p.network.layers],
            "latency_us": times,
            "parity": agreement,
            "compiler": version.stdout.splitlines()[0],
            "flags": {how: list(flags) for how, flags in COMPILED.items()},
            "processor": platform.processor(),
            **provenance(),
        }
        write_text(arguments.out, json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
