"""Saving and loading records of runs, whole and damaged."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from steersman.episode import COLUMNS, COMPLETED, DURATION, Episode, is_episode, load_episode
from steersman.errors import DataError


def episode(n=5, **changes):
    columns = {name: np.arange(n) * (k + 0.1) for k, name in enumerate(COLUMNS)}
    head = {"end": "laps", "distance": 12.5, "dt": 0.05, "path_length": 100.0, "closed": True}
    return Episode(columns=columns, **{**head, **changes})


def rewrite(file, name, content):
    """The same archive with one member replaced."""
    with np.load(file) as data:
        members = {**data, name: content}
    np.savez(file, **members)


def test_load_of_save_is_the_episode(tmp_path):
    one = episode(meta={"seed": 3, "config": {"path": {"kind": "circle"}}, "note": "±1 µm"})
    one.save(tmp_path / "deep" / "one.npz")
    two = load_episode(tmp_path / "deep" / "one.npz")
    for name in COLUMNS:
        np.testing.assert_array_equal(one[name], two[name])
    for name in ("end", "distance", "dt", "path_length", "closed", "meta"):
        assert getattr(one, name) == getattr(two, name)


@settings(max_examples=20)
@given(arrays(float, st.integers(0, 30), elements=st.floats(width=64)))
def test_every_float_survives(tmp_path_factory, values):
    one = episode(len(values))
    one = Episode({**one.columns, "x": values}, "laps", 0.0, 0.05, 1.0, False)
    file = tmp_path_factory.mktemp("floats") / "one.npz"
    one.save(file)
    assert load_episode(file)["x"].tobytes() == values.tobytes()


def test_the_same_episode_gives_the_same_bytes(tmp_path):
    for name in ("a.npz", "b.npz"):
        episode().save(tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_length_item_and_completed():
    assert len(episode(7)) == 7
    assert episode()["time"][1] == pytest.approx(0.1)
    assert episode(end=DURATION).completed
    assert not episode(end="off_track").completed
    assert DURATION in COMPLETED


def test_a_missing_file(tmp_path):
    with pytest.raises(DataError, match=r"one\.npz: cannot be read \(No such file"):
        load_episode(tmp_path / "one.npz")
    with pytest.raises(DataError, match="cannot be read"):
        is_episode(tmp_path / "one.npz")


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 cut off"])
def test_a_file_of_something_else(tmp_path, content):
    file = tmp_path / "one.npz"
    file.write_bytes(content)
    with pytest.raises(DataError, match="not an episode of Steersman"):
        load_episode(file)
    with pytest.raises(DataError, match=r"not an \.npz archive"):
        is_episode(file)


def test_a_plain_array_is_not_an_episode(tmp_path):
    with (tmp_path / "one.npz").open("wb") as stream:
        np.save(stream, np.zeros(3))
    with pytest.raises(DataError, match="not an episode"):
        load_episode(tmp_path / "one.npz")


def test_archives_of_others_are_told_apart(tmp_path):
    np.savez(tmp_path / "other.npz", timesteps=np.arange(3))
    episode().save(tmp_path / "one.npz")
    assert is_episode(tmp_path / "one.npz")
    assert not is_episode(tmp_path / "other.npz")
    with pytest.raises(DataError, match="head"):
        load_episode(tmp_path / "other.npz")


def test_a_cut_or_flipped_file(tmp_path):
    file = tmp_path / "one.npz"
    episode(400).save(file)
    whole = file.read_bytes()
    for end in range(0, len(whole), max(len(whole) // 40, 1)):
        file.write_bytes(whole[:end])
        with pytest.raises(DataError):
            load_episode(file)
    middle = len(whole) // 2
    file.write_bytes(whole[:middle] + bytes(b ^ 0xFF for b in whole[middle : middle + 8])
                     + whole[middle + 8 :])  # fmt: skip
    with pytest.raises(DataError, match="not an episode"):
        load_episode(file)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("x", np.zeros(4), "columns differ in length"),
        ("x", np.zeros((5, 1)), "columns differ in length"),
        ("x", np.array(["a"] * 5), "could not convert"),
        ("head", np.frombuffer(b"{", dtype=np.uint8), "not an episode"),
        ("head", np.frombuffer(b"[1]", dtype=np.uint8), "not an episode"),
        ("head", np.frombuffer(b'{"end": "laps"}', dtype=np.uint8), "distance"),
    ],
)
def test_a_damaged_member(tmp_path, name, content, message):
    file = tmp_path / "one.npz"
    episode().save(file)
    rewrite(file, name, content)
    with pytest.raises(DataError, match=message):
        load_episode(file)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("end", 3), ("distance", "far"), ("dt", 0.0), ("dt", float("nan")), ("closed", 1),
        ("meta", []), ("path_length", None), ("extra", 1),
    ],
)  # fmt: skip
def test_a_head_of_wrong_types(tmp_path, key, value):
    file = tmp_path / "one.npz"
    episode().save(file)
    with np.load(file) as data:
        head = json.loads(bytes(data["head"]))
    text = json.dumps({**head, key: value}).encode()
    rewrite(file, "head", np.frombuffer(text, dtype=np.uint8))
    with pytest.raises(DataError, match=key):
        load_episode(file)


def test_pickles_are_refused(tmp_path):
    file = tmp_path / "one.npz"
    episode().save(file)
    rewrite(file, "x", np.array([{}] * 5, dtype=object))
    with pytest.raises(DataError, match="holds object, not numbers"):
        load_episode(file)


def test_what_is_not_plain_data_is_refused_before_writing(tmp_path):
    file = tmp_path / "one.npz"
    episode().save(file)
    before = file.read_bytes()
    with pytest.raises(TypeError):
        episode(meta={"path": object()}).save(file)
    assert file.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["one.npz"]


def test_fine_accelerations_survive(tmp_path):
    one = episode(4, fine=np.arange(40.0).reshape(20, 2))
    one.save(tmp_path / "one.npz")
    np.testing.assert_array_equal(load_episode(tmp_path / "one.npz").fine, one.fine)
    episode(4).save(tmp_path / "two.npz")
    assert load_episode(tmp_path / "two.npz").fine.shape == (0, 2)
    rewrite(tmp_path / "one.npz", "fine", np.zeros(7))
    with pytest.raises(DataError, match="accelerations have the shape"):
        load_episode(tmp_path / "one.npz")


def supervised(**meta):
    """Eight rows: a fallback for two reasons, then nobody, then the controller, then the last."""
    columns = {name: np.zeros(8) for name in COLUMNS}
    columns["time"] = 0.05 * np.arange(8)
    columns["driver"] = np.array([0.0, 1.0, 1.0, 1.0, 3.0, 0.0, 0.0, 2.0])
    columns["reason"] = np.array([0.0, 5.0, 5.0, 11.0, 3.0, 0.0, 0.0, 6.0])
    return Episode(columns, "laps", 1.0, 0.05, 1.0, False, meta)


def test_interventions_have_begin_end_reason_and_driver():
    supervisor = {"kind": "supervisor", "fallback": {"kind": "mpc_pid"}, "last": {"kind": "pid"}}
    found = supervised(config={"controller": {"kind": "wrap", "of": supervisor}}).interventions()
    assert [one.reason for one in found] == [
        "exception", "corridor", "input_not_finite", "deadline"
    ]  # fmt: skip
    assert [one.controller for one in found] == ["mpc_pid", "mpc_pid", "hold", "pid"]
    assert [one.begin for one in found] == pytest.approx([0.05, 0.15, 0.2, 0.35])
    assert [one.end for one in found] == pytest.approx([0.15, 0.2, 0.25, 0.4])
    assert supervised().interventions()[0].controller == "fallback"
    assert episode(0).interventions() == []


def test_episodes_of_before_there_were_supervisors_can_be_read(tmp_path):
    supervised().save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as data:
        old = {name: data[name] for name in data if name not in ("driver", "reason")}
    np.savez(tmp_path / "old.npz", **old)
    again = load_episode(tmp_path / "old.npz")
    assert set(again.columns) == set(COLUMNS)
    assert again.interventions() == []
    assert len(load_episode(tmp_path / "new.npz").interventions()) == 4
