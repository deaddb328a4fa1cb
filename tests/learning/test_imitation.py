"""Behaviour cloning and DAgger, small: whose states, whose labels, the fit, files, resume."""

from __future__ import annotations

import csv
import json
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import torch

from steersman.config import build, merge, read_yaml
from steersman.controllers.policy import Policy
from steersman.errors import ConfigError, DataError, TrainingDiverged
from steersman.learning.fleet import FleetDriver
from steersman.learning.imitation.config import FitConfig, ImitationConfig
from steersman.learning.imitation.driving import Drives, Driving, collect
from steersman.learning.imitation.fit import Regression
from steersman.learning.imitation.imitate import imitate
from steersman.learning.least_squares import Dataset, update
from steersman.learning.networks import Draw
from steersman.learning.progress import ImitationRow, learned
from steersman.learning.validate import Validator

from ..loops import Posed, drive
from .problems import SMALL

# Its steering is linear in two features, and it remembers nothing.
LINEAR = {"kind": "pid", "gains": {"k_p": 0.1, "k_i": 0.0, "k_d": 0.0}, "k_heading": 0.5}
K_P, K_HEADING = 0.1, 0.5
TURNED = np.full(1, -1.0)
TINY: dict[str, Any] = {
    "problem": {**SMALL, "action": "direct", "demonstration": {"controller": LINEAR}},
    "rounds": 3,
    "steps": 1200,
    "vehicles": 4,
    "fit": {"hidden": [16, 16], "batch": 64, "updates": 1500},
    "validation": {"roads": [{"kind": "random_road", "seed": 1000}], "vehicles": 2},
}


def config(**changes: Any) -> ImitationConfig:
    return build(ImitationConfig, merge(TINY, changes))


def seed(*numbers: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(numbers)


def quiet(_: float) -> None:
    pass


def rows(folder: FilePath) -> list[dict[str, float]]:
    with (folder / "progress.csv").open(encoding="utf-8") as stream:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(stream)]


def untimed(folder: FilePath) -> list[dict[str, str]]:
    with (folder / "progress.csv").open(encoding="utf-8") as stream:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(stream)]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """An imitation that nothing stopped."""
    folder = tmp_path_factory.mktemp("imitation")
    assert imitate(config(), folder).policy == folder / "policy.onnx"
    return folder


# -------------------------------------------------------------------------------------- driving


def drives(pupil: Any = None, beta: float = 1.0, sigma: float = 0.0, **changes: Any) -> Drives:
    problem = config(problem=changes).problem
    return collect(FleetDriver(problem, 4), Driving(pupil, beta, sigma, 0.15), 60, [5, 6, 7], quiet)


def columns(data: Dataset, *names: str) -> list[Any]:
    problem = config().problem
    where = [problem.layout.names.index(name) for name in names]
    return [data.features[:, i] / problem.layout.scale[i] for i in where]


def to_the_left(features: Any) -> Any:
    return np.full(len(features), 0.2)


@pytest.mark.parametrize(("pupil", "beta"), [(None, 1.0), (to_the_left, 0.0), (to_the_left, 0.5)])
def test_labels_are_the_demonstrators_in_the_state_visited(pupil: Any, beta: float) -> None:
    data = drives(pupil, beta, sigma=0.05).data
    d, heading = columns(data, "lateral_error [m]", "heading_error [rad]")
    expected = np.clip(-K_P * d - K_HEADING * heading, -1.0, 1.0)
    np.testing.assert_allclose(data.actions[:, 0], expected, atol=2e-6)
    assert np.abs(expected).max() > 0.01


def test_the_pupils_states_are_visited() -> None:
    shown, own = drives(), drives(to_the_left, 0.0)
    command, d = columns(own.data, "last_command [-]", "lateral_error [m]")
    # All but the first states of episodes follow the pupil's command; nothing that is shown does.
    assert np.isclose(command, 0.2).mean() > 0.9
    assert not np.isclose(columns(shown.data, "last_command [-]")[0], 0.2).any()
    assert d.max() > 1.0
    assert own.off_track > 0 == shown.off_track
    assert (own.demonstrated, shown.demonstrated) == (0.0, 1.0)


def test_difference_is_that_between_pupil_and_demonstrator() -> None:
    assert np.isnan(drives().difference)
    own = drives(to_the_left, 0.3)
    expected = np.sqrt(np.mean((0.2 - own.data.actions.astype(float)) ** 2))
    assert own.difference == pytest.approx(expected, rel=1e-5)
    assert own.demonstrated == pytest.approx(0.3, abs=0.1)


