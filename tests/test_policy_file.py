"""Policies that are damaged, strange or of another loop get one clear line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.config import build
from steersman.controllers.policy import Policy
from steersman.errors import ConfigError, DataError, SteersmanError
from steersman.learning.config import TrainConfig
from steersman.learning.export import network
from steersman.policy_file import PolicyCard, locate, read_policy, sha256, shipped
from steersman.rollout import RunConfig, run
from steersman.sensing import WaypointSensor

from .loops import CAR, DT, Posed, drive, random_net, random_policy


@pytest.fixture
def file(tmp_path: FilePath) -> FilePath:
    """A sound policy."""
    return random_policy(tmp_path)


def load(file: FilePath, dt: float = DT) -> Any:
    return Policy(file=str(file)).init(CAR, dt)


def edit(file: FilePath, **fields: Any) -> None:
    """Change fields of the card; None removes one."""
    card = json.loads(file.with_suffix(".json").read_text(encoding="utf-8")) | fields
    card = {name: value for name, value in card.items() if name not in fields or value is not None}
    file.with_suffix(".json").write_text(json.dumps(card), encoding="utf-8")


def correct(file: FilePath, base: dict[str, Any], **fields: Any) -> None:
    """Say that the policy corrects another controller, or has other fields."""
    fields = fields or {"action": "residual", "authority": 0.2}
    edit(file, rate_limit=None, base=base, **fields)
    card = json.loads(file.with_suffix(".json").read_text(encoding="utf-8")) | {"rate_limit": None}
    file.with_suffix(".json").write_text(json.dumps(card), encoding="utf-8")


def replace(file: FilePath, data: bytes) -> None:
    """Another network, with the card made to match."""
    file.write_bytes(data)
    edit(file, files={file.name: sha256(data)})


def more(file: FilePath, name: str, data: bytes | None) -> None:
    """Say that the policy was delivered with another file, whose content was b"old"."""
    _, card = read_policy(file)
    if data is not None:
        file.with_name(name).write_bytes(data)
    edit(file, files={**card.files, name: sha256(b"old")})


def test_a_sound_policy_loads(file: FilePath) -> None:
    data, card = read_policy(file)
    assert data == file.read_bytes()
    assert card == PolicyCard.model_validate_json(card.model_dump_json())
    assert load(file).rate_step == pytest.approx(card.rate_limit * DT)


GAINS = ("k_heading", "preview_time")
FAULTS: dict[str, tuple[Callable[[FilePath], object], str]] = {
    "no network": (lambda f: f.unlink(), r"policy\.onnx: cannot be read \(No such file"),
    "no card": (lambda f: f.with_suffix(".json").unlink(), r"policy\.json: cannot be read"),
    "folder": (lambda f: (f.unlink(), f.mkdir()), "is a folder"),
    "damaged": (lambda f: f.write_bytes(f.read_bytes()[:-7]), "its SHA-256 is"),
    "other policy's card": (
        lambda f: edit(f, files={"policy.onnx": "0" * 64}),
        "policy.onnx: its SHA-256 is [0-9a-f]{64}, but its card policy.json says 0{64}; the file",
    ),
    "no digest": (lambda f: edit(f, files={"policy.onnx": "secret"}), "'secret' is not allowed"),
    "no such file": (
        lambda f: edit(f, files={"a.onnx": "0" * 64, "b.onnx": "0" * 64}), "not among the files",
    ),
    "another file is missing": (lambda f: more(f, "policy.c", None), "policy.c: cannot be read"),
    "another file was changed": (lambda f: more(f, "policy.c", b"new"), "policy.c: its SHA-256 is"),
    "a file elsewhere": (lambda f: more(f, "../a.c", None), "files"),
    "no onnx": (lambda f: replace(f, b"no network"), "not a network of layers"),
    "empty": (lambda f: replace(f, b""), "policy.onnx: "),
    "other inputs": (
        lambda f: replace(f, network(random_net(3), [1.0] * 3)), "does not map .* features",
    ),
    "not json": (lambda f: f.with_suffix(".json").write_text("{"), "not valid JSON"),
    "not text": (lambda f: f.with_suffix(".json").write_bytes(b"\xff\xfe\x00"), "not text"),
    "a list": (lambda f: f.with_suffix(".json").write_text("[1]"), "not a policy card"),
    "missing field": (lambda f: edit(f, dt=None), "dt"),
    "unknown field": (lambda f: edit(f, colour="red"), "colour"),
    "wrong type": (lambda f: edit(f, spacing="wide"), "spacing"),
    "negative period": (lambda f: edit(f, dt=-0.05), "dt"),
    "later format": (lambda f: edit(f, format=3), "format 3 is not known; this version reads 1"),
    "contradiction": (lambda f: edit(f, scale=[1.0]), "1 scales for"),
    "too few waypoints": (
        lambda f: edit(f, waypoints=5), "encoding reads 13 waypoints, but there are 5",
    ),
    "base without authority": (lambda f: edit(f, base={"kind": "pid"}), "base and either"),
    "authority without base": (lambda f: edit(f, authority=0.2), "those of a base"),
    "authority of nothing": (lambda f: edit(f, base={"kind": "pid"}, authority=0.0), "authority"),
    "base with a rate": (
        lambda f: edit(f, base={"kind": "pid"}, authority=0.2), "an action on a base has none",
    ),
    "parameters of another base": (
        lambda f: correct(f, {"kind": "pid"}, parameters={"horizon": "5..9"}),
        "unknown field",
    ),
    "a network of fewer actions": (
        lambda f: correct(f, {"kind": "pid"}, parameters=dict.fromkeys(GAINS, "0..1")),
        r"gives actions of shape \(1,\)",
    ),
    "unknown base": (lambda f: correct(f, {"kind": "telepathy"}), "telepathy"),
    "base of wrong values": (lambda f: correct(f, {"kind": "pid", "k_heading": -1}), "k_heading"),
    "policy as base": (lambda f: correct(f, {"kind": "policy"}), "a policy cannot be the base"),
    "other layout": (lambda f: correct(f, {"kind": "pid"}), "scales for"),
    "unknown encoding": (lambda f: edit(f, encoding={"kind": "telepathy"}), "telepathy"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_faults_get_one_clear_line(file: FilePath, name: str) -> None:
    spoil, message = FAULTS[name]
    spoil(file)
    with pytest.raises(DataError, match=message) as caught:
        load(file)
    assert "\n" not in str(caught.value)
    assert str(file.with_suffix("")) in str(caught.value)


def test_a_card_from_before_there_were_bases_loads(file: FilePath) -> None:
    before = load(file)
    edit(file, base=None, authority=None)
    card = json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))
    assert not {"base", "authority"} & set(card)
    after = load(file)
    assert after.base is None
    assert (after.rate_step, after.features) == (before.rate_step, before.features)


def test_a_card_of_the_first_format_loads(file: FilePath) -> None:
    data, card = read_policy(file)
    edit(file, format=1, files=None, signs=None, sha256=sha256(data))
    assert read_policy(file) == (data, card)
    edit(file, sha256="0" * 64)
    with pytest.raises(DataError, match="its SHA-256 is"):
        read_policy(file)


def test_a_policy_may_be_renamed_with_its_card(file: FilePath) -> None:
    data, card = read_policy(file)
    file.with_suffix(".json").rename(file.with_name("best.json"))
    assert read_policy(file.rename(file.with_name("best.onnx"))) == (data, card)


def test_every_file_of_a_delivery_is_checked(file: FilePath) -> None:
    more(file, "policy.c", b"old")
    assert sorted(read_policy(file)[1].files) == ["policy.c", "policy.onnx"]


def test_other_control_period_is_refused(file: FilePath) -> None:
    with pytest.raises(ConfigError, match=r"period of 0\.05 s, but plant\.dt is 0\.1 s"):
        load(file, 0.1)


@pytest.mark.parametrize("fields", [{"count": 5}, {"spacing": 1.0}])
def test_other_waypoints_are_refused(file: FilePath, fields: dict[str, Any]) -> None:
    with pytest.raises(SteersmanError, match=r"set sensor\.count and sensor\.spacing"):
        drive(Policy(file=str(file)), Posed(), sensor=WaypointSensor(**fields), duration=1.0)


def test_more_waypoints_than_it_reads_do_no_harm(file: FilePath) -> None:
    policy = Policy(file=str(file))
    plain = drive(policy, Posed(), duration=1.0)
    more = drive(policy, Posed(), sensor=WaypointSensor(count=30), duration=1.0)
    assert plain["steer_command"] == pytest.approx(more["steer_command"], abs=1e-9)


def test_card_holds_the_training(file: FilePath) -> None:
    _, card = read_policy(file)
    assert card.training["config"]["problem"]["action"] == TrainConfig().problem.action
    assert card.observation[0].endswith("]")


@pytest.mark.parametrize("name", shipped())
def test_policies_of_the_package_are_small_and_drive(name: str) -> None:
    data, card = read_policy(locate(name))
    assert len(data) < 1e6
    assert card.commit is not None
    assert not card.commit.endswith("dirty")
    words = {"controller": {"kind": "policy", "file": name}, "duration": 20.0}
    speed = {"kind": "constant_speed", "speed": 12.0}
    episode = run(build(RunConfig, {**words, "path": {"kind": "circle"}, "speed": speed}))
    assert episode.completed
    assert abs(episode["lateral_error"]).mean() < 0.02


def test_the_policy_that_drives_by_default_is_part_of_the_package() -> None:
    assert Policy().file in shipped()


def test_a_policy_that_is_neither_file_nor_of_the_package() -> None:
    with pytest.raises(DataError, match=r"'precison' is neither .* did you mean 'precision'\?"):
        locate("precison")
