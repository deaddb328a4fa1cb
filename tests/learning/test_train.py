"""A training from end to end, small: files, determinism, alarms."""

from __future__ import annotations

import csv
import json
import math
import tempfile
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman import presets
from steersman.config import build, read_yaml
from steersman.controllers.policy import Policy
from steersman.errors import ConfigError, DataError, TrainingDiverged
from steersman.learning.config import TrainConfig, load_preset, train_config
from steersman.learning.progress import TrainRow, check_progress, load_training
from steersman.learning.train import train
from steersman.learning.validate import Validator

from ..loops import Posed, drive
from .problems import problem, tiny


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Folder of a small training, which leaves nothing elsewhere."""
    folder, elsewhere = tmp_path_factory.mktemp("train"), tmp_path_factory.mktemp("elsewhere")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(elsewhere))
        assert train(tiny(), folder).policy == folder / "policy.onnx"
    assert not list(elsewhere.iterdir())
    return folder


def rows(folder: FilePath) -> list[dict[str, float]]:
    with (folder / "progress.csv").open(encoding="utf-8") as stream:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(stream)]


def test_writes_everything(trained: FilePath) -> None:
    names = {file.name for file in trained.iterdir()}
    assert names >= {
        "config.yaml", "progress.csv", "checkpoints", "tensorboard", "policy.onnx", "policy.json",
    }  # fmt: skip
    assert list((trained / "tensorboard").glob("events.*"))
    assert not [name for name in names if name.startswith(".")]


def test_resolved_configuration_reads_back(trained: FilePath) -> None:
    assert build(TrainConfig, read_yaml(trained / "config.yaml")) == tiny()


def test_progress_has_a_row_for_each_validation(trained: FilePath) -> None:
    table = rows(trained)
    assert list(table[0]) == list(TrainRow._fields)
    assert [row["steps"] for row in table] == [500, 1000, 1500]
    assert all(math.isfinite(row["critic_loss"]) for row in table[1:])
    assert table[-1]["updates"] == pytest.approx((1500 - 200) / 4, abs=1)
    assert table[0]["demo_share"] == pytest.approx(0.2, abs=0.08)


def test_checkpoints_hold_all_weights(trained: FilePath) -> None:
    files = sorted((trained / "checkpoints").iterdir())
    assert [file.name for file in files] == ["step_000001000.npz", "step_000001500.npz"]
    with np.load(files[-1], allow_pickle=False) as data:
        assert set(data) >= {"actor", "critic", "actor_target", "critic_target", "actor_first"}
        assert all(np.isfinite(data[name]).all() for name in data)


def test_card_tells_where_the_policy_comes_from(trained: FilePath) -> None:
    card = json.loads((trained / "policy.json").read_text(encoding="utf-8"))
    assert card["dt"] == 0.05
    assert card["action"] == "rate"
    assert card["seed"] == 0
    assert {"torch", "stable-baselines3"} <= set(card["versions"])
    assert build(TrainConfig, card["training"]["config"]) == tiny()
    assert len(card["observation"]) == len(card["scale"])
    scored = card["training"]["validation"]["total"]
    assert scored == pytest.approx(min(row["validation_score"] for row in rows(trained)), abs=1e-6)
    best = min(row["validation_error_mm"] for row in rows(trained))
    assert 1e3 * card["training"]["validation"]["mean_error"] == pytest.approx(best, rel=1e-3)


def test_the_policy_drives(trained: FilePath) -> None:
    episode = drive(Policy(file=str(trained / "policy.onnx")), Posed(), duration=2.0)
    assert len(episode) > 10


def test_same_seed_same_policy(trained: FilePath, tmp_path: FilePath) -> None:
    train(tiny(), tmp_path / "again")
    train(tiny(seed=1), tmp_path / "other")
    first, again, other = (
        (folder / "policy.onnx").read_bytes()
        for folder in (trained, tmp_path / "again", tmp_path / "other")
    )
    assert again == first
    assert other != first
    untimed = [{k: v for k, v in row.items() if k != "seconds"} for row in rows(trained)]
    for row, ours in zip(rows(tmp_path / "again"), untimed, strict=True):
        assert all(row[k] == v or math.isnan(v) for k, v in ours.items())


def test_reporter_gets_each_row(tmp_path: FilePath) -> None:
    told: list[TrainRow] = []
    train(tiny(steps=600), tmp_path, told.append)
    assert [row.steps for row in told] == [500, 600]


def test_folder_that_cannot_be_made(tmp_path: FilePath) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(DataError, match="cannot be made"):
        train(tiny(), tmp_path / "file" / "run")


def test_an_earlier_training_is_not_overwritten_unasked(trained: FilePath) -> None:
    before = (trained / "policy.onnx").read_bytes()
    with pytest.raises(DataError, match="holds a training already"):
        train(tiny(seed=2), trained)
    assert (trained / "policy.onnx").read_bytes() == before
    assert build(TrainConfig, read_yaml(trained / "config.yaml")) == tiny()


def test_overwriting_leaves_nothing_of_the_earlier_training(tmp_path: FilePath) -> None:
    train(tiny(steps=900), tmp_path)
    train(tiny(steps=400), tmp_path, overwrite=True)
    assert [row["steps"] for row in rows(tmp_path)] == [400]
    assert [file.name for file in (tmp_path / "checkpoints").iterdir()] == ["step_000000400.npz"]


def test_presets_are_valid() -> None:
    assert "demo" in presets.names()
    for name in presets.names():
        train_config(load_preset(name))
    with pytest.raises(ConfigError, match="did you mean 'demo'"):
        load_preset("dmeo")


# --------------------------------------------------------------------------------------- alarms


def row(**changes: float) -> TrainRow:
    calm = TrainRow(updates=100, actor_loss=0.1, critic_loss=0.1, q_mean=1.0, saturated_share=0.1)
    return calm._replace(**changes)


def alarm(*history: TrainRow, gamma: float = 0.95, reward: float = 1.0) -> None:
    check_progress(tiny(agent={"gamma": gamma}), history, reward)


@pytest.mark.parametrize("name", ["actor_loss", "critic_loss", "q_mean"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_loss_that_is_not_finite_stops(name: str, value: float) -> None:
    with pytest.raises(TrainingDiverged, match=r"not finite after 100 .* agent\.learning_rate"):
        alarm(row(**{name: value}))


def test_value_beyond_any_reward_stops() -> None:
    alarm(row(q_mean=199.0))
    with pytest.raises(TrainingDiverged, match=r"mean Q is -201, .*agent\.gamma"):
        alarm(row(q_mean=-201.0))


def test_action_that_stays_on_its_limit_stops() -> None:
    stuck = row(saturated_share=0.97)
    alarm(stuck, stuck)
    alarm(row(), stuck, stuck)
    with pytest.raises(TrainingDiverged, match=r"95 % of the last 1500 steps"):
        alarm(stuck, stuck, stuck)


def test_a_reward_that_is_not_finite_is_no_matter_of_the_learning_rate() -> None:
    with pytest.raises(TrainingDiverged, match=r"a reward is nan; .* terms of problem\.task"):
        alarm(row(updates=0, actor_loss=math.nan), reward=math.nan)


def test_before_the_first_update_there_is_no_loss() -> None:
    none = {"actor_loss": math.nan, "critic_loss": math.nan, "q_mean": math.nan}
    alarm(row(updates=0, **none))
    with pytest.raises(TrainingDiverged, match="not finite"):
        alarm(row(updates=1, **none))


def test_a_training_that_diverges_keeps_its_table(tmp_path: FilePath) -> None:
    wild = tiny(agent={"learning_rate": {"kind": "constant", "at": 1e12}, "updates": 4}, steps=4000)
    with pytest.raises(TrainingDiverged) as caught:
        train(wild, tmp_path)
    assert "\n" not in str(caught.value)
    assert rows(tmp_path)
    assert (tmp_path / "config.yaml").is_file()


# ----------------------------------------------------------------------------------- validation


def test_validation_drives_the_same_every_time() -> None:
    validator = Validator(problem(), tiny().validation)
    steer = np.full(2, 0.01)
    first, other = (validator.score(lambda _, s=s: s * steer) for s in (1.0, -1.0))
    assert validator.score(lambda _: steer) == first
    assert other != first


def test_failures_are_charged_and_counted() -> None:
    validator = Validator(problem(), tiny().validation)
    score = validator.score(lambda _: np.full(2, 0.2))
    assert score.failures == 2
    assert 0.5 < score.mean_error <= 1.5
    assert score.steer_activity > 0.0
    assert score.total > score.mean_error  # failures multiply


def test_the_best_policy_can_be_the_one_of_the_smallest_rms_error_and_activity() -> None:
    config = tiny(validation={"select": "rms", "steer_weight": 3.0}).validation
    score = Validator(problem(), config).score(lambda _: np.full(2, 0.01))
    assert score.total == pytest.approx(score.rms_error + 3.0 * score.steer_activity)


def test_actions_that_are_nan_cost_the_whole_corridor() -> None:
    score = Validator(problem(), tiny().validation).score(lambda _: np.full(2, math.nan))
    assert math.isfinite(score.total)
    assert score.mean_error > 1.0


# --------------------------------------------------------------------------------------- result


def test_the_result_is_read_from_its_folder(trained: FilePath) -> None:
    result = load_training(trained)
    assert (result.config, result.seed, result.version) == (tiny(), 0, 1)
    assert [row.steps for row in result.rows] == [500, 1000, 1500]
    assert result.best.steps == result.card.training["steps"]
    assert result.best in result.rows
    assert result.seconds == result.rows[-1].seconds > 0.0
    assert FilePath(result) == result.policy == trained / "policy.onnx"


def test_a_record_of_another_version_is_read(trained: FilePath, tmp_path: FilePath) -> None:
    """A column less is NaN, a column more is dropped, and an empty cell is no number."""
    for name in ("config.yaml", "policy.onnx", "policy.json"):
        (tmp_path / name).write_bytes((trained / name).read_bytes())
    table = [{k: v for k, v in row.items() if k != "learning_rate"} for row in rows(trained)]
    lines = [[*table[0], "later"], *([*row.values(), ""] for row in table)]
    text = "\n".join(",".join(map(str, line)) for line in lines)
    (tmp_path / "progress.csv").write_text(text, encoding="utf-8")
    result = load_training(tmp_path)
    assert math.isnan(result.rows[0].learning_rate)
    assert result.best.steps == load_training(trained).best.steps


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("steps,updates\n", "holds no row"),
        ("steps,updates\n1,many\n", "not a record of a training .*many"),
        (None, "cannot be read"),
    ],
)
def test_a_record_that_is_none_is_named(
    trained: FilePath, tmp_path: FilePath, text: str | None, message: str
) -> None:
    (tmp_path / "config.yaml").write_bytes((trained / "config.yaml").read_bytes())
    if text is not None:
        (tmp_path / "progress.csv").write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=rf"progress\.csv: {message}"):
        load_training(tmp_path)


def test_a_training_without_an_update_says_so(tmp_path: FilePath) -> None:
    told: list[str] = []
    train(tiny(steps=40, agent={"learning_starts": 500}), tmp_path, notify=told.append)
    assert told[-1].endswith("no update was made in 40 steps (agent.learning_starts is 500)")