def test_a_rate_that_was_not_executed_is_labelled_from_what_was() -> None:
    # The label leads from the steering executed last, the pupil's, to the demonstrated one.
    data = drives(to_the_left, 0.0, action="rate").data
    problem = config(problem={"action": "rate"}).problem
    d, heading, last = columns(data, "lateral_error [m]", "heading_error [rad]", "last_command [-]")
    wanted = -K_P * d - K_HEADING * heading
    step = problem.rate_limit * problem.plant.dt
    np.testing.assert_allclose(
        data.actions[:, 0], np.clip((wanted - last) / step, -1, 1), atol=2e-4
    )


def test_a_correction_is_labelled_with_what_the_demonstrator_adds() -> None:
    base = {"kind": "pid", "gains": {"k_p": 0.05, "k_i": 0.0, "k_d": 0.0}}
    data = drives(to_the_left, 0.0, action="residual", base=base, authority=0.5).data
    d, heading = columns(data, "lateral_error [m]", "heading_error [rad]")
    expected = (-(K_P - 0.05) * d - K_HEADING * heading) / 0.5
    np.testing.assert_allclose(data.actions[:, 0], np.clip(expected, -1.0, 1.0), atol=5e-6)


def test_a_demonstrator_that_remembers_is_told_what_was_executed() -> None:
    # It changes its command by at most max_change; left alone it would be far from the pupil's.
    remembers = {"controller": {"kind": "bearing_pid", "max_change": 0.02}}
    data = drives(to_the_left, 0.0, demonstration=remembers).data
    (last,) = columns(data, "last_command [-]")
    following = np.isclose(last, 0.2)
    change = np.abs(data.actions[:, 0] - last)[following]
    assert change.max() < 0.02 + 1e-6
    assert change.min() > 0.0


def test_noise_moves_the_car_and_not_the_labels() -> None:
    still, shaken = drives(), drives(sigma=0.1)
    assert shaken.mean_error > 1.2 * still.mean_error
    assert np.array_equal(still.data.actions[:4], shaken.data.actions[:4])  # the first states


def test_driving_repeats() -> None:
    for first, again in zip(drives(sigma=0.1).data, drives(sigma=0.1).data, strict=True):
        assert np.array_equal(first, again)


# ------------------------------------------------------------------------------------------ fit


def samples(count: int, rng: np.random.Generator, features: int = 5) -> Dataset:
    x = rng.normal(size=(count, features)).astype(np.float32)
    return Dataset(x, np.tanh(x @ np.linspace(-0.4, 0.5, features))[:, None].astype(np.float32))


def fitted(data: Dataset, **changes: Any) -> Regression:
    settings = {"hidden": (32, 32), "updates": 3000, "batch": 64, "mirror": False, **changes}
    regression = Regression(FitConfig(**settings), np.full(5, -1.0), TURNED, seed(0))
    regression.fit(data, regression.config.updates, seed(1), quiet)
    return regression


def test_a_smooth_function_is_learned() -> None:
    rng = np.random.default_rng(0)
    unseen = samples(500, rng)
    rms = np.sqrt(np.mean((fitted(samples(4000, rng)).act(unseen.features) - unseen.actions) ** 2))
    assert rms < 0.04 * unseen.actions.std()


def test_a_large_error_counts_less_for_huber() -> None:
    rng = np.random.default_rng(0)
    data, unseen = samples(4000, rng), samples(500, rng)
    spoilt = data.actions.copy()
    spoilt[rng.random(len(spoilt)) < 0.1] = 1.0

    def error(**changes: Any) -> float:
        own = fitted(Dataset(data.features, spoilt), **changes).act(unseen.features)
        return float(np.sqrt(np.mean((own - unseen.actions) ** 2)))

    assert error(huber=0.02) < 0.5 * error()


def test_what_was_seen_on_one_side_is_known_on_the_other() -> None:
    data = samples(4000, np.random.default_rng(0))
    left = data.features[:, 4] > 0.0
    one_side = Dataset(data.features[left], data.actions[left])

    def error(**changes: Any) -> float:
        own = fitted(one_side, **changes).act(data.features[~left])
        return float(np.sqrt(np.mean((own - data.actions[~left]) ** 2)))

    assert error(mirror=True) < 0.5 * error(mirror=False)


