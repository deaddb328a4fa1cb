"""Components are called by the words that they were given by, in lines, records and on pages."""

from __future__ import annotations

import pickle
from pathlib import Path as FilePath

import pytest

import steersman as sm
from steersman.config import dump, resolve
from steersman.naming import called, plain_name, recorded_name
from steersman.report.falsification import shown_falsification
from steersman.report.html import group_title
from steersman.report.runs import ReportRun
from steersman.report.signals import group_by_path
from steersman.report.tables import tiles

MINE = "controller: {kind: lqr, q_lateral: 3.0}\n"


@pytest.fixture(autouse=True)
def files(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    """The user's own car, road and gains, in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "van.yaml").write_text("base: vw_t7\nmass: 2310\n", encoding="utf-8")
    road = "".join(f"{x},0\n" for x in range(200))
    (tmp_path / "Spa.csv").write_text(f"x_m,y_m\n{road}", encoding="utf-8")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "tuned.yaml").write_text(MINE, encoding="utf-8")


@pytest.mark.parametrize(
    ("family", "given", "name"),
    [
        ("controller", "tuned/lqr", "tuned/lqr"),
        ("controller", "lqr", "lqr"),
        ("controller", "mine", "mine"),
        ("controller", "mine/tuned.yaml", "mine"),
        ("controller", "supervised/estimated/mine", "supervised/estimated/mine"),
        ("controller", {"kind": "estimated", "controller": "tuned/lqr"}, "estimated/tuned/lqr"),
        ("controller", "precision", "precision"),
        ("vehicle", "van.yaml", "van"),
        ("vehicle", {"kind": "file", "file": "van.yaml"}, "van"),
        ("path", "Spa.csv", "Spa"),
        ("path", {"kind": "csv", "file": "Spa.csv"}, "Spa"),
        ("path", "circle", "circle"),
    ],
)
def test_a_component_is_called_by_its_word(family: str, given: object, name: str) -> None:
    made = resolve(family, given)
    assert made is not None
    assert called(made) == name
    assert called(pickle.loads(pickle.dumps(made))) == name


def test_the_word_is_no_part_of_what_a_component_is() -> None:
    made = resolve("controller", "tuned/lqr")
    again = resolve("controller", dump(made))
    assert (made, hash(made)) == (again, hash(again))
    assert "given_as" not in str(dump(made))
    assert plain_name(dump(resolve("controller", "estimated/tuned/lqr"))) == "estimated/lqr"


def test_records_and_pages_have_the_users_names() -> None:
    words = ("estimated/mine", "vehicle=van.yaml", "path=Spa.csv")
    episode = sm.drive(*words, duration=1)
    assert str(episode).startswith("Episode: estimated/mine on Spa, ")
    names = {"controller": "estimated/mine", "path": "Spa", "vehicle": "van"}
    assert names.items() <= episode.meta["names"].items()
    run = ReportRun("x", episode, config=dict(episode.meta))
    assert group_title(group_by_path([run])[0]).startswith("Spa, open path")
    assert {"estimated/mine", "van"} <= {tile.text for tile in tiles(run)}
    before = {"config": {"path": {"kind": "csv", "file": "x/Spa.csv"}, "controller": {"kind": "a"}}}
    assert [recorded_name(before, part) for part in ("path", "controller")] == ["Spa", "a"]


def test_a_falsification_names_what_it_falsified(tmp_path: FilePath) -> None:
    few = ("duration=1", "trials=0", "checks=0", "bisections=1", "ranges.mass=0", "jobs=1")
    found = sm.falsify("estimated/mine", "path=Spa.csv", *few[:-1], out="f", jobs=1)
    assert "estimated/mine" in str(found)
    again = type(found).read(tmp_path / "f" / "falsify.json")
    assert "Falsification of estimated/mine" in shown_falsification(again).page()
