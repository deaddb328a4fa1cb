"""Ways to use a demonstrator: takeover, warm start, imitation loss; alone and together."""

from __future__ import annotations

import csv
import sys
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3 import DDPG, SAC, TD3

from steersman import core_yaml
from steersman.config import build, dump
from steersman.errors import ConfigError, DataError
from steersman.kernels import observe
from steersman.kernels import vehicle as car
from steersman.learning.datasets.recorder import Recorder
from steersman.learning.datasets.store import Stored, write
from steersman.learning.datasets.trajectory import transitions
from steersman.learning.ddpg_update import CompiledDDPG
from steersman.learning.demonstration import Demonstration, ImitationLoss, Takeover, WarmStart
from steersman.learning.imitation.driving import demonstrate
from steersman.learning.imitation_loss import imitate
from steersman.learning.make_off_policy import steering
from steersman.learning.off_policy import OffPolicySteering
from steersman.learning.schedules import Constant
from steersman.learning.train import train
from steersman.learning.vec_env import PathFollowingVecEnv
from steersman.logs.write import write_episode
from steersman.rollout import RunConfig, run

from .problems import problem, tiny
from .test_off_policy import FACTORS, parameters
from .test_off_policy import agent as bare

NEVER = {"kind": "constant", "at": 0.0}
TEACHER: dict[str, Any] = {"controller": {"kind": "lqr"}, "p_action": NEVER}
# All of them at once.
TOGETHER: dict[str, Any] = {
    **TEACHER,
    "p_action": {"kind": "constant", "at": 0.2},
    "takeover": {"lateral_error": 0.2, "side_slip": 0.1, "disagreement": 1.0},
    "warm_start": {"steps": 200, "rounds": 2, "cloning": 60, "updates": 20, "share": 0.25},
    "loss": {"weight": {"kind": "linear", "start": 2.0, "end": 0.0}, "q_filter": True},
}


def driven(steps: int, kind: str = "ddpg", **changes: Any) -> tuple[Any, PathFollowingVecEnv]:
    """An agent after so many steps of learning, and its vehicles."""
    shown = {**TEACHER, **changes.pop("demonstration", {})}
    given = changes.pop("problem", {})
    config = tiny(
        problem={**given, "demonstration": shown},
        agent={"kind": kind, "vehicles": 4, "hidden": [16, 16], "buffer": 4000, "batch": 32,
               "updates": 1, "learning_starts": 0, **changes.pop("agent", {})},
        **changes,
    )  # fmt: skip
    env = PathFollowingVecEnv(config.problem, 4)
    made: Any = config.agent.make(config, env)
    made.learn(steps)
    return made, env


# ---------------------------------------------------------------------------------- the loss


def labelled(cls: Any, loss: ImitationLoss, mirror: Any = None) -> Any:
    made = bare(cls)
    made.prepare_demonstration(Demonstration(loss=loss), None, 1, 0)
    rng = np.random.default_rng(7)
    labels = rng.uniform(-1.0, 1.0, made.buffer.demonstrated.shape)
    made.buffer.demonstrated[:] = np.where(rng.random((*labels.shape[:2], 1)) < 0.5, labels, np.nan)
    made.mirror = made.buffer.mirror = mirror
    return made


@pytest.mark.parametrize("q_filter", [False, True])
def test_the_compiled_loss_is_that_of_torch(q_filter: bool) -> None:
    """Two implementations: written out in compiled code, and by autograd before SB3's own step."""
    loss = ImitationLoss(weight=Constant(at=3.0), q_filter=q_filter)
    ours, theirs = (labelled(cls, loss, FACTORS) for cls in (CompiledDDPG, steering(DDPG)))
    plain = bare(CompiledDDPG)
    plain.buffer.mirror = FACTORS
    for made in (ours, theirs, plain):
        # One update at a time: SB3 draws which samples are mirrored after each batch.
        np.random.seed(11)  # noqa: NPY002
        for _ in range(5):
            made.train(1, 32)
    a, b, without = parameters(ours), parameters(theirs), parameters(plain)
    for name in a:
        assert a[name] == pytest.approx(b[name], rel=1e-3, abs=2e-5), name
    moved = [np.abs(a[name] - without[name]).max() for name in a if name.startswith("actor.")]
    assert max(moved) > 1e-3


