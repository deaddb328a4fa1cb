"""``steersman compare``: what words name, tables, files, and wrong words."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from typer.testing import Result

from steersman.bench.drive import measure
from steersman.bench.entrants import entrants
from steersman.bench.suites import quick
from steersman.engine.journal import Journal
from steersman.episode import COLUMNS, Episode
from steersman.policy_file import locate

Steersman = Callable[..., Result]
SMALL = ("suite=small.yaml", "--jobs", "1")
_SUITE = """
courses:
  circle: {path: circle, duration: 2, speeds: {slow: {kind: constant_speed, speed: 8}}}
  straight: {path: straight, duration: 2, speeds: {slow: {kind: constant_speed, speed: 8}}}
disturbances: {clean: {}, delay: {delay: 0.1}}
"""


@pytest.fixture(autouse=True)
def small(tmp_path: FilePath) -> None:
    (tmp_path / "small.yaml").write_text(_SUITE)


@pytest.fixture
def training(tmp_path: FilePath) -> FilePath:
    """The folder of a training, as it looks: the package's policy and a record."""
    folder = tmp_path / "training"
    folder.mkdir()
    for suffix in (".onnx", ".json"):
        shutil.copy(locate("precision").with_suffix(suffix), folder / f"policy{suffix}")
    record = "steps,validation_error_mm,off_track_resets\n200,90,3\n400,30,5\n"
    (folder / "progress.csv").write_text(record)
    return folder


def found(result: Result) -> dict[str, Any]:
    assert result.exit_code == 0, result.stderr
    outcome: dict[str, Any] = json.loads(result.stdout)
    return outcome


def test_controllers_drive_the_same_scenarios(steersman: Steersman, tmp_path: FilePath) -> None:
    result = steersman("compare", "pid", "better=tuned/lqr", *SMALL, "--out", "c")
    assert result.exit_code == 0
    assert "B (better) against A (pid): 4 scenarios on 2 paths" in result.stdout
    assert "only 2 independent paths" in result.stderr
    assert max(map(len, result.stdout.splitlines())) <= 80
    outcome = json.loads((tmp_path / "c" / "compare.json").read_text())
    assert [one["name"] for one in outcome["contestants"]] == ["pid", "better"]
    [pair] = outcome["comparisons"]
    assert pair["figures"]["rms_m"]["pairs"] == 4
    assert pair["figures"]["rms_m"]["ratio"]["value"] < 1.0
    page = (tmp_path / "c" / "report.html").read_text()
    assert "B against A: better" in page
    assert "Worst cases" in page
    again = steersman("compare", "pid", "tuned/lqr", "tuned/stanley", *SMALL, "--out", "c")
    assert again.exit_code == 0
    assert (tmp_path / "c" / "rows.jsonl").read_text().count("\n") == 12  # none twice


def test_a_controller_against_itself_is_no_different(steersman: Steersman) -> None:
    [pair] = found(steersman("compare", "pid", "b=pid", *SMALL, "--json"))["comparisons"]
    assert pair["figures"]["rms_m"]["difference"] == {"value": 0.0, "low": 0.0, "high": 0.0}
    assert pair["better"] == 0


def test_rows_of_benchmarks(steersman: Steersman, tmp_path: FilePath) -> None:
    for name, controllers in (("one", "pid,stanley"), ("two", "pid,tuned/lqr")):
        words = ("--controllers", controllers, "--jobs", "1", "--out", name)
        assert steersman("bench", "small.yaml", *words).exit_code == 0
    before = (tmp_path / "one" / "rows.jsonl").read_bytes()
    outcome = found(steersman("compare", "one", "two:lqr", "tuned/mpc", "--json"))
    names = [one["name"] for one in outcome["contestants"]]
    assert names == ["pid", "stanley", "lqr", "mpc"]  # the last was driven now
    assert [pair["scenarios"] for pair in outcome["comparisons"]] == [4, 4, 4]
    assert (tmp_path / "one" / "rows.jsonl").read_bytes() == before
    outcome = found(steersman("compare", "one:pid", "two:pid", "--json"))
    assert [one["name"] for one in outcome["contestants"]] == ["pid (one)", "pid (two)"]
    assert outcome["comparisons"][0]["figures"]["rms_m"]["ratio"]["value"] == 1.0


def test_scenarios_of_one_name_that_differ_are_not_paired(
    steersman: Steersman, tmp_path: FilePath
) -> None:
    faster = _SUITE.replace("circle, duration: 2", "circle, duration: 3")
    (tmp_path / "other.yaml").write_text(faster)
    for name in ("small", "other"):
        words = (f"{name}.yaml", "--controllers", "pid", "--jobs", "1", "--out", name)
        assert steersman("bench", *words).exit_code == 0
    result = steersman("compare", "small", "other", "--json")
    assert found(result)["comparisons"][0]["scenarios"] == 2
    assert "2 scenarios of small or other are not in both, or differ (2)" in result.stderr


