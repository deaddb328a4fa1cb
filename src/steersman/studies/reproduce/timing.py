"""Computing time of the controllers alone, on the observations of one drive on Monza."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.config import build
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc_pid import MpcPid
from steersman.controllers.policy import Policy
from steersman.episode import Episode
from steersman.learning.config import TrainConfig
from steersman.paths.base import PathComponent
from steersman.policy_file import read_policy
from steersman.rollout import RunConfig, run
from steersman.sensing import track
from steersman.studies.reproduce import usual_mpc
from steersman.studies.reproduce.drives import policy, throttle
from steersman.studies.reproduce.monza import THROTTLE, length
from steersman.studies.reproduce.networks import compiled, sb3_predict
from steersman.studies.reproduce.plan import FULL_METHOD, Plan
from steersman.studies.reproduce.stages import Folder
from steersman.studies.reproduce.trainings import policies
from steersman.types import FloatArray, Observation, VehicleState

# What the paper measured on its lap [s]: the policy, MPC-PID "with a small prediction horizon",
# each with the simulator in synchronous mode around it.
PAPER = {"policy_s": 145.28, "mpc_pid_s": 664.23, "saved": 0.7813}
_DT = 0.05


def timing(plan: Plan, folder: Folder) -> dict[str, Any]:
    """Times of one control step [us] and of a lap [s], for every implementation."""
    files = policies(plan, folder, [FULL_METHOD])[FULL_METHOD]
    driver: dict[str, Any] = policy(next(iter(files.values()))) if files else {"kind": "mpc_pid"}
    words: dict[str, Any] = {"controller": driver, "path": "monza", "speed": throttle(THROTTLE)}
    config = build(RunConfig, words | length(plan))
    episode = run(config)
    seen = observations(episode, config, plan.timed_steps)
    rows: list[dict[str, Any]] = []
    for horizon in plan.horizons:
        times = _controller(MpcPid(horizon=horizon), config, seen)
        rows.append(_row(f"MPC-PID, N = {horizon}", times, len(episode)))
    if files:
        rows += _policies(next(iter(files.values())), plan, config, seen, len(episode))
    for horizon in plan.horizons:
        row = usual_mpc.measure(horizon, seen[: plan.solves], config)
        solved = row.pop("times", None)
        rows.append(row if solved is None else row | _row(row["name"], solved, len(episode), True))
    return {"paper": PAPER, "lap_steps": len(episode), "lap_end": episode.end, "rows": rows}


def observations(episode: Episode, config: RunConfig, count: int) -> list[Observation]:
    """What the sensor told at the first steps of a recorded drive."""
    path: PathComponent = config.path
    rng = np.random.default_rng(0)
    out = []
    for k in range(min(count, len(episode))):
        state = VehicleState(*(float(episode[name][k]) for name in VehicleState._fields))
        place = track(state, path, float(episode["s"][k]))
        out.append(config.sensor.observe(None, state, place, path, rng))
    return out


def _controller(
    controller: ControllerComponent,
    config: RunConfig,
    seen: Sequence[Observation],
    state: Any = None,
) -> FloatArray:
    """Time of every call of ``step`` [us]; the first call, which may compile, does not count."""
    state = controller.init(config.vehicle, _DT) if state is None else state
    controller.step(state, seen[0])
    times = np.empty(len(seen))
    for k, observation in enumerate(seen):
        begun = time.perf_counter()
        _, state = controller.step(state, observation)
        times[k] = time.perf_counter() - begun
    return 1e6 * times


def _calls(work: Callable[[int], Any], count: int) -> FloatArray:
    work(0)
    times = np.empty(count)
    for k in range(count):
        begun = time.perf_counter()
        work(k)
        times[k] = time.perf_counter() - begun
    return 1e6 * times


def _row(name: str, times: FloatArray, lap: int, extrapolated: bool = False) -> dict[str, Any]:
    return {
        "name": name,
        "p50_us": float(np.median(times)),
        "p99_us": float(np.percentile(times, 99)),
        "max_us": float(times.max()),
        "steps": len(times),
        "lap_s": float(1e-6 * times.mean() * lap),
        "extrapolated": extrapolated or len(times) < lap,
        "note": "",
    }


def _policies(
    file: FilePath, plan: Plan, config: RunConfig, seen: Sequence[Observation], lap: int
) -> list[dict[str, Any]]:
    """The same policy in ONNX Runtime, compiled, and through Stable-Baselines3."""
    controller = Policy(file=str(file))
    state = controller.init(config.vehicle, _DT)
    data, card = read_policy(file)
    network = compiled(data)
    rng = np.random.default_rng(0)
    raw = (rng.uniform(-1.0, 1.0, (len(seen), state.features)) / np.array(card.scale)).astype(
        np.float32
    )
    gap = max(abs(state.run(x[None]) - network(x[None])) for x in raw[:200])
    rows = [
        _row("policy, ONNX Runtime", _controller(controller, config, seen), lap),
        _row(
            "policy, compiled",
            _controller(controller, config, seen, state._replace(run=network)),
            lap,
        ),
        _row(
            "of which network, ONNX Runtime",
            _calls(lambda k: state.run(raw[k][None]), len(raw)),
            lap,
        ),
        _row("of which network, compiled", _calls(lambda k: network(raw[k][None]), len(raw)), lap),
    ]
    rows[1]["note"] = f"differs from ONNX Runtime by at most {gap:.1e} of full action"
    training = build(TrainConfig, card.training["config"])
    predict = sb3_predict(training)
    some = raw[: min(plan.timed_steps, 3000)] * np.array(card.scale, np.float32)
    rows.append(
        _row(
            "network, Stable-Baselines3 predict", _calls(lambda k: predict(some[k]), len(some)), lap
        )
    )
    rows[-1]["note"] = "without making its input"
    return rows