@pytest.mark.parametrize("algorithm", [TD3, SAC])
@pytest.mark.parametrize("q_filter", [False, True])
def test_the_gradients_of_both_losses_add_up(algorithm: Any, q_filter: bool) -> None:
    made = labelled(steering(algorithm), ImitationLoss())
    made.buffer.sample(32)
    seen, wanted = made.buffer.last
    actor = made.policy.actor
    own = made.policy._predict(seen, deterministic=True)
    actor.optimizer.zero_grad()
    (own.sum()).backward(retain_graph=True)
    before = {name: p.grad.clone() for name, p in actor.named_parameters() if p.grad is not None}
    imitate(made.policy, made.critic, (seen, wanted), 2.0, q_filter=q_filter)
    counts = ~torch.isnan(wanted)
    if q_filter:
        rated = [
            torch.stack([q for q in made.critic(seen, a)]).min(dim=0)[0]
            for a in (torch.nan_to_num(wanted), own)
        ]
        counts &= rated[0] > rated[1]
        assert counts.any()
        assert not counts.all()
    loss = sum((own[k] - wanted[k]) ** 2 for k in torch.where(counts)[0]) * 2.0 / 32
    for name, p in actor.named_parameters():
        if name in before:
            (more,) = torch.autograd.grad(loss, p, retain_graph=True)
            assert p.grad.numpy() == pytest.approx((before[name] + more).numpy(), abs=1e-6)


def test_an_actor_with_a_heavy_loss_imitates() -> None:
    heavy = {"weight": {"kind": "constant", "at": 100.0}}
    gaps = []
    for loss in (None, heavy):
        made, _ = driven(1200, demonstration={"loss": loss})
        size = made.buffer.pos
        own = made.act(made.buffer.observations[:size].reshape(size * 4, -1))
        gaps.append(np.abs(own[:, 0] - made.buffer.demonstrated[:size].ravel()).mean())
    assert gaps[1] < 0.7 * gaps[0]


@pytest.mark.parametrize(("states", "share"), [("all", 1.0), ("executed", 0.5)])
def test_which_states_have_a_demonstrated_action(states: str, share: float) -> None:
    half = {"p_action": {"kind": "constant", "at": 0.5}, "loss": {"states": states}}
    made, _ = driven(400, demonstration=half)
    buffer = made.buffer
    known = np.isfinite(buffer.demonstrated[: buffer.pos])
    assert known.mean() == pytest.approx(share, abs=0.1)
    same = buffer.demonstrated[: buffer.pos] == buffer.actions[: buffer.pos]
    assert same[known].mean() > 0.4


# --------------------------------------------------------------------------------- takeover


def test_the_demonstrator_hands_back_later_than_it_takes_over() -> None:
    rule = Takeover(lateral_error=1.0, side_slip=0.2, disagreement=None, hand_back=0.5)
    zero = np.zeros(5)
    lateral = np.array([-1.1, 0.9, 0.0, -0.4, 0.0])
    slip = np.array([0.0, 0.0, 0.21, 0.0, -0.11])
    gap = np.full(5, 2.0)
    free, taken = zero > 0.0, zero == 0.0
    assert rule.judged(free, lateral, slip, gap).tolist() == [True, False, True, False, False]
    assert rule.judged(taken, lateral, slip, gap).tolist() == [True, True, True, False, True]
    apart = Takeover(lateral_error=None, disagreement=1.5)
    assert apart.judged(free, lateral, slip, gap).all()
    assert not apart.judged(free, lateral, slip, np.full(5, np.nan)).any()


