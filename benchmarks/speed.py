"""Speed of the parts, each beside something everyone can run, in one process.

    python benchmarks/speed.py [--out results/benchmarks/speed.json] [--against CHECKOUT]

Machines differ and are noisy: the ratios mean more than the times. Every figure is the median of
several rounds, and the two sides of a ratio alternate.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import threadpoolctl
import torch
from stable_baselines3 import DDPG

from steersman.config import build
from steersman.controllers.mpc_pid import MpcPid
from steersman.files import write_text
from steersman.kernels import step as lessons
from steersman.kernels import world as kernel
from steersman.learning.config import load_preset, train_config
from steersman.learning.fleet import FleetDriver
from steersman.learning.problem import Problem
from steersman.learning.vec_env import PathFollowingVecEnv
from steersman.provenance import provenance
from steersman.sensing import to_observation
from steersman.vehicles import CarlaModel3

ROUNDS = 5


def seconds(work: Callable[[], Any], count: int) -> float:
    """Time of one call, over ``count`` calls."""
    begun = time.perf_counter()
    for _ in range(count):
        work()
    return (time.perf_counter() - begun) / count


def alternate(sides: dict[str, tuple[Callable[[], Any], int]]) -> dict[str, float]:
    """Median time of one call of each side, run in turns."""
    times: dict[str, list[float]] = {name: [] for name in sides}
    for work, _ in sides.values():
        work()
    for _ in range(ROUNDS):
        for name, (work, count) in sides.items():
            times[name].append(seconds(work, count))
    return {name: statistics.median(values) for name, values in times.items()}


def following(driver: FleetDriver) -> Callable[[], None]:
    """A kernel step of all vehicles under the demonstrator's last actions, kept on the road."""
    actions = np.zeros(driver.n)

    def work() -> None:
        lessons.step(driver.world, driver.fleet, driver.lesson, actions)
        for i in np.flatnonzero(driver.fleet.ended != kernel.RUNNING).tolist():
            driver.reset(i)

    return work


def simulation() -> dict[str, float]:
    """Control steps per second inside the kernel and through Gymnasium."""
    straight = build(
        Problem,
        {"roads": ["training_circuit"], "demonstration": {"enabled": False}, "action": "direct"},
    )
    many = FleetDriver(straight, 256)
    for i in range(many.n):
        many.reset(i)
    env = gymnasium.make("steersman/PathFollowing-v0", problem=straight)
    env.reset(seed=0)
    peer = gymnasium.make("Pendulum-v1")
    peer.reset(seed=0)
    action = np.zeros(1, np.float32)

    def stepper(e: Any) -> Callable[[], None]:
        def work() -> None:
            _, _, terminated, truncated, _ = e.step(action)
            if terminated or truncated:
                e.reset()

        return work

    t = alternate(
        {
            "kernel": (following(many), 40),
            "gymnasium": (stepper(env), 4000),
            "pendulum": (stepper(peer), 4000),
        }
    )
    return {
        "kernel_control_steps_per_s": many.n / t["kernel"],
        "gymnasium_control_steps_per_s": 1.0 / t["gymnasium"],
        "gymnasium_pendulum_steps_per_s": 1.0 / t["pendulum"],
        "ratio_to_pendulum": t["pendulum"] / t["gymnasium"],
    }


def controller() -> dict[str, float]:
    """One MPC-PID decision at N = 20, everything included, beside the bare solver."""
    mpc = MpcPid(horizon=20)
    vehicle = CarlaModel3()
    problem = build(Problem, {"roads": ["training_circuit"]})
    driver = FleetDriver(problem, 1)
    driver.reset(0)
    observation = to_observation(driver.fleet.rows[0].copy(), 0.0, problem.sensor.spacing)
    state = mpc.init(vehicle, 0.05)
    solver = state.problems[0]
    t = alternate(
        {
            "decision": (lambda: mpc.step(state, observation), 3000),
            "bare": (lambda: solver.solve(observation, 0.0), 3000),
        }
    )
    return {
        "mpc_pid_decision_us": 1e6 * t["decision"],
        "of_which_qp_us": 1e6 * t["bare"],
    }


def learning() -> dict[str, float]:
    """Collecting one vector step of 16 vehicles, and one update beside SB3's own."""
    config = train_config(load_preset("demo"))
    env = PathFollowingVecEnv(config.problem, 16)
    agent = config.agent.make(config, env)
    agent.learn(config.agent.learning_starts + 1600)
    batch = config.agent.batch

    def collect() -> None:
        agent.gradient_steps = 0
        agent.learn(16 * 200, reset_num_timesteps=False)

    t = alternate(
        {
            "collect": (collect, 1),
            "own": (lambda: agent.train(50, batch), 1),
            "stock": (lambda: DDPG.train(agent, 50, batch), 1),
        }
    )
    return {
        "collect_16_vehicles_ms": 1e3 * t["collect"] / 200,
        "update_us": 1e6 * t["own"] / 50,
        "sb3_update_us": 1e6 * t["stock"] / 50,
        "update_ratio_to_sb3": t["stock"] / t["own"],
    }


def measured_in(checkout: Path) -> dict[str, float]:
    """The figures of another version, by its own benchmark."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "speed.json"
        environment = {**os.environ, "PYTHONPATH": str(checkout / "src")}
        words = [sys.executable, str(checkout / "benchmarks" / "speed.py"), "--out", str(out)]
        subprocess.run(words, env=environment, check=True, stdout=subprocess.DEVNULL)
        figures: dict[str, float] = json.loads(out.read_text(encoding="utf-8"))["figures"]
    return figures


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path)
    parser.add_argument(
        "--against", type=Path, help="a checkout of another version, measured right afterwards"
    )
    given = parser.parse_args()
    out = given.out
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    with threadpoolctl.threadpool_limits(1):
        figures = simulation() | controller() | learning()
    other = {} if given.against is None else measured_in(given.against)
    for name, value in figures.items():
        ratio = f"   x {value / other[name]:.3f}" if other.get(name) else ""
        print(f"{name:32s} {value:14,.2f}{ratio}")  # noqa: T201 - its output
    if out is not None:
        record = {"figures": figures, "processor": platform.processor(), **provenance()}
        write_text(out, json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
