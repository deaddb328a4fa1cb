"""Where a training may begin or go on: in its own folder or a new one, never among other things."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import pytest

import steersman as sm
from steersman.api.resuming import resumed
from steersman.errors import ConfigError, DataError
from steersman.learning import checkpoint
from steersman.learning.seeds import train_seeds

from .problems import tiny


def begun(folder: FilePath, seed: int = 0) -> FilePath:
    """A training that was stopped at its first checkpoint."""
    checkpoint.begin(tiny(seed=seed), folder, print, overwrite=False, resume=False)
    checkpoint.save(folder, 100, {})
    return folder


@pytest.fixture
def several(tmp_path: FilePath) -> FilePath:
    """The folder of three seeds, the last of which has not begun."""
    for seed in (2, 10):
        begun(tmp_path / "three" / f"seed_{seed}", seed)
    (tmp_path / "three" / "seed_11").mkdir()
    return tmp_path / "three"


def test_all_seeds_of_a_folder_go_on(several: FilePath) -> None:
    told: list[str] = []
    kept = str(several / "seed_2" / "config.yaml")
    assert resumed(several, ["steps=5"], None, told.append) == ([kept, "steps=5"], [2, 10, 11])
    assert told == [f"{several}: going on with the seeds 2, 10, 11"]
    # Seeds that are asked for may be new; the configuration is any of the folder's.
    assert resumed(several, [], [12]) == ([kept], [12])
    with pytest.raises(ConfigError, match="holds the seeds 2, 10, 11"):
        resumed(several, ["seed=2"], None)


@pytest.mark.parametrize("words", [["demo"], ["demo", "seed=1"], [tiny()], [{"steps": 100}]])
def test_what_is_named_stays(several: FilePath, words: list[Any]) -> None:
    assert resumed(several, words, None) == (words, None)


def test_one_training_goes_on_with_its_configuration(tmp_path: FilePath) -> None:
    own = str(begun(tmp_path / "one") / "config.yaml")
    assert resumed(tmp_path / "one", ["seed=1"], None) == ([own, "seed=1"], None)


@pytest.mark.parametrize("verb", [sm.train, sm.imitate])
@pytest.mark.parametrize("words", [(), ("steps=100",)])
def test_without_a_name_and_a_training_nothing_begins(
    tmp_path: FilePath, verb: Any, words: tuple[str, ...]
) -> None:
    begun(tmp_path / "agent")
    with pytest.raises(DataError, match=r"holds no training to resume; did you mean '.*/agent'"):
        verb(*words, out=tmp_path / "agnet", resume=True)
    assert not (tmp_path / "agnet").exists()
    with pytest.raises(DataError, match="name a preset or a file"):
        verb(*words, out=tmp_path / "other", resume=True)


@pytest.mark.parametrize("how", [{"resume": True}, {"overwrite": True}, {}])
def test_none_begins_in_a_folder_of_seeds(several: FilePath, how: dict[str, bool]) -> None:
    before = sorted(several.rglob("*"))
    with pytest.raises(DataError, match=r"holds the seeds 2, 10, 11; write seeds=2,10,11"):
        sm.train(tiny(), out=several, **how)
    with pytest.raises(DataError, match="holds the seeds"):
        sm.tune("pid", out=several, trials=1)
    assert [f for f in sorted(several.rglob("*")) if f.name != ".lock"] == before


def test_seeds_do_not_begin_in_the_folder_of_one_training(tmp_path: FilePath) -> None:
    (begun(tmp_path) / "progress.csv").touch()
    with pytest.raises(DataError, match="holds one training"):
        train_seeds(tiny(), [0, 1], tmp_path, print, resume=True)


@pytest.mark.parametrize("how", [{"resume": True}, {"overwrite": True}, {}])
@pytest.mark.parametrize("name", ["compare.json", "rows.jsonl", "episode.npz", "search.json"])
def test_none_begins_among_results_of_another_command(
    tmp_path: FilePath, name: str, how: dict[str, bool]
) -> None:
    (tmp_path / name).touch()
    with pytest.raises(DataError, match=f"holds {name} of another command"):
        sm.train(tiny(), out=tmp_path, **how)
    assert {f.name for f in tmp_path.iterdir()} == {name}


def test_the_configuration_of_another_command_stays(tmp_path: FilePath) -> None:
    text = "smoothness: 0.05\ntrials: 20\n"
    (tmp_path / "config.yaml").write_text(text)
    with pytest.raises(DataError, match="holds the configuration of another command"):
        sm.train(tiny(), out=tmp_path, overwrite=True)
    assert (tmp_path / "config.yaml").read_text() == text


def test_nothing_is_resumed_among_other_files(tmp_path: FilePath) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(DataError, match=r"holds no training to resume, but notes\.txt"):
        sm.train(tiny(), out=tmp_path, resume=True)
    checkpoint.check_folder(tiny(), tmp_path, overwrite=False, resume=False)  # begun without it


def test_several_seeds_take_no_function() -> None:
    with pytest.raises(ConfigError, match=r"reward: goes with one training; call sm\.train"):
        sm.train(tiny(), out="new", seeds=[0, 1], reward=lambda _: 0.0)