def test_a_takeover_keeps_a_bad_agent_on_the_road() -> None:
    """An agent that steers to one side alone leaves the corridor of 1.5 m again and again."""
    lost, shares = [], []
    for takeover in (None, {"lateral_error": 0.4, "hand_back": 0.5}):
        config = tiny(
            problem={"demonstration": {**TEACHER, "takeover": takeover}, "action": "direct"},
            agent={"learning_starts": 0, "updates": 0, "noise": NEVER},
        )
        env = PathFollowingVecEnv(config.problem, 4)
        made: Any = config.agent.make(config, env)
        net = made.actor_net()
        net.w3[:], net.b3[:] = 0.0, 0.1
        made.learn(1600)
        lost.append(env.off_track)
        shares.append(made.demonstrated_steps / made.sampled_steps)
        acted = made.buffer.actions[: made.buffer.pos, :, 0]
        shown = made.buffer.demonstrated[: made.buffer.pos, :, 0]
        own = np.float32(np.tanh(np.float32(0.1)))
        assert ((acted == shown) | (abs(acted - own) < 1e-6)).all()
    assert lost[0] > 5
    assert lost[1] == 0
    assert shares[0] == 0.0
    assert 0.05 < shares[1] < 0.95


# -------------------------------------------------------------------------------- warm start


def test_first_the_demonstrator_drives_with_noise() -> None:
    warm = {"warm_start": {"steps": 400, "noise": 0.05}}
    made, _ = driven(800, demonstration=warm)
    acted = made.buffer.actions[:, :, 0]
    gap = acted - made.buffer.demonstrated[:, :, 0]
    inside = abs(acted[:100]) < 1.0
    assert gap[:100][inside].std() == pytest.approx(0.05, rel=0.2)
    assert abs(gap[100:200]).mean() > 0.1
    assert made.demonstrated_steps == 400
    assert made._n_updates == 100  # one for each step after the warm start, none before


@pytest.mark.parametrize("kind", ["td3", "sac"])
def test_cloning_and_updates_before_the_training(kind: str) -> None:
    fits = []
    for cloning in (0, 300):
        warm = {"steps": 400, "rounds": 2, "cloning": cloning, "updates": 3}
        made, _ = driven(400, kind, demonstration={"warm_start": warm})
        made.opening.advance(made)
        assert made._n_updates == 3
        assert made.opened == 3
        assert made.demonstrated_steps == 200  # the second round is the agent's
        size = made.buffer.pos
        own = made.act(made.buffer.observations[:size].reshape(size * 4, -1))
        fits.append(np.square(own[:, 0] - made.buffer.demonstrated[:size].ravel()).mean())
        if kind != "sac":
            target = dict(made.policy.actor_target.named_parameters())
            pairs = [(p, target[n]) for n, p in made.policy.actor.named_parameters()]
            assert all(torch.allclose(a, b, atol=5e-3) for a, b in pairs)
    assert fits[1] < 0.5 * fits[0]


def test_a_validation_at_the_end_of_the_warm_start_judges_the_cloned_policy(
    tmp_path: FilePath,
) -> None:
    """In the middle of a training, and where the warm start is all of it."""
    for steps in (800, 400):
        errors = []
        for cloning in (0, 3000):
            warm = {"steps": 400, "cloning": cloning}
            config = tiny(
                problem={"demonstration": {**TEACHER, "warm_start": warm}},
                validation={"interval": 400},
                steps=steps,
                checkpoint_interval=steps,
            )
            result = train(config, tmp_path / f"{steps}_{cloning}")
            assert [row.steps for row in result.rows] == list(range(400, steps + 1, 400))
            errors.append(result.rows[0].validation_error_mm)
        assert errors[1] < 0.95 * errors[0]


