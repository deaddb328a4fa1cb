"""Who takes part: kinds, files, names; and what is said of those who cannot."""

from __future__ import annotations

from pathlib import Path as FilePath

import pytest
import yaml

from steersman.bench.entrants import classical, entrant, entrants
from steersman.config import components
from steersman.controllers.pid import Pid
from steersman.errors import ConfigError, DataError

from ..loops import random_policy


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    return random_policy(tmp_path_factory.mktemp("trained"))


def written(file: FilePath, data: object) -> str:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return str(file)


def test_without_words_every_classical_kind_takes_part() -> None:
    names = [e.name for e in entrants([])]
    assert names == classical()
    assert {"pid", "mpc_pid"} <= set(names) <= set(components("controller"))
    assert "policy" not in names
    assert not any(e.learned for e in entrants([]))


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
        ("none.yaml", "none.yaml: cannot be read"),
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