def test_drives_are_compared_along_their_path(steersman: Steersman, tmp_path: FilePath) -> None:
    for name, words in {
        "slow": ("controller=pid", "speed.speed=8"),
        "fast": ("controller=stanley", "speed.speed=10"),
    }.items():
        ring = ("path=circle", "duration=8", "speed=constant_speed")
        done = steersman("drive", *ring, *words, "--out", name)
        assert done.exit_code == 0
    result = steersman("compare", "slow", "fast/episode.npz", "mpc", "--out", "c")
    assert result.exit_code == 0
    assert "Not under the same conditions: speed.speed (8, 10)." in result.stdout
    assert "Path, vehicle, speed and all other conditions are the same." in result.stdout
    assert "places 1 m apart, from 0 m to 63 m of the path" in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 80
    outcome = json.loads((tmp_path / "c" / "compare.json").read_text())
    fast, now = outcome["comparisons"]
    assert fast["along"]["figures"]["mean_speed_m_s"]["difference"]["value"] == pytest.approx(
        2.0, abs=0.05
    )
    assert now["differ"] == []
    assert outcome["metrics"]["mpc"]["duration_s"] == outcome["metrics"]["slow"]["duration_s"]
    page = (tmp_path / "c" / "report.html").read_text()
    assert "B (fast) against A (slow)" in page
    assert "<p>One path, one drive of each" in page


def test_controllers_drive_one_drive_that_is_described(
    steersman: Steersman, tmp_path: FilePath
) -> None:
    (tmp_path / "track.csv").write_text("x,y\n0,0\n50,0\n50,50\n0,50\n")
    given = ("tuned/lqr", "tuned/stanley", "path=track.csv", "duration=12", "--json")
    outcome = json.loads(steersman("compare", *given).stdout)
    (pair,) = outcome["comparisons"]
    assert outcome["sort"] == "drives"
    assert pair["differ"] == []  # nothing but the controllers
    assert pair["along"]["figures"]
    for more in ("suite=quick", "--seeds=0"):
        wrong = steersman("compare", *given[:-1], *more.split())
        assert "path=track.csv: a suite has paths of its own; leave out" in wrong.stderr


def test_who_leaves_the_road_is_not_flattered(steersman: Steersman) -> None:
    """Both are compared where both drove, so it is said who drove no farther, and why."""
    circle = ("path=circle", "speed=constant_speed", "duration=20")
    for name, words in (("a", ()), ("b", ("speed.speed=30",))):
        done = steersman("drive", *circle, "controller=pid", *words, "--out", name)
        assert done.exit_code == 0
    result = steersman("compare", "a", "b")
    assert "b ended early (off track after " in result.stderr
    assert "what follows is not compared" in result.stderr


def test_an_interruption_is_told(
    steersman: Steersman, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Journal, "add", stop)
    result = steersman("compare", "pid", "lqr", *SMALL, "--out", "c")
    assert result.exit_code == 130
    assert "interrupted; the same command goes on from c" in result.stderr
    assert not (tmp_path / "c" / "compare.json").exists()


def test_drives_on_different_paths_are_not_compared_along(steersman: Steersman) -> None:
    for name, path in (("a", "circle"), ("b", "straight")):
        assert steersman("drive", f"path={path}", "duration=3", "--out", name).exit_code == 0
    result = steersman("compare", "a", "b", "--json")
    [pair] = found(result)["comparisons"]
    assert pair["along"] is None
    assert "path.kind" in [one["field"] for one in pair["differ"]]
    assert "drove different paths" in result.stderr


