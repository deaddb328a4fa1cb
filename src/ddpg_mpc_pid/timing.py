"""Computing time of the controllers alone, on the observations of one drive on Monza.

The MPC as users usually write it is CasADi's Opti with IPOPT: cost, horizon and single-track model
of MPC-PID (docs/mpc_pid.md) as a nonlinear program that is built once and solved at every step
from the last solution.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

import steersman as sm
from ddpg_mpc_pid.drives import policy, throttle
from ddpg_mpc_pid.plan import FULL_METHOD, Plan
from ddpg_mpc_pid.results import TimingResult, TimingRow
from ddpg_mpc_pid.tracks import THROTTLE, length
from ddpg_mpc_pid.trainings import policies

# What the paper measured on its lap [s]: the policy, MPC-PID "with a small prediction horizon",
# each with the simulator in synchronous mode around it.
PAPER = {"policy_s": 145.28, "mpc_pid_s": 664.23, "saved": 0.7813}
_DT = 0.05
ABSENT = "not measured: CasADi is not installed (pip install casadi)"


def timing(plan: Plan, runs: FilePath) -> TimingResult:
    """Times of one control step [us] and of a lap [s], for every implementation."""
    files = policies(plan, runs, [FULL_METHOD])[FULL_METHOD]
    driver: dict[str, Any] = policy(next(iter(files.values()))) if files else {"kind": "mpc_pid"}
    words: dict[str, Any] = {"controller": driver, "path": "monza", "speed": throttle(THROTTLE)}
    config = sm.configure("drive", words | length(plan))
    episode = sm.drive(config)
    seen = sm.observations(episode, config.path, config.sensor, plan.timed_steps)
    lap = len(episode)
    rows: list[TimingRow] = []
    for horizon in plan.horizons:
        times = _controller(sm.make("controller", "mpc_pid", horizon=horizon), config, seen)
        rows.append(_row(f"MPC-PID, N = {horizon}", times, lap))
    if files:
        rows += _policies(next(iter(files.values())), plan, config, seen, lap)
    rows += [usual_mpc(horizon, seen[: plan.solves], config, lap) for horizon in plan.horizons]
    return TimingResult(paper=PAPER, lap_steps=lap, lap_end=episode.end, rows=rows)


def _controller(
    controller: Any,
    config: sm.RunConfig,
    seen: Sequence[sm.Observation],
    state: Any = None,
) -> NDArray[np.float64]:
    """Time of every call of ``step`` [us]; the first call, which may compile, does not count."""
    state = controller.init(config.vehicle, _DT) if state is None else state
    controller.step(state, seen[0])
    times = np.empty(len(seen))
    for k, observation in enumerate(seen):
        begun = time.perf_counter()
        _, state = controller.step(state, observation)
        times[k] = time.perf_counter() - begun
    return 1e6 * times


def _calls(work: Callable[[Any], Any], inputs: Any) -> NDArray[np.float64]:
    """Time of each call of ``work`` [us]; the first, which may compile, does not count."""
    work(inputs[0])
    times = np.empty(len(inputs))
    for k, x in enumerate(inputs):
        begun = time.perf_counter()
        work(x)
        times[k] = time.perf_counter() - begun
    return 1e6 * times


def _row(name: str, times: NDArray[np.float64], lap: int, **words: Any) -> TimingRow:
    return TimingRow(
        name=name,
        p50_us=float(np.median(times)),
        p99_us=float(np.percentile(times, 99)),
        max_us=float(times.max()),
        steps=len(times),
        lap_s=float(1e-6 * times.mean() * lap),
        **{"extrapolated": len(times) < lap, **words},
    )


def _policies(
    file: FilePath, plan: Plan, config: sm.RunConfig, seen: Sequence[sm.Observation], lap: int
) -> list[TimingRow]:
    """The same policy in ONNX Runtime, compiled, and through Stable-Baselines3."""
    controller: Any = sm.make("controller", "policy", file=str(file))
    state = controller.init(config.vehicle, _DT)
    weights = read_weights(file.read_bytes())
    network = compiled(weights)
    rng = np.random.default_rng(0)
    features = rng.uniform(-1.0, 1.0, (len(seen), state.features))
    raw = (features / weights["scale"]).astype(np.float32)
    gap = max(float(abs(state.run(x[None]) - network(x[None]))[0]) for x in raw[:200])
    predict = sb3_predict(state.features, [len(weights["b1"]), len(weights["b2"])])
    some = raw[: min(plan.timed_steps, 3000)] * weights["scale"].astype(np.float32)
    onnx, ours = _controller(controller, config, seen), state._replace(run=network)
    own = _controller(controller, config, seen, ours)
    differs = f"differs from ONNX Runtime by at most {gap:.1e} of full action"
    in_runtime, in_ours = (
        _calls(lambda x: state.run(x[None]), raw),
        _calls(lambda x: network(x[None]), raw),
    )
    return [
        _row("policy, ONNX Runtime", onnx, lap),
        _row("policy, compiled", own, lap, note=differs),
        _row("of which network, ONNX Runtime", in_runtime, lap),
        _row("of which network, compiled", in_ours, lap),
        _row(
            "network, Stable-Baselines3 predict",
            _calls(predict, some),
            lap,
            note="without making its input",
        ),
    ]


def read_weights(data: bytes) -> dict[str, NDArray[np.float32]]:
    """The arrays of an exported network, by name: w1 to w3, b1 to b3, scale, low, high."""
    import onnx

    graph = onnx.load_from_string(data).graph
    return {array.name: onnx.numpy_helper.to_array(array) for array in graph.initializer}


def compiled(weights: dict[str, NDArray[np.float32]]) -> Callable[[Any], NDArray[np.float64]]:
    """The exported network as one compiled function from features (1, n) to the action (1,)."""
    names = ("scale", "low", "high", "w1", "b1", "w2", "b2", "w3", "b3")
    arrays = tuple(np.ascontiguousarray(weights[name].T, np.float32) for name in names)
    forward = _forward()

    def run(x: Any) -> NDArray[np.float64]:
        return np.array([math.tanh(float(forward(x, arrays)))])

    return run


@cache
def _forward() -> Any:
    import numba

    @numba.njit(cache=True)
    def forward(x: Any, arrays: Any) -> Any:
        scale, low, high, w1, b1, w2, b2, w3, b3 = arrays
        none = np.float32(0.0)
        first = np.maximum(np.dot(np.minimum(np.maximum(x * scale, low), high), w1) + b1, none)
        second = np.maximum(np.dot(first, w2) + b2, none)
        return (np.dot(second, w3) + b3)[0, 0]

    return forward


def sb3_predict(features: int, hidden: Sequence[int]) -> Callable[[Any], Any]:
    """``predict`` of Stable-Baselines3 for a network of these sizes, one observation."""
    import torch
    from gymnasium.spaces import Box
    from stable_baselines3.td3.policies import TD3Policy

    torch.set_num_threads(1)
    sizes = [Box(-1.0, 1.0, (n,), np.float32) for n in (features, 1)]
    actor = TD3Policy(sizes[0], sizes[1], lambda _: 1e-3, net_arch=list(hidden))

    def predict(x: Any) -> Any:
        return actor.predict(x, deterministic=True)[0]

    return predict


def usual_mpc(
    horizon: int, seen: Sequence[sm.Observation], config: sm.RunConfig, lap: int
) -> TimingRow:
    """Times of every solve, or a note why there are none."""
    name = f"MPC in CasADi + IPOPT, N = {horizon}"
    if find_spec("casadi") is None:
        return TimingRow(name=name, note=ABSENT)
    solve = _problem(horizon, config.vehicle, sm.make("controller", "mpc_pid"))
    solve(seen[0])
    times = np.empty(len(seen))
    failed = 0
    for k, observation in enumerate(seen):
        begun = time.perf_counter()
        failed += not solve(observation)
        times[k] = time.perf_counter() - begun
    return _row(name, 1e6 * times, lap, extrapolated=True, failed=failed or None)


def _problem(horizon: int, car: sm.Vehicle, gains: Any) -> Any:
    import casadi as ca

    opti = ca.Opti()
    states, inputs = opti.variable(4, horizon + 1), opti.variable(1, horizon)
    start, target = opti.parameter(4), opti.parameter(horizon)
    v, m, inertia = gains.v0, car.mass, car.yaw_inertia

    def rate(x: Any, u: Any) -> Any:
        """[y, beta, psi, psi_dot] of the single-track model."""
        front = car.c_f * (u - x[1] - car.l_f * x[3] / v)
        rear = car.c_r * (-x[1] + car.l_r * x[3] / v)
        turning = (car.l_f * front - car.l_r * rear) / inertia
        return ca.vertcat(v * (x[1] + x[2]), (front + rear) / (m * v) - x[3], x[3], turning)

    cost: Any = 0
    opti.subject_to(states[:, 0] == start)
    for i in range(horizon):
        x, u = states[:, i], inputs[:, i]
        k1 = rate(x, u)
        k2 = rate(x + 0.5 * _DT * k1, u)
        k3 = rate(x + 0.5 * _DT * k2, u)
        k4 = rate(x + _DT * k3, u)
        opti.subject_to(states[:, i + 1] == x + _DT / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4))
        opti.subject_to(opti.bounded(-car.max_wheel_angle, u, car.max_wheel_angle))
        cost += gains.q * (states[0, i + 1] - target[i]) ** 2 + gains.r * u**2
    cost += gains.p * (states[0, horizon] - target[horizon - 1]) ** 2
    opti.minimize(cost)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})

    def solve(o: sm.Observation) -> bool:
        ahead = np.arange(1, horizon + 1) * o.v_x * _DT
        places = np.arange(len(o.preview)) * o.spacing
        opti.set_value(start, [0.0, o.v_y / max(o.v_x, 0.5), 0.0, o.yaw_rate])
        opti.set_value(target, np.interp(ahead, places, o.preview[:, 1]))
        try:
            solution = opti.solve()
        except RuntimeError:
            return False
        opti.set_initial(solution.value_variables())
        return True

    return solve
