"""Who takes part: kinds, files, names; and what is said of those who cannot."""

from __future__ import annotations

import json
from pathlib import Path as FilePath

import pytest
import yaml

from steersman import tuned
from steersman.bench.entrants import entrant, entrants, policies
from steersman.config import components, dump, resolve
from steersman.controllers.pid import Pid
from steersman.errors import ConfigError, DataError
from steersman.policy_file import shipped
from steersman.studies.tune_seeds import SeedsResult

from ..loops import random_policy


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    return random_policy(tmp_path_factory.mktemp("trained"))


def written(file: FilePath, data: object) -> str:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return str(file)


def test_without_words_the_controllers_of_the_package_take_part() -> None:
    found = entrants([])
    assert [e.name for e in found] == [FilePath(n).name for n in tuned.names()] + shipped()
    assert {"lqr", "pid", "mpc_delay", "mpc_pid_scheduled"} <= {e.name for e in found}
    assert [e.name for e in found if e.learned] == shipped()


@pytest.mark.parametrize("name", tuned.names())
def test_a_tuned_controller_differs_from_the_default(name: str) -> None:
    one = entrant(name)
    assert one.name == name.removeprefix("tuned/")
    assert one.controller != entrant(str(one.shown["kind"])).controller


def test_every_classical_kind_has_been_tuned() -> None:
    free = {
        kind
        for kind, cls in components("controller").items()
        if cls.search  # what holds nothing to tune, as a supervisor, is not
        and not any(field.is_required() for field in cls.model_fields.values())
        and not list(policies(dump(cls())))
        and not cls().follows()  # the suite ``tuning`` has no car ahead: results/acc/tuning
    }
    assert free == {entrant(name).shown["kind"] for name in tuned.names()}


def test_a_kind_a_file_and_a_policy(tmp_path: FilePath, policy: FilePath) -> None:
    tuned = written(tmp_path / "ff" / "tuned.yaml", {"controller": {"kind": "pid", "k_heading": 2}})
    bare = written(tmp_path / "bare.yaml", {"kind": "pid", "feedforward": True})
    found = entrants(["pid", tuned, bare, f"mine={tuned}", str(policy)])
    names = [e.name for e in found]
    assert names == ["pid", "ff", "bare", "mine", policy.parent.name]
    assert found[1].controller == Pid(k_heading=2)
    assert found[2].controller == Pid(feedforward=True)
    assert [e.learned for e in found] == [False, False, False, False, True]
    assert found[4].waypoints > 0


def test_the_digest_tells_controllers_apart_and_not_their_places(
    tmp_path: FilePath, policy: FilePath
) -> None:
    one = written(tmp_path / "one.yaml", {"kind": "pid", "k_heading": 1})
    two = written(tmp_path / "two.yaml", {"controller": {"kind": "pid", "k_heading": 1}})
    other = written(tmp_path / "other.yaml", {"kind": "pid", "k_heading": 2})
    assert entrant(one).digest == entrant(two).digest != entrant(other).digest
    moved = tmp_path / "moved.onnx"
    moved.write_bytes(policy.read_bytes())
    moved.with_suffix(".json").write_text(policy.with_suffix(".json").read_text())
    assert entrant(str(policy)).digest == entrant(str(moved)).digest


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("stanly", "unknown controller 'stanly'; did you mean 'stanley'"),
        ("none.yaml", "none.yaml: no such file"),
        ("none.onnx", "none.*: cannot be read"),
        ("missing/none.onnx", "missing/none.*: cannot be read"),
        ("a=", "names no controller"),
        ("empty.yaml", "holds no controller"),
        ("typo.yaml", "typo.yaml: .*did you mean 'k_heading'"),
        ("text.txt", "expected a file that ends in"),
    ],
)
def test_a_wrong_word_is_one_line(
    word: str, message: str, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "empty.yaml", {"path": "circle"})
    written(tmp_path / "typo.yaml", {"controller": {"kind": "pid", "k_heding": 1}})
    written(tmp_path / "text.txt", "x")
    with pytest.raises((ConfigError, DataError), match=message) as error:
        entrant(word)
    assert "\n" not in str(error.value)


def test_two_of_a_name_are_refused() -> None:
    with pytest.raises(ConfigError, match="both called 'pid'; write name=pid"):
        entrants(["pid", "pid"])
    assert [e.name for e in entrants(["pid", "again=pid"])] == ["pid", "again"]


@pytest.mark.parametrize("name", tuned.names())
def test_a_tuned_controller_is_what_its_record_says(name: str) -> None:
    record = FilePath(__file__).parents[2] / "results" / "tune" / entrant(name).name / "result.json"
    found = json.loads(record.read_text(encoding="utf-8"))
    # Read as a controller, so that fields that are new since then have their defaults.
    assert entrant(name).controller == resolve("controller", found["controller"])
    # The same budget for everybody: with each of three seeds, or those of the first stage.
    if not record.with_name("seeds.json").is_file():
        assert found["trials"] == 200
        return
    assert found["trials"] in {24, 48, 72}
    costs = [seed.cost_m for seed in SeedsResult.read(record.with_name("seeds.json")).seeds]
    assert found["trials"] == 72 or costs[len(costs) // 2] <= 1.1 * costs[0]


def test_a_folder_of_seeds_takes_part_under_one_name(tmp_path: FilePath) -> None:
    for seed, gain in enumerate((0.1, 0.2)):
        (tmp_path / "lqr" / f"seed_{seed}").mkdir(parents=True)
        text = f"controller: {{kind: lqr, preview_time: {gain}}}\n"
        (tmp_path / "lqr" / f"seed_{seed}" / "tuned.yaml").write_text(text)
    found = entrants([f"mine={tmp_path / 'lqr'}", "pid"])
    assert [(one.name, one.replicate, one.label) for one in found] == [
        ("mine", "seed 0", "mine, seed 0"),
        ("mine", "seed 1", "mine, seed 1"),
        ("pid", "", "pid"),
    ]
    assert len({one.digest for one in found}) == 3
    (tmp_path / "lqr" / "seed_2").mkdir()
    with pytest.raises(DataError, match=r"seed_2: has no tuned\.yaml yet"):
        entrants([str(tmp_path / "lqr")])


def test_a_mistyped_folder_is_answered_with_the_one_there(tmp_path: FilePath) -> None:
    (tmp_path / "five").mkdir()
    with pytest.raises(ConfigError, match=r"did you mean '.*five'"):
        entrant(str(tmp_path / "fives"))