def test_trainings_drive_with_their_policies(
    steersman: Steersman, tmp_path: FilePath, training: FilePath
) -> None:
    result = steersman("compare", str(training), "pid", *SMALL, "--out", "c")
    assert result.exit_code == 0, result.stderr
    outcome = json.loads((tmp_path / "c" / "compare.json").read_text())
    assert outcome["contestants"][0]["sort"] == "training"
    card = json.loads((training / "policy.json").read_text())
    assert outcome["contestants"][0]["training"]["steps"] == card["training"]["steps"]
    assert "Trainings" in (tmp_path / "c" / "report.html").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("pid",), "two are needed to compare; given pid"),
        (("pid", "lqrr"), "unknown controller 'lqrr'; did you mean 'lqr'?"),
        (("pid", "none/"), "unknown controller 'none/'"),
        (("pid", "none/here"), "unknown controller 'none/here'; no such file or folder"),
        (("pid", "empty"), "empty: holds nothing to compare"),
        (("pid", "several"), "several: name one of those in it: several/a, several/b\n"),
        (("pid", "lqr", "suite=quik"), "unknown suite 'quik'; did you mean 'quick'?"),
        (("pid", "lqr", "corridor=-1"), "corridor: -1"),
        (("pid", "lqr", "radius=3"), "radius: unknown field; did you mean 'path.radius'?"),
        (("pid", "lqr", "suite=quick", "suite=core"), "given twice"),
        (("pid", "lqr", "--seeds", "x"), "is not a list of seeds"),
        (("several/a", "several/b", "suite=core"), "suite=core: drives are compared on what"),
        (("several/a", "rows"), "is one drive and rows:pid the rows of a benchmark"),
        (("rows", "lqr", "suite=core"), "the scenarios are those of rows"),
        (("rows:lqr", "pid"), "rows: no controller 'lqr'"),
        (("rows", "lqr", "--out", "rows"), "--out: rows is one of those compared"),
        (("broken.npz", "pid"), "broken.npz: not an episode"),
    ],
)
def test_wrong_words_are_one_line(
    steersman: Steersman, tmp_path: FilePath, words: tuple[str, ...], message: str
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.npz").write_bytes(b"x")
    drive = Episode({name: np.zeros(5) for name in COLUMNS}, "duration", 1.0, 0.05, 9.0, False)
    for name in ("a", "b"):
        (tmp_path / "several" / name).mkdir(parents=True)
        drive.save(tmp_path / "several" / name / "episode.npz")
    (tmp_path / "several" / "checkpoints").mkdir()
    np.savez(tmp_path / "several" / "checkpoints" / "weights.npz", a=np.zeros(2))  # no episode
    (tmp_path / "rows").mkdir()
    row = measure(quick().scenarios((0,))[0], entrants(["pid"])[0], "1")
    (tmp_path / "rows" / "rows.jsonl").write_text(json.dumps(row.plain()) + "\n")
    result = steersman("compare", *words)
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.fixture
def seeds(tmp_path: FilePath) -> FilePath:
    """The folder of a tuning with three seeds."""
    for k, weight in enumerate((1.0, 2.0, 4.0)):
        folder = tmp_path / "three" / f"seed_{k}"
        folder.mkdir(parents=True)
        (folder / "tuned.yaml").write_text(f"kind: lqr\nr: {weight}\n")
    return tmp_path / "three"


def test_a_folder_of_seeds_is_one_contestant(
    steersman: Steersman, seeds: FilePath, tmp_path: FilePath
) -> None:
    result = steersman("compare", "pid", f"mine={seeds}", *SMALL, "--out", "c")
    assert result.exit_code == 0, result.stderr
    assert "only 3 seeds" in result.stderr
    assert max(map(len, result.stdout.splitlines())) <= 80
    outcome = json.loads((tmp_path / "c" / "compare.json").read_text())
    assert [one["name"] for one in outcome["contestants"]] == ["pid", "mine"]
    pid, mine = outcome["replicates"]["methods"]
    assert (len(pid["runs"]), len(mine["runs"])) == (1, 3)
    ordered = sorted(mine["runs"], key=lambda run: run["rms_m"])
    assert mine["shown"] == ordered[1]["name"]
    [pair] = outcome["comparisons"]
    assert pair["figures"]["rms_m"]["own"] == pytest.approx(ordered[1]["rms_m"])
    assert "Methods over their seeds" in (tmp_path / "c" / "report.html").read_text()


def test_a_seed_that_is_not_done_is_named(steersman: Steersman, seeds: FilePath) -> None:
    (seeds / "seed_1" / "tuned.yaml").unlink()
    result = steersman("compare", "pid", str(seeds), *SMALL)
    assert result.exit_code == 2
    assert "seed_1: has no tuned.yaml yet" in result.stderr


def test_seeds_drive_one_road_too(steersman: Steersman, seeds: FilePath) -> None:
    result = steersman("compare", "pid", f"net={seeds}", "path=circle", "duration=1")
    assert result.exit_code == 0
    assert "Over seeds, on 1 scenario. IQM" in result.stdout
    assert "1 scenario on 1 path, pair by" in result.stdout
    wrong = steersman("compare", "pid", str(seeds), "path=circle", "suite=core")
    assert "path=circle: a suite has paths of its own" in wrong.stderr


def test_gains_of_another_car_say_so(steersman: Steersman, tmp_path: FilePath) -> None:
    (tmp_path / "mine.yaml").write_text("base: carla_model3\nmass: 2600\n")
    one = ("pid", "a=predicted/tuned/lqr", "path=circle", "duration=1")
    line = "controller: tuned/lqr was tuned for carla_model3 (mass 1845, here 2600"
    assert "was tuned for" not in steersman("compare", *one).stderr
    assert line in steersman("compare", *one, "vehicle=mine.yaml").stderr
    assert steersman(
        "drive", "pid", "path=circle", "duration=1", "vehicle=mine.yaml", "--out", "d"
    ).exit_code == 0  # fmt: skip
    assert line in steersman("compare", "d", "tuned/lqr").stderr
    with (tmp_path / "small.yaml").open("a") as out:
        out.write("vehicles: {mine: {kind: file, file: mine.yaml}}\n")
    assert line in steersman("compare", "pid", "tuned/lqr", *SMALL).stderr
