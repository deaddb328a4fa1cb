"""``steersman bench``: the table, the files, going on, and wrong words."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import pytest
from typer.testing import Result

from steersman.bench.suites import SUITES
from steersman.cli.bench import _fitting
from steersman.cli.output import console, table
from steersman.engine.journal import Journal
from steersman.files import only_one

Steersman = Callable[..., Result]
QUICK = ("bench", "quick", "--jobs", "1")


def test_the_table_and_the_files(steersman: Steersman, tmp_path: FilePath) -> None:
    result = steersman(*QUICK, "--controllers", "pid,ff=mpc_pid", "--out", "b")
    assert result.exit_code == 0
    first = [line.split()[0] for line in result.stdout.splitlines() if line[:1].isalpha()]
    assert {"pid", "ff"} <= set(first)
    assert "lost" in result.stdout
    found = json.loads((tmp_path / "b" / "results.json").read_text())
    assert found["suite"] == "quick"
    assert found["seeds"] == [0]
    assert set(found["controllers"]) == set(found["summary"]["controllers"]) == {"pid", "ff"}
    assert found["versions"]["steersman"]
    assert (tmp_path / "b" / "rows.jsonl").read_text().count("\n") == 20
    assert (tmp_path / "b" / "results.parquet").exists()
    assert "Worst cases" in (tmp_path / "b" / "report.html").read_text()
    again = steersman("bench", "b/suite.yaml", "--controllers", "pid", "--out", "c", "--jobs", "1")
    assert again.exit_code == 0  # the suite that was driven, from its file


def test_a_narrow_terminal_has_whole_names_and_columns() -> None:
    row = {"clean": "12\n10..14", "typical": "3.5\n2.37..4.06", "lost": "0", "steer": "4\n5.2"}
    row |= {"step": "12.3", "regret": "", "ratio": "1.23\n0.283..1.56"}
    for name, left_out in (("pid", []), ("a" * 45, ["steer", "step", "typical"])):
        columns, found = _fitting({name: row})
        assert "regret" not in columns  # no controller has one
        assert found == left_out
        shown = table("controller", *columns, right=tuple(columns))
        shown.add_row(name, *(row[column] for column in columns))
        lines = _printed(shown)
        assert any(line.startswith(f"{name} ") for line in lines)
        assert all("0.283..1.56" in line for line in lines if ".." in line)


def _printed(shown: Any) -> list[str]:
    stream = io.StringIO()
    console(stream, like=stream).print(shown)
    return stream.getvalue().splitlines()


def test_json_is_what_is_written(steersman: Steersman, tmp_path: FilePath) -> None:
    words = ("--controllers", "pid", "--seeds", "4,5", "--out", "b", "--json")
    result = steersman(*QUICK, *words)
    assert json.loads(result.stdout) == json.loads((tmp_path / "b" / "results.json").read_text())
    assert json.loads(result.stdout)["summary"]["scenarios"] == 20


def test_an_interruption_is_told(
    steersman: Steersman, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Journal, "add", stop)
    result = steersman(*QUICK, "--controllers", "pid", "--out", "b")
    assert result.exit_code == 130
    assert "the same command goes on from b" in result.stderr


@pytest.mark.parametrize(
    "words",
    [
        ("bench", "quick", "--controllers", "pid"),
        ("tune", "controller=pid", "trials=1"),
        ("falsify", "controller=pid", "trials=1"),
        ("train", "demo", "steps=1000"),
        ("imitate", "demo"),
        ("compare", "pid", "lqr"),
        ("reproduce", "--quick"),
    ],
)
def test_two_at_once_in_one_folder_are_one_line(
    steersman: Steersman,
    tmp_path: FilePath,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
) -> None:
    monkeypatch.setattr("steersman.files.PATIENCE", 0.0)
    with only_one(tmp_path / "b"):
        result = steersman(*words, "--out", "b")
    assert result.exit_code == 2
    assert "error: b: another process works in it" in result.stderr
    assert not list((tmp_path / "b").glob("*"))  # nothing was written


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("quik",), "unknown suite 'quik'; did you mean 'quick'?"),
        (("none.yaml",), "none.yaml: no such file"),
        (("quick", "--controllers", "pdi"), "unknown controller 'pdi'; did you mean 'pid'?"),
        (("quick", "--controllers", "pid,pid"), "both called 'pid'"),
        (("quick", "--seeds", "a"), "is not a list of seeds"),
        (("quick", "--jobs", "0"), "--jobs"),
        (("quick", "--engine", "rey"), "unknown engine 'rey'; did you mean 'ray'?"),
    ],
)
def test_wrong_words_are_one_line(
    steersman: Steersman, words: tuple[str, ...], message: str
) -> None:
    result = steersman("bench", *words, "--out", "b")
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


def test_the_help_names_every_suite(steersman: Steersman) -> None:
    said = steersman("bench", "--help").output.replace("\n", " ").replace(",", " ").split()
    assert set(SUITES) <= set(said)