@pytest.mark.parametrize("huber", [None, 0.1])
def test_updates_are_those_of_torch(huber: float | None) -> None:
    rng = np.random.default_rng(2)
    data = samples(300, rng)
    mirror = np.array([1.0, -1.0, 1.0, -1.0, -1.0])
    regression = Regression(
        FitConfig(hidden=(24, 16), batch=32, huber=huber), mirror, TURNED, seed(0)
    )
    parts = [torch.tensor(np.array(part), requires_grad=True) for part in regression.net[:6]]
    optimiser = torch.optim.Adam(parts, lr=1e-3)
    rows_, sides = rng.integers(300, size=(40, 32)), rng.choice([-1.0, 1.0], size=(40, 32))
    expected = 0.0
    for row, side in zip(rows_, sides.astype(np.float32), strict=True):
        x = torch.from_numpy(
            np.where(side[:, None] < 0, data.features[row] * mirror, data.features[row])
        )
        h = x.float()
        for k in (0, 2):
            h = torch.relu(h @ parts[k].T + parts[k + 1])
        own = torch.tanh(h @ parts[4].T + parts[5])
        wanted = torch.from_numpy(data.actions[row] * side[:, None])
        if huber is None:
            loss = torch.nn.functional.mse_loss(own, wanted)
        else:
            loss = 2.0 * torch.nn.functional.huber_loss(own, wanted, delta=huber)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        expected += loss.item() / 40
    sides, factors = sides.astype(np.float32), mirror.astype(np.float32)
    draw = Draw(rows_, np.zeros_like(rows_), sides, factors, TURNED.astype(np.float32))
    bound = np.inf if huber is None else huber
    loss = update(
        data,
        draw,
        np.full(40, 1e-3),
        regression.net,
        regression.moments,
        bound,
        regression._fit.work,
    )
    assert loss == pytest.approx(expected, rel=1e-5)
    for ours, theirs in zip(regression.net[:6], parts, strict=True):
        np.testing.assert_allclose(ours, theirs.detach().numpy(), rtol=2e-4, atol=2e-6)


def test_the_fit_may_be_done_in_parts_of_any_size() -> None:
    data = samples(200, np.random.default_rng(0))
    told: list[float] = []
    regression = Regression(
        FitConfig(hidden=(8, 8), updates=250, batch=8), np.ones(5), TURNED, seed(0)
    )
    assert regression.rate() == 1e-3
    regression.fit(data, 150, seed(1), told.append)
    regression.fit(data, 250, seed(2), told.append)
    assert regression.updates == 250
    assert told == pytest.approx([100 / 150, 1.0, 1.0])
    assert regression.rate() == pytest.approx(1e-5)


# ----------------------------------------------------------------------------------- the whole


def test_a_linear_demonstrator_is_cloned(tmp_path: FilePath) -> None:
    imitate(config(fit={"updates": 6000}, steps=2400), tmp_path)
    last = rows(tmp_path)[-1]
    card = json.loads((tmp_path / "policy.json").read_text(encoding="utf-8"))["training"]
    shown = card["demonstrator_validation"]
    assert last["action_difference"] < 0.01
    assert last["loss"] < 1e-4
    assert card["validation"]["failures"] == shown["failures"]
    assert card["validation"]["mean_error"] == pytest.approx(shown["mean_error"], rel=0.15)


def test_writes_what_a_training_writes(done: FilePath) -> None:
    names = {file.name for file in done.iterdir()}
    assert names == {
        "config.yaml", "progress.csv", "checkpoints", "tensorboard", "policy.onnx", "policy.json",
        "validation.npz",
    }  # fmt: skip
    table = rows(done)
    assert list(table[0]) == list(ImitationRow._fields)
    assert [row["steps"] for row in table] == [400, 800, 1200]
    assert [row["updates"] for row in table] == [500, 1000, 1500]
    assert [row["demo_share"] for row in table] == [1.0, 0.0, 0.0]
    assert build(ImitationConfig, read_yaml(done / "config.yaml")) == config()


def test_card_tells_how_it_came_about(done: FilePath) -> None:
    card = json.loads((done / "policy.json").read_text(encoding="utf-8"))
    training = card["training"]
    assert training["method"] == "dagger"
    assert training["demonstrator"]["kind"] == "pid"
    assert training["simulated_seconds"] == pytest.approx(0.05 * training["steps"])
    assert training["steps"] == 400 * training["rounds"]
    assert build(ImitationConfig, training["config"]) == config()


def test_the_policy_drives(done: FilePath) -> None:
    assert len(drive(Policy(file=str(done / "policy.onnx")), Posed(), duration=2.0)) > 10