def test_demonstrations_stay_and_have_their_share() -> None:
    warm = {"warm_start": {"steps": 200, "share": 0.25}}
    made, _ = driven(800, agent={"buffer": 600}, demonstration=warm)
    buffer = made.buffer
    assert buffer.full
    assert buffer.kept == 50
    first = buffer.demonstrated[:50].copy()
    other, _ = driven(200, demonstration=warm)
    assert np.array_equal(first, other.buffer.demonstrated[:50])
    rows = buffer.draw(200, 32).rows
    assert (rows[:, :8] < 50).all()
    assert 0.2 < (rows[:, 8:] < 50).mean() < 0.5


def test_a_recorded_drive_is_what_the_agent_would_have_stored() -> None:
    """Features, actions, rewards and demonstrated actions of a training, from its recording."""
    config = tiny(
        problem={"demonstration": {**TEACHER, "p_action": {"kind": "constant", "at": 0.5}},
                 "episode_time": 100.0, "roads": [{"kind": "circle", "radius": 40.0}],
                 "spread": {"offset": 0.0, "heading": 0.0}},
        agent={"learning_starts": 0, "updates": 0, "vehicles": 1},
    )  # fmt: skip
    env = PathFollowingVecEnv(config.problem, 1)
    made: Any = config.agent.make(config, env)
    env.recorder = Recorder(env.driver)
    made.learn(60)
    columns = transitions(config.problem, env.recorder.take()[0])
    count = len(columns["rewards"])
    for name, values in columns.items():
        kept = getattr(made.buffer, name)[:count].reshape(values.shape)
        assert values == pytest.approx(kept, abs=2e-6), name
    assert np.abs(columns["rewards"]).max() > 0.1


def test_a_recorded_driver_demonstrates(tmp_path: FilePath) -> None:
    pytest.importorskip("minari")
    shown = problem(demonstration=TEACHER)
    drives = demonstrate(shown, 400, 0, vehicles=4)
    place = str(write(tmp_path, "driver", Stored(shown, drives, "test")))
    warm = {"data": place, "cloning": 400, "updates": 10, "share": 0.5}
    recorded = {"enabled": False, "warm_start": warm, "loss": {}}
    made, _ = driven(40, demonstration=recorded)
    buffer = made.buffer
    assert 90 <= buffer.kept <= 100
    assert np.isfinite(buffer.demonstrated[: buffer.kept]).all()
    assert np.isnan(buffer.demonstrated[buffer.kept : buffer.pos]).all()
    assert made._n_updates == 10 + 10
    own = made.act(buffer.observations[: buffer.kept].reshape(buffer.kept * 4, -1))
    apart = np.abs(own[:, 0] - buffer.demonstrated[: buffer.kept].ravel()).mean()
    assert apart < 0.5 * np.abs(buffer.demonstrated[: buffer.kept]).mean()
    made.buffer.buffer_size, made.opened = 20, 0
    with pytest.raises(DataError, match=r"holds \d+ steps; .* as agent.buffer has room for 80"):
        made.opening.advance(made)


def test_a_recording_of_a_drive_demonstrates(tmp_path: FilePath) -> None:
    """Nothing but an MCAP file is left of the driver."""
    settings = {"path": {"kind": "circle", "radius": 40.0}, "controller": "lqr", "duration": 6.0,
                "speed": {"kind": "constant_speed", "speed": 8.0}}  # fmt: skip
    ran = build(RunConfig, settings)
    file = tmp_path / "drive.mcap"
    write_episode(file, run(ran), ran.vehicle.table, ran.path)
    warm = {"data": str(file), "share": 0.5}
    made, _ = driven(8, demonstration={"enabled": False, "warm_start": warm, "loss": {}})
    kept = made.buffer.demonstrated[: made.buffer.kept]
    assert kept.size >= 100
    assert np.array_equal(kept, made.buffer.actions[: made.buffer.kept])
    assert made.buffer.rewards[: made.buffer.kept].mean() > 0.5  # it drove well


def test_a_program_outside_demonstrates() -> None:
    command = [sys.executable, "-I", "-S", str(FilePath(__file__).parents[1] / "outside.py")]
    program = {"controller": {"kind": "process", "command": command}}
    made, env = driven(200, demonstration={**program, "warm_start": {"steps": 200, "noise": 0.0}})
    assert made.demonstrated_steps == 200
    assert env.off_track == 0
    assert np.ptp(made.buffer.demonstrated[: made.buffer.pos]) > 0.1


