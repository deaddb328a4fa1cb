"""Somebody else's models: read without unpickling, refused with the reason, driven."""

from __future__ import annotations

import json
import pickle
from pathlib import Path as FilePath
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

import steersman as sm
from steersman.config import build
from steersman.delivery.graph import read_network
from steersman.errors import ConfigError, DataError
from steersman.learning.adopt import Adoption, adopt_policy, adoption
from steersman.learning.sb3_file import read_actor
from steersman.network_file import PolicyNetwork
from steersman.policy_file import locate

from .sb3_model import BOX, LINEAR, LIST, model


class Nothing(gymnasium.Env[Any, Any]):
    """Spaces for a model."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
    action_space = gymnasium.spaces.Box(-0.5, 0.7, (1,), np.float32)


@pytest.mark.parametrize("kind", ["PPO", "TD3", "SAC"])
def test_a_model_of_sb3_acts_as_before(kind: str, tmp_path: FilePath) -> None:
    import stable_baselines3

    more: dict[str, Any] = {} if kind == "PPO" else {"buffer_size": 1}
    chosen = {"net_arch": [5], "activation_fn": torch.nn.ELU if kind == "TD3" else torch.nn.Tanh}
    theirs = getattr(stable_baselines3, kind)(
        "MlpPolicy", Nothing(), device="cpu", seed=1, policy_kwargs=chosen, **more
    )
    theirs.save(tmp_path / "theirs.zip")
    wanted = build(Adoption, {"encoding": LIST, "limits": [0.4, -0.8], "scale": [1.0, 2.0, 3.0]})
    file = adopt_policy(tmp_path / "theirs.zip", wanted, tmp_path)
    ours = PolicyNetwork(file.read_bytes(), "ours", 3)
    rng = np.random.default_rng(0)
    for seen in rng.normal(0.0, 3.0, (20, 3)).astype(np.float32):
        action, _ = theirs.predict(seen * np.array([1.0, 2.0, 3.0], np.float32), deterministic=True)
        share = (float(action[0]) + 0.5) / 1.2
        assert ours(seen[None, :])[0] == pytest.approx(0.4 - 1.2 * share, abs=2e-6)


@pytest.fixture(scope="module")
def adopted(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("adopted")
    (folder / "theirs.zip").write_bytes(model())
    return sm.adopt(folder / "theirs.zip", out=folder, encoding=LIST)


def test_the_check_drive_is_told_and_the_card_says_where_it_comes_from(adopted: Any) -> None:
    assert adopted.episode.completed
    assert str(adopted).startswith(
        "check drive, figure_eight at 6 m/s: stayed on the road after 30"
    )
    assert sm.summarise(adopted.episode)["mean_abs_lateral_error_m"] < 0.5
    card = json.loads(adopted.file.with_suffix(".json").read_text())
    assert card["observation"] == [
        *("lateral_error [m]", "heading_error [rad]", "road_curvature_0m [1/m]"),
    ]
    assert card["training"]["adopted"] == "theirs.zip"
    assert read_network(adopted.file.read_bytes(), "ours").layers[0].weights.shape == (1, 3)


def test_a_model_of_our_environment_says_what_it_reads(tmp_path: FilePath) -> None:
    from stable_baselines3 import PPO

    problem = {"action": "direct", "encoding": LIST, "plant": {"dt": 0.1}}
    env = gymnasium.make("steersman/PathFollowing-v0", problem=problem)
    theirs = PPO("MlpPolicy", env, device="cpu", n_steps=2, batch_size=2, seed=0)
    theirs.save(tmp_path / "theirs.zip")
    file = sm.adopt(tmp_path / "theirs.zip", out=tmp_path).file
    card, layout = json.loads(file.with_suffix(".json").read_text()), env.unwrapped.problem.layout
    assert (card["dt"], card["action"], card["scale"]) == (0.1, "direct", layout.scale.tolist())
    raw = np.array([[0.3, -0.1, 0.01]], np.float32)
    expected, _ = theirs.predict((raw * layout.scale).astype(np.float32), deterministic=True)
    assert PolicyNetwork(file.read_bytes(), "ours", 3)(raw)[0] == pytest.approx(
        np.clip(expected[0, 0], -1.0, 1.0), abs=1e-6
    )
    # What is given counts more; a residual policy needs its base, which no adopted one has.
    assert adoption(tmp_path / "theirs.zip", {"dt": 0.05}).dt == 0.05
    assert adoption(tmp_path / "theirs.zip", {"encoding": LIST}).scale is None
    said = {**BOX, "steersman": {"encoding": LIST, "action": "residual"}}
    (tmp_path / "other.zip").write_bytes(model(observation_space=said))
    with pytest.raises(DataError, match="with residual actions, which no policy alone drives"):
        sm.adopt(tmp_path / "other.zip", out=tmp_path)


class Evil:
    """Runs code where it is unpickled."""

    def __reduce__(self) -> Any:
        return (print, ("unpickled",))


FOREIGN = {"policy_class": {"__module__": "my_project.nets"}}
CNN = {"features_extractor_class": "<class 'x.NatureCNN'>"}
OF_IMAGES = {"policy_kwargs": CNN}
TWICE = {"action_net.weight": torch.ones((1, 3)), "action_net.bias": torch.ones(2)}
ENDLESS = {**LINEAR, "action_net.weight": torch.zeros(1, 1).expand(100_000, 100_000)}
NAN = {**LINEAR, "action_net.bias": torch.tensor([np.nan])}
NORMED = {
    "actor.mu.0.weight": torch.ones((1, 3)), "actor.mu.0.bias": torch.ones(1),
    "actor.mu.1.running_mean": torch.ones(1),
}  # fmt: skip
REFUSED = {
    "no zip": (b"PK\3\4nothing", "not a zip file"),
    "pickle": (model({"a": Evil()}), r"policy\.pth: .*[Ww]eights"),
    "bare pickle": (pickle.dumps(Evil()), "not a zip file"),
    "other policy": (model(**FOREIGN), "policy class is of my_project.nets, not"),
    "images": (model(**OF_IMAGES), "reads through <class 'x.NatureCNN'>"),
    "activation": (
        model(policy_kwargs={"activation_fn": "<class 'torch.nn.SiLU'>"}),
        "activation is .*SiLU.*ReLU, Tanh, ELU",
    ),
    "discrete": (model(action_space={":type:": "<class 'x.Discrete'>"}), "action_space is no Box"),
    "gsde": (model(use_sde=True), "gSDE"),
    "no bounds": (model(action_space=BOX | {"low": "[-inf]"}), "no finite bounds"),
    "dqn": (model({"q_net.q_net.0.weight": torch.ones(1)}), r"not those of .*\(q_net"),
    "shapes": (model(TWICE), r"layer 1: weights \(1, 3\), bias \(2,\)"),
    "claims": (model(ENDLESS), "holds no tensor 'action_net.weight'|not those of an MlpPolicy"),
    "nan": (model(NAN), "not finite"),
    "norm": (model(NORMED), r"actor\.mu\.1\.running_mean, which no plain layer has"),
    "deep": (model(policy_kwargs=json.loads("[" * 60 + "]" * 60)), "nests deeper"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_no_plain_actor_is_refused(what: str, capfd: pytest.CaptureFixture[str]) -> None:
    data, why = REFUSED[what]
    with pytest.raises(DataError, match=why) as caught:
        read_actor(data, "theirs.zip")
    assert str(caught.value).startswith("theirs.zip: not a model that can be adopted: ")
    assert "\n" not in str(caught.value)
    assert "unpickled" not in capfd.readouterr().out


def test_damaged_models_are_one_line() -> None:
    whole, rng = model(), np.random.default_rng(1)
    for _ in range(60):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 4):
            data[at] = rng.integers(256)
        said = ""
        try:
            read_actor(bytes(data[: rng.integers(100, len(data) + 1)]), "x")
        except DataError as error:
            said = str(error)
        assert "\n" not in said


WRONG = [
    ({"encoding": "extended"}, "reads 3 numbers, but extended gives .*road_curvature_0m"),
    ({"encoding": LIST, "scale": [1.0]}, "scale: 1 factors for 3 features"),
    ({"encoding": LIST, "output": 1}, "output: 1 is not allowed"),
    ({"encoding": LIST, "limits": [1.0, 1.0]}, "limits: expected two different"),
    ({"encoding": LIST, "dt": 0.0}, "dt: 0.0 is not allowed"),
]


@pytest.mark.parametrize(("settings", "why"), WRONG)
def test_settings_that_do_not_fit(settings: Any, why: str, tmp_path: FilePath) -> None:
    (tmp_path / "theirs.zip").write_bytes(model())
    with pytest.raises(ConfigError, match=why):
        adopt_policy(tmp_path / "theirs.zip", build(Adoption, settings), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_one_of_several_outputs_steers(tmp_path: FilePath) -> None:
    weights, bias = torch.tensor([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]]), torch.tensor([0.9, 0.0])
    bounds = {"action_space": BOX | {"low": "[-1. -1.]", "high": "[1. 1.]"}}
    both = {"action_net.weight": weights, "action_net.bias": bias}
    (tmp_path / "theirs.zip").write_bytes(model(both, **bounds))
    with pytest.raises(ConfigError, match="gives 2 actions"):
        adopt_policy(tmp_path / "theirs.zip", build(Adoption, {"encoding": LIST}), tmp_path)
    wanted = build(Adoption, {"encoding": LIST, "output": 1})
    file = adopt_policy(tmp_path / "theirs.zip", wanted, tmp_path)
    ours = PolicyNetwork(file.read_bytes(), "ours", 3)
    assert ours(np.array([[2.0, 5.0, 5.0]], np.float32))[0] == pytest.approx(0.4)


def test_an_onnx_file_is_taken_as_it_is(tmp_path: FilePath) -> None:
    shipped = locate("precision")
    card = json.loads(shipped.with_suffix(".json").read_text())
    settings = {"encoding": card["encoding"], "action": "rate"}
    (tmp_path / "in").mkdir()
    theirs = tmp_path / "in" / "theirs.onnx"
    theirs.write_bytes(shipped.read_bytes())
    file = adopt_policy(theirs, build(Adoption, settings), tmp_path)
    assert file.read_bytes() == shipped.read_bytes()
    with pytest.raises(ConfigError, match="limits: an ONNX file is taken as it is"):
        adopt_policy(theirs, build(Adoption, settings | {"limits": [1.0, -1.0]}), tmp_path)
    theirs.write_bytes(b"\x08\x08:\x04\n\x02:\x00")
    with pytest.raises(DataError, match=r"theirs\.onnx: not a network of layers"):
        adopt_policy(theirs, build(Adoption, settings), tmp_path)


def test_what_no_policy_alone_drives_is_named(tmp_path: FilePath) -> None:
    from stable_baselines3 import PPO

    problem = {"joint": True, "encoding": LIST, "action": "direct"}
    env = gymnasium.make("steersman/PathFollowing-v0", problem=problem)
    PPO("MlpPolicy", env, device="cpu", n_steps=2, batch_size=2).save(tmp_path / "theirs.zip")
    with pytest.raises(DataError, match="with joint actions, which no policy alone drives"):
        sm.adopt(tmp_path / "theirs.zip", out=tmp_path)


def test_what_is_no_model_is_named_before_its_settings(tmp_path: FilePath) -> None:
    (tmp_path / "vec.pkl").write_bytes(b"x")
    with pytest.raises(DataError, match="is neither; give a model of Stable-Baselines3"):
        adoption(tmp_path / "vec.pkl", {})
    shipped = locate("precision")
    with pytest.raises(DataError, match="is a controller of Steersman"):
        adoption(shipped, {})
