"""``steersman export``: what is written, and wrong words."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path as FilePath

import pytest
from typer.testing import Result

from steersman.cli.export import TARGETS
from steersman.delivery import package as trial
from steersman.delivery.controller_package import read_table
from steersman.errors import DataError
from steersman.policy_file import locate, read_policy

Steersman = Callable[..., Result]


def test_the_help_names_every_target(steersman: Steersman) -> None:
    said = " ".join(steersman("export", "--help").stdout.split())
    for target in TARGETS:
        assert f"--to {target.name}: from {target.takes}: {target.makes}" in said


def test_onnx_of_a_policy_of_the_package(steersman: Steersman, tmp_path: FilePath) -> None:
    result = steersman("export", "precision", "--to", "onnx")
    file = tmp_path / "precision_onnx" / "precision.onnx"
    assert result.stdout.strip() == str(FilePath("precision_onnx", "precision.onnx"))
    assert "to the bit" in result.stderr
    assert read_policy(file)[0] == locate("precision").read_bytes()


@pytest.mark.skipif(not any(map(shutil.which, trial.COMPILERS)), reason="there is no C compiler")
def test_c_is_compiled_and_tried(steersman: Steersman, tmp_path: FilePath) -> None:
    result = steersman("export", "precision", "--to", "c", "--out", "o")
    assert result.stdout.strip() == str(FilePath("o", "steersman_precision.c"))
    assert "0 other statuses: as expected (again: make -C o test)" in result.stderr
    assert {file.name for file in (tmp_path / "o").iterdir()} == {
        *("steersman_precision.c", "steersman_precision.h", "test_precision.c", "Makefile"),
        *("vector_precision.h", "precision.onnx", "precision.json", "precision.csv"),
    }
    vector = tmp_path / "o" / "test_precision.c"
    text = vector.read_text(encoding="ascii")
    vector.write_text(text.replace("wrong == 0", "wrong == 1"), encoding="ascii")
    with pytest.raises(DataError, match=r"its test vector fails: .*: NOT AS EXPECTED"):
        trial.try_out(tmp_path / "o" / "steersman_precision.c")
    vector.write_text("nothing of the kind", encoding="ascii")
    assert "not compiled: " in trial.try_out(tmp_path / "o" / "steersman_precision.c")


def test_c_without_a_compiler(steersman: Steersman, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "COMPILERS", ("no-such-compiler",))
    result = steersman("export", "precision", "--to", "c", "--out", "o")
    assert result.exit_code == 0
    assert "there is no C compiler here; where there is one: make -C o test" in result.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("precision --to onx", "--to: unknown target 'onx'; did you mean 'onnx'?"),
        (" --to onnx --out o", "RUN: expected the name of what to export, given nothing"),
        ("precision --to onnx --precision single --out o", "settings, name and parameters are for"),
        ("precison --to onnx --out o", "did you mean 'precision'?"),
        ("folder --to onnx --out o", "folder: no policy.onnx in this folder"),
        ("other.onnx --to onnx --out o", "other.onnx"),
        ("scales.json --to onnx --out o", "scales.onnx: card: 1 scales for"),
        ("broken.json --to onnx --out o", "broken.json: not a policy card"),
        ("nonsense.onnx --to onnx --out o", "nonsense.onnx: not a network of layers"),
    ],
)
@pytest.mark.usefixtures("wrong_files")
def test_wrong_words(steersman: Steersman, tmp_path: FilePath, words: str, message: str) -> None:
    before = {file.name for file in tmp_path.iterdir()}
    result = steersman("export", *words.split(" "))
    assert result.exit_code == 2
    assert message in result.stderr
    assert {file.name for file in tmp_path.iterdir()} == before
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.skipif(not any(map(shutil.which, trial.COMPILERS)), reason="there is no C compiler")
def test_parameters_leave_and_come_back(steersman: Steersman, tmp_path: FilePath) -> None:
    steersman("export", "tuned/lqr", "--to", "c", "--out", "a")
    table = tmp_path / "a" / "lqr.csv"
    values = read_table(table)
    assert values["preview_time"] > 0.0
    assert len(values) == 1 + 4 * 79
    line = next(row for row in table.read_text().splitlines() if "design.gains[40]" in row)
    assert line.split(",")[1:3] == ["design.gains[40]", "rad/m"]
    assert line.endswith('"Gain of e_y, the lateral error, at 6 m/s."')
    rows = table.read_text().replace(repr(values["design.gains[40]"]), "0.5").splitlines()
    rows = [row for row in rows if ",preview_time," not in row]
    table.write_text("\n".join(rows), encoding="utf-8")
    result = steersman("export", "tuned/lqr", "--to", "c", "--out", "b", "--parameters", str(table))
    assert "as expected" in result.stderr
    assert "317 parameters can be changed without compiling" in result.stderr
    assert "not in the table, kept: preview_time\n" in result.stderr
    assert read_table(tmp_path / "b" / "lqr.csv") == {**values, "design.gains[40]": 0.5}
    again = steersman("export", "tuned/lqr", "--to", "c", "--out", "a", "--precision", "single")
    assert "as expected" in again.stderr
    assert "float preview[15][2]" in (tmp_path / "a" / "steersman_lqr.h").read_text()


def test_what_fails_its_proof_does_not_stay(
    steersman: Steersman, monkeypatch: pytest.MonkeyPatch, tmp_path: FilePath
) -> None:
    codes = iter((0, 1, 0, 1))  # it compiles and fails, twice
    monkeypatch.setattr(trial, "COMPILERS", ("python", "python3"))
    monkeypatch.setattr(
        trial,
        "_run",
        lambda _: subprocess.CompletedProcess([], next(codes), "NOT AS EXPECTED", ""),
    )
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "notes.txt").write_text("mine")
    for folder in ("new", "kept"):
        result = steersman("export", "tuned/stanley", "--to", "c", "--out", folder)
        assert result.exit_code == 2
        assert "its test vector fails: NOT AS EXPECTED" in result.stderr
    assert [*tmp_path.iterdir()] == [tmp_path / "kept"]
    assert [*(tmp_path / "kept").iterdir()] == [tmp_path / "kept" / "notes.txt"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("tuned/lqr --precision half", "--precision: 'half' is not allowed"),
        ("tuned/lqr --parameters none.csv", "none.csv: cannot be read"),
        ("tuned/lqr --parameters bad.csv", "bad.csv: line 2: value 'x', expected a number"),
        ("tuned/lqr --parameters other.csv", "parameter 'design.gain[0]': unknown; did you mean"),
        ("tuned/lqr --parameters low.csv", "low.csv: preview_time: -1"),
        ("tuned/lqr --parameters comma.csv", "comma.csv: line 2 (preview_time): 3 cells, expected"),
        ("tuned/lqr --parameters few.csv", "few.csv: line 2 (preview_time): 1 cells, expected 2"),
        ("tuned/lqr --parameters semi.csv", "semi.csv: its cells are separated by ';'"),
        ("lqr --with supervisor controller.deadline=0.01", "a call of perf_counter (controllers/"),
        ("tuned/lqr --with estimater", "unknown part 'estimater'; did you mean 'estimator'?"),
        ("tuned/lqr sensor.count=3", "sensor.count: 3"),
    ],
)
def test_wrong_words_for_a_controller(
    steersman: Steersman, tmp_path: FilePath, words: str, message: str
) -> None:
    for name, row in (
        ("bad", "preview_time,x"), ("comma", "preview_time,0,06"), ("few", "preview_time"),
        ("other", "design.gain[0],1.0"), ("low", "preview_time,-1")
    ):  # fmt: skip
        (tmp_path / f"{name}.csv").write_text(f"name,value\n{row}\n")
    (tmp_path / "semi.csv").write_text("name;value\npreview_time;0,06\n")
    result = steersman("export", *words.split(), "--to", "c", "--out", "o")
    assert result.exit_code == 2
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "o").exists()


def test_what_a_tuning_found_is_designed_for_its_car(
    steersman: Steersman, tmp_path: FilePath
) -> None:
    (tmp_path / "mine.yaml").write_text("base: bmw_320i\nmass: 2000\n")
    folder = tmp_path / "tune"
    folder.mkdir()
    (folder / "tuned.yaml").write_text("controller: {kind: lqr}\n")
    car = {"kind": "file", "file": "mine.yaml"}
    (folder / "result.json").write_text(json.dumps({"suite": [{"vehicle": car}]}))
    (folder / "config.yaml").write_text(json.dumps({"vehicle": car}))
    found = steersman("export", "tune", "--to", "c", "--out", "a")
    assert f"vehicle: mine.yaml, the car of the tuning ({FilePath('tune', 'config.yaml')})" in (
        found.stderr
    )
    assert "was tuned for" not in found.stderr
    same = steersman("export", "tune", "--to", "c", "--out", "b", "nominal=mine.yaml")
    assert "the car of the tuning" not in same.stderr
    assert "vehicle: mine.yaml leaves friction (1.0" in same.stderr
    other = steersman("export", "tune", "--to", "c", "--out", "o", "vehicle=carla_model3")
    assert "controller: tune was tuned for mine.yaml (mass 2000, here 1" in other.stderr
    tables = [read_table(tmp_path / name / "tune.csv") for name in ("a", "b", "o")]
    assert tables[0] == tables[1] != tables[2]
    foreign = steersman("export", "tuned/lqr", "--to", "c", "--out", "f", "nominal=mine.yaml")
    assert "controller: tuned/lqr was tuned for carla_model3 (" in foreign.stderr