def test_where_nobody_shows_anything_the_agent_drives(tmp_path: FilePath) -> None:
    """Every second step has no demonstration: it is not executed, not learned, not rewarded."""
    file = tmp_path / "half.py"
    file.write_text(
        "import json, sys\n"
        "for k, line in enumerate(sys.stdin):\n"
        "    print(json.dumps({'steer': None if k % 2 else 0.02}), flush=True)\n",
        encoding="utf-8",
    )
    program = {"controller": {"kind": "process", "command": ["python", str(file)]}}
    shown = {**program, "p_action": {"kind": "constant", "at": 1.0}, "takeover": {}}
    made, _ = driven(60, demonstration=shown)
    labels = made.buffer.demonstrated[: made.buffer.pos, :, 0]
    assert 0.3 < np.isfinite(labels).mean() < 0.7
    assert made.demonstrated_steps == np.isfinite(labels).sum()
    assert np.isfinite(made.buffer.rewards[: made.buffer.pos]).all()
    assert np.isfinite(made.buffer.actions[: made.buffer.pos]).all()


# ---------------------------------------------------------------------------------- together


@pytest.mark.parametrize(("kind", "until"), [("ddpg", (120, 240, 420)), ("sac", (240,))])
def test_all_together_resume_to_the_bit(
    kind: str, until: tuple[int, ...], tmp_path: FilePath
) -> None:
    config = tiny(
        problem={"demonstration": TOGETHER},
        agent={"kind": kind, "vehicles": 4, "hidden": [16, 16], "buffer": 480, "batch": 32,
               "updates": 1, "learning_starts": 100, "mirror": True},
        validation={"interval": 100}, steps=600 if kind == "ddpg" else 300,
        checkpoint_interval=100,
    )  # fmt: skip
    train(config, tmp_path / "whole")
    for pause in (*until, None):
        train(config, tmp_path / "parts", resume=True, until=pause)
    whole, parts = (rows(tmp_path / name) for name in ("whole", "parts"))
    assert whole == parts
    ours, theirs = ((tmp_path / n / "policy.onnx").read_bytes() for n in ("whole", "parts"))
    assert ours == theirs
    assert float(whole[2]["demo_share"]) > 0.2


def rows(folder: FilePath) -> list[dict[str, str]]:
    with (folder / "progress.csv").open(encoding="utf-8") as stream:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(stream)]


def test_what_an_algorithm_cannot_take_is_said() -> None:
    for kind in ("ppo", "apg"):
        for name, value in (("takeover", {}), ("loss", {}), ("warm_start", {"steps": 100})):
            shown = {**TEACHER, name: value}
            off = f"ddpg, {'dqn, ' * (name == 'takeover')}sac, td3 take this option"
            with pytest.raises(ConfigError, match=rf"demonstration\.{name}: {kind} learns.*{off}"):
                tiny(problem={"demonstration": shown}, agent={"kind": kind})
    for given, message in (
        ({"warm_start": {}}, "there are no demonstrations; give steps > 0, or name data"),
        ({"warm_start": {"steps": 1501}}, r"steps: 1501 is not allowed; .* at most 1500 \[steps\]"),
        ({"warm_start": {"steps": 5, "rounds": 6}}, "rounds: 6 rounds need as many steps"),
        ({"enabled": False, "takeover": {}}, "takeover: needs a demonstrator; set enabled=true"),
        ({"enabled": False, "loss": {}}, "loss: needs a demonstrator; set enabled=true"),
    ):
        with pytest.raises(ConfigError, match=message):
            tiny(problem={"demonstration": {**TEACHER, **given}})