def test_the_demonstrators_own_score_is_that_of_its_drives(done: FilePath) -> None:
    validator = Validator(config().problem, config().validation)
    layout = config().problem.layout
    names, scale = layout.names, layout.scale
    i, k = names.index("lateral_error [m]"), names.index("heading_error [rad]")

    def linear(features: Any) -> Any:
        return -K_P * features[:, i] / scale[i] - K_HEADING * features[:, k] / scale[k]

    score = validator.score(linear)
    card = json.loads((done / "policy.json").read_text(encoding="utf-8"))["training"]
    for name, value in score._asdict().items():
        assert card["demonstrator_validation"][name] == pytest.approx(value, abs=1e-6)


def test_behaviour_cloning_never_drives_itself(tmp_path: FilePath) -> None:
    imitate(config(method="bc"), tmp_path)
    assert [row["demo_share"] for row in rows(tmp_path)] == [1.0, 1.0, 1.0]


def test_beta_is_the_demonstrators_share_after_the_first_round(tmp_path: FilePath) -> None:
    imitate(config(beta={"kind": "constant", "at": 0.5}), tmp_path)
    shares = [row["demo_share"] for row in rows(tmp_path)]
    assert shares[0] == 1.0
    assert shares[1:] == pytest.approx([0.5, 0.5], abs=0.1)


def test_same_seed_same_policy(done: FilePath, tmp_path: FilePath) -> None:
    imitate(config(), tmp_path / "again")
    imitate(config(seed=1), tmp_path / "other")
    first, again, other = (
        (folder / "policy.onnx").read_bytes()
        for folder in (done, tmp_path / "again", tmp_path / "other")
    )
    assert again == first != other
    assert untimed(tmp_path / "again") == untimed(done)


class Stopped(Exception):
    """Stands for whatever ends a process."""


@pytest.mark.parametrize("after", [1, 2, 3])
def test_stopped_in_a_round_it_ends_the_same(
    done: FilePath, tmp_path: FilePath, after: int
) -> None:
    def reporter(row: Any) -> None:
        if row.steps >= 400 * after:
            raise Stopped

    with pytest.raises(Stopped):
        imitate(config(), tmp_path, reporter)
    told: list[str] = []
    imitate(config(), tmp_path, resume=True, notify=told.append)
    if after > 1:
        assert told[0] == f"{tmp_path}: going on after {after - 1} of 3 rounds"
    assert told[-1].startswith("pid itself on the validation drives: RMS error ")
    assert (tmp_path / "policy.onnx").read_bytes() == (done / "policy.onnx").read_bytes()
    assert untimed(tmp_path) == untimed(done)
    assert not (tmp_path / "resume").exists()
    assert not list(tmp_path.rglob(".*"))


def test_a_finished_one_says_so(done: FilePath) -> None:
    told: list[str] = []
    imitate(config(), done, resume=True, notify=told.append)
    assert told == [f"{done}: finished already"]


def test_another_configuration_is_not_resumed(done: FilePath) -> None:
    with pytest.raises(ConfigError, match=r"method: 'bc' is given, but .* has 'dagger'"):
        imitate(config(method="bc"), done, resume=True)


def test_an_earlier_one_is_not_overwritten_unasked(done: FilePath) -> None:
    with pytest.raises(DataError, match="holds a training already"):
        imitate(config(), done)


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_a_loss_that_is_not_finite_ends_it(tmp_path: FilePath) -> None:
    rate = {"kind": "constant", "at": 1e30}
    with pytest.raises(TrainingDiverged, match=r"smaller fit\.learning_rate"):
        imitate(config(fit={"learning_rate": rate}), tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"problem": {"demonstration": {"enabled": False}}}, "is false; set it to true"),
        ({"steps": 11}, "3 rounds of 4 vehicles need at least 12 steps, steps is 11"),
        ({"fit": {"updates": 2}}, r"3 rounds need at least as many updates, fit\.updates is 2"),
        ({"method": "dager"}, "must be 'dagger' or 'bc'"),
        ({"agent": {}}, "agent"),
    ],
)
def test_bad_input(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        build(ImitationConfig, merge(TINY, changes))


def test_the_result_is_read_from_its_folder(done: FilePath) -> None:
    result = learned(done, config(), ImitationRow)
    assert [row.steps for row in result.rows] == [400, 800, 1200]
    assert result.best.updates == result.card.training["updates"]
    assert result.best.validation_error_mm == min(row.validation_error_mm for row in result.rows)
