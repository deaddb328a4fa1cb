"""One update of each off-policy agent beside Stable-Baselines3's own, in turns in one process.

    python benchmarks/updates.py --out results/benchmarks/updates.json

Sizes are those of the preset ``demo``, two hidden layers of 128, and for DDPG also those of the
preset ``paper``, layers of 400 and 300; batches of 256, one thread.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import stable_baselines3
from stable_baselines3.common.logger import Logger

from steersman.files import write_text
from steersman.learning.arithmetic import arithmetic
from steersman.learning.config import TrainConfig, load_preset, train_config
from steersman.learning.vec_env import PathFollowingVecEnv
from steersman.provenance import provenance

CONFIGS: dict[str, Callable[[], TrainConfig]] = {
    kind: partial(lambda kind: train_config({**load_preset("demo"), "agent": {"kind": kind}}), kind)
    for kind in ("ddpg", "td3", "sac")
} | {"ddpg_paper": lambda: train_config(load_preset("paper"))}
# Updates in a call, as in the preset; calls that are timed.
UPDATES, CALLS = 4, 60


def pair(config: TrainConfig) -> dict[str, Any]:
    """The agent and stock Stable-Baselines3's on the same replay buffer."""
    settings: Any = config.agent
    env = PathFollowingVecEnv(config.problem, settings.vehicles)
    own: Any = settings.make(config, env)
    own.learn(2 * settings.learning_starts)
    stock = getattr(stable_baselines3, settings.kind.upper())(
        "MlpPolicy",
        env,
        buffer_size=settings.buffer,
        batch_size=settings.batch,
        policy_kwargs={"net_arch": list(settings.hidden)},
        gamma=settings.gamma,
        device="cpu",
    )
    stock.replay_buffer = own.replay_buffer
    return {"own": own, "stock": stock}


def measure(config: TrainConfig) -> dict[str, float]:
    """Median time of an update [ms], and how many times as long stock's takes."""
    agents, batch = pair(config), config.agent.batch
    seconds: dict[str, list[float]] = {name: [] for name in agents}
    for agent in agents.values():
        agent.set_logger(Logger(None, []))
        agent.train(UPDATES, batch)
    for _ in range(CALLS):
        for name, agent in agents.items():
            begun = time.perf_counter()
            agent.train(UPDATES, batch)
            seconds[name].append((time.perf_counter() - begun) / UPDATES)
    own, stock = (1e3 * float(np.median(seconds[name])) for name in ("own", "stock"))
    return {"own_ms": own, "sb3_ms": stock, "sb3_over_own": stock / own}


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path)
    out = parser.parse_args().out
    with arithmetic(1):
        figures = {name: measure(config()) for name, config in CONFIGS.items()}
    for kind, row in figures.items():
        sys.stdout.write(f"{kind} {' '.join(f'{k} {v:.3f}' for k, v in row.items())}\n")
    if out is not None:
        write_text(out, json.dumps({"updates": figures, **provenance()}, indent=1) + "\n")


if __name__ == "__main__":
    main()