def test_observations_stay_those_of_the_road() -> None:
    """Whatever demonstrates, what is stored is what the car did."""
    made, env = driven(400, demonstration=TOGETHER)
    assert isinstance(made, OffPolicySteering)
    assert np.abs(env.driver.fleet.tracking[:, observe.D]).max() < 1.5
    buffer = made.buffer
    n = buffer.pos - 1
    joined = (buffer.next_observations[:n] == buffer.observations[1 : n + 1]).all(axis=2)
    assert joined[buffer.dones[:n] == 0.0].all()


# -------------------------------------------------------------------------------- privileged

# Cars, delays and sensors that differ, so that there is something to know.
UNKNOWN: dict[str, Any] = {
    "nominal": {"kind": "carla_model3", "mass": 1200.0},
    "sensor": {"error_range": 0.2, "speed_noise": 0.2, "latency": 0.1},
    "spread": {"mass": 0.3, "stiffness": 0.3, "delay": 0.2, "steer_bias": 0.02, "slippery": 0.5,
               "offset": 0.0, "heading": 0.0},
    "roads": [{"kind": "random_road", "seed": 1}],
}  # fmt: skip


def test_a_privileged_demonstrator_knows_the_car_and_sees_the_truth() -> None:
    shown = {**TEACHER, "controller": {"kind": "mpc_delay", "horizon": 5}, "privileged": True}
    env = PathFollowingVecEnv(problem(**UNKNOWN, demonstration=shown), 3)
    env.reset()
    driver = env.driver
    truth: Any = driver._demonstrator._truth  # type: ignore[union-attr]
    controllers = [driver._demonstrator._begun[n][0] for n in range(3)]  # type: ignore[union-attr]
    for n in range(3):
        row, true = truth.car(n).row(), driver.world.vehicles.rows[n]
        for column in (car.MASS, car.C_F, car.C_R, car.MU, car.STEER_UP, car.STEER_BIAS):
            assert row[column] == pytest.approx(true[column], rel=1e-9)
        assert controllers[n].delay == pytest.approx(driver.fleet.delay[n] * driver.world.h)
        seen, measured = truth.observation(n), driver.simulation.observation(n)
        state, place = driver.fleet.state[n], driver.fleet.tracking[n]
        assert seen.v_x == state[car.VX]
        assert seen.lateral_error == place[observe.D]
        assert seen.lateral_error != measured.lateral_error
    assert len({truth.car(n).mass for n in range(3)}) == 3


def test_privilege_pays() -> None:
    """Driven through the problem's own action on cars that differ, it errs less."""
    errors = []
    for privileged in (False, True):
        shown = {**TEACHER, "controller": "predicted/tuned/lqr", "privileged": privileged}
        env = PathFollowingVecEnv(problem(**UNKNOWN, demonstration=shown, action="direct"), 6)
        env.reset()
        for _ in range(60):
            env.step(env.demonstrated_actions()[:, None])
        errors.append(env.sum_error / env.steps)
    assert errors[1] < 0.7 * errors[0]


def test_a_privileged_demonstrator_resumes_to_the_bit() -> None:
    shown = {**TEACHER, "controller": {"kind": "mpc_delay", "horizon": 5}, "privileged": True}
    made = [PathFollowingVecEnv(problem(**UNKNOWN, demonstration=shown), 2) for _ in range(2)]
    first, second = made
    first.reset()
    for k in range(45):
        first.step(np.full((2, 1), 0.3 * (-1) ** (k // 5)))
    second.reset()
    second.restore(first.snapshot())
    for _ in range(45):
        a, b = (env.demonstrated_actions() for env in made)
        assert np.array_equal(a, b)
        for env in made:
            env.step(a[:, None])


def test_the_page_has_the_defaults() -> None:
    page = FilePath(__file__).parents[2] / "docs" / "demonstration.md"
    text = page.read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    given = core_yaml.load(text)["problem"]["demonstration"]
    warm = {**(dump(WarmStart(steps=1)) or {}), "steps": 0}
    groups = {"takeover": dump(Takeover()), "warm_start": warm, "loss": dump(ImitationLoss())}
    assert given == groups
