"""Completion: what the shells are given for a word that was begun; whole sentences in the help."""

from __future__ import annotations

import os
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from steersman.cli.app import COMMANDS, app
from steersman.cli.completion import completed, word_of
from steersman.cli.outcome import OneLineGroup


@pytest.mark.parametrize(
    ("before", "begun", "some", "not_any"),
    [
        ([], "tuned/m", {"tuned/mpc", "tuned/mpc_delay"}, {"tuned/lqr"}),
        ([], "pat", {"path=", "path."}, {"plant="}),
        ([], "path=ci", {"path=circle"}, {"path=csv"}),
        (["path=circle"], "path.", {"path.radius=50.0", "path.direction=left"}, {"path.file="}),
        (["path=csv"], "path.s", {"path.smoothing=0.0", "path.spacing=0.0"}, {"path.radius=50.0"}),
        (["path=csv"], "path.smoothing=", {"path.smoothing=auto"}, set()),
        (["lqr", "path=circle"], "path.direction=", {"path.direction=right"}, set()),
        (["controller=tuned/lqr"], "controller.q_l", {"controller.q_lateral="}, set()),
        ([], "plant.record=", {"plant.record=true", "plant.record=false"}, set()),
        ([], "start.", {"start.offset=0.0"}, set()),
        # Words as bash has them.
        (["path", "="], "ci", {"circle"}, {"csv"}),
        (["path"], "", {"circle", "csv", "gpx"}, {"lqr"}),
        (["path", "=", "circle", "path.direction", "="], "", {"left", "right"}, {"circle"}),
        # Nothing is known of these.
        (["path=nowhere.csv"], "path.radius=", set(), {"path.radius=50.0"}),
        ([], "nonsense.field=", set(), {"nonsense.field="}),
        (["path=circle"], "path.radius.x=", set(), {"path.radius.x="}),
    ],
)
def test_words_of_a_drive(before: list[str], begun: str, some: set[str], not_any: set[str]) -> None:
    found = completed("drive", before, begun)
    assert {text for text in some if not any(f.startswith(text) for f in found)} == set()
    assert not not_any & set(found)


def test_words_of_a_training() -> None:
    assert "demo" in completed("train", [], "de")
    assert "problem.vehicle=bmw_320i" in completed("train", ["demo"], "problem.vehicle=b")
    assert word_of("", "contr") == ["controller"]
    assert "mpc_pid" in word_of("controller", "mpc")


@pytest.mark.parametrize(
    ("shell", "variables", "shown"),
    [
        ("bash", {"COMP_WORDS": "steersman drive path = ci", "COMP_CWORD": "4"}, "circle"),
        ("bash", {"COMP_WORDS": "steersman show path mo", "COMP_CWORD": "3"}, "monza"),
        ("zsh", {"_TYPER_COMPLETE_ARGS": "steersman drive path=ci"}, "path=circle"),
        (
            "fish",
            {
                "_TYPER_COMPLETE_ARGS": "steersman tune tuned/stanley_",
                "_TYPER_COMPLETE_FISH_ACTION": "get-args",
            },
            "tuned/stanley_cm",
        ),
    ],
)
def test_as_shells_ask(
    monkeypatch: pytest.MonkeyPatch, shell: str, variables: dict[str, str], shown: str
) -> None:
    for name, value in {**variables, "_STEERSMAN_COMPLETE": f"complete_{shell}"}.items():
        monkeypatch.setitem(os.environ, name, value)
    result = CliRunner().invoke(app, [], prog_name="steersman")
    assert shown in result.stdout, result.output


def groups(command: Any, name: str) -> list[tuple[str, Any]]:
    inner = [each for n, c in getattr(command, "commands", {}).items() for each in groups(c, n)]
    return [(name, command), *inner]


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_never_cuts_a_sentence(name: str) -> None:
    root = typer.main.get_command(app)
    assert isinstance(root, OneLineGroup)
    for word, command in groups(root.commands[name], name):
        context = typer.Context(command, info_name=word)
        lines = command.get_help(context).splitlines()
        # A usage, and an example in the help, may have dots that stand for more.
        cut = [line for line in lines if line.endswith("...") and "Usage" not in line]
        assert cut == []
        for inner in getattr(command, "commands", {}).values():
            assert inner.help.partition("\n\n")[0].split()[-1] in " ".join(lines)
