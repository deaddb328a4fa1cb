"""What starting costs, and the table of commands."""

from __future__ import annotations

import subprocess
import sys

import pytest
import typer

import steersman
from steersman.cli.app import COMMANDS, LazyGroup, app

HEAVY = ("numpy", "pydantic", "numba", "gymnasium", "torch", "rich", "yaml", "ruamel.yaml")


def loaded(code: str) -> set[str]:
    """Which of the heavy libraries ``code`` imports."""
    words = [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"]
    out = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    return set(out.splitlines()[-1].split()) & set(HEAVY)


@pytest.mark.parametrize(
    "code",
    [
        "import steersman",
        "import steersman; dir(steersman)",
        "import steersman.cli",
        "from steersman.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass",
    ],
)
def test_nothing_heavy_is_imported_at_the_start(code: str) -> None:
    assert loaded(code) == set()


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_of_the_table_has_help_and_examples(name: str) -> None:
    root = typer.main.get_command(app)
    assert isinstance(root, LazyGroup)
    command = root.commands[name]
    assert command.help
    assert "steersman" in (command.epilog or "".join(c.epilog for c in command.commands.values()))


def test_every_name_of_the_front_door_is_there() -> None:
    for name in dir(steersman):
        assert getattr(steersman, name) is not None
    assert "bench" in dir(steersman)

    assert callable(steersman.bench)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        steersman.nonsense  # noqa: B018


@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium, steersman; found = gymnasium.spec('steersman/PathFollowing-v0')",
        "import steersman, gymnasium; found = gymnasium.spec('steersman/PathFollowing-v0')",
        "import gymnasium; found = gymnasium.make('steersman:steersman/PathFollowing-v0').spec",
    ],
)
def test_gymnasium_finds_the_environment(code: str) -> None:
    code += "; print(found.id, found.entry_point)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    told = "steersman/PathFollowing-v0 steersman.learning.env:PathFollowingEnv\n"
    assert done.stdout == told, done.stderr


@pytest.mark.parametrize(
    "code",
    [
        "import steersman.bench.suite; import steersman as sm; sm.bench",
        "import steersman as sm; sm.bench; import steersman.bench.suite",
        "import steersman.bench.suite as suite, steersman as sm; import steersman.bench.runner",
    ],
)
def test_a_verb_and_the_package_of_its_name_are_both_there(code: str) -> None:
    code += """
import steersman.bench.maps, steersman.bench.suite as again
from steersman.bench import maps
from steersman.api.benching import bench
assert sm.bench is bench and sm.bench.__name__ == "bench" and "suite" in sm.bench.__doc__
assert steersman.bench.suite is again and steersman.bench.maps is maps
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
