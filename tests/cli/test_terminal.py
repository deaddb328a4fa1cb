"""Every command in a terminal of 80 columns, in poorer ones, in a pipe, and as JSON."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from steersman.cli import app

from . import every_command as every

WIDTH = 80
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")
_COLOURS = re.compile(r"\x1b\[[0-9;]*?(?:3[0-7]|4[0-7]|9[0-7]|38;|48;)[0-9;]*m")


def commands(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """All commands by their words."""
    for name in group.commands:
        command = group.commands[name]
        if hasattr(command, "commands"):
            yield from commands(command, f"{before}{name} ")
        else:
            yield f"{before}{name}", command.callback


ALL = dict(commands(typer.main.get_command(app)))
WITH_JSON = [name for name, callback in ALL.items() if "as_json" in callback.__annotations__]


def test_none_is_forgotten() -> None:
    """A new command gets a cheap call in ``every_command.py``, or a reason to have none."""
    assert set(every.CALLS) | set(every.LEFT_OUT) == set(ALL)
    assert "drive" in WITH_JSON


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What a terminal of 80 x 24 was sent by each command."""
    if sys.platform == "win32":
        pytest.skip("needs a pseudo-terminal")
    import fcntl
    import pty
    import struct
    import termios

    folder = tmp_path_factory.mktemp("terminal")
    every.prepare(folder)
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, WIDTH, 0, 0))
    poor = {*every.POOR, "COLUMNS", "LINES", "FORCE_COLOR"}
    environment = {k: v for k, v in os.environ.items() if k not in poor}
    process = subprocess.Popen(
        [sys.executable, every.__file__],
        cwd=folder,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env=environment | {"TERM": "xterm-256color"},
    )
    os.close(theirs)
    parts = []
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:  # Linux says so when the other end is closed
            break
        if not part:
            break
        parts.append(part)
    os.close(ours)
    assert process.wait() == 0
    text = b"".join(parts).decode().replace("\r\n", "\n")
    found: dict[str, str] = {}
    for piece in text.split(f"{every.MARK} ")[1:]:
        head, _, body = piece.partition("\n")
        if head.startswith("exit"):
            assert head in {"exit 0", "exit 2"}, text[-2000:]
        else:
            found[head] = body
    return found


@pytest.fixture(scope="module")
def piped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Result]]:
    """What each command prints elsewhere; as JSON where it can."""
    folder = tmp_path_factory.mktemp("pipe")
    every.prepare(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        every.shorten(patch.setattr)
        yield {
            name: CliRunner().invoke(
                app,
                [*name.split(), *words, *(["--json"] if name in WITH_JSON else [])],
                prog_name="steersman",
                catch_exceptions=False,
            )
            for name, words in every.CALLS.items()
        }


def widest(text: str) -> str:
    """The longest line that a terminal gets, movements taken for ends of lines."""
    lines = re.split(r"[\r\n]|\x1b\[[0-9]*[A-HJ]", text)
    return max((_ESCAPES.sub("", line) for line in lines), key=len)


@pytest.mark.parametrize("name", every.CALLS)
def test_it_fits_a_terminal(shown: dict[str, str], name: str) -> None:
    assert shown[name].strip()
    assert len(widest(shown[name])) <= WIDTH, widest(shown[name])


@pytest.mark.parametrize("name", every.POORLY)
@pytest.mark.parametrize("word", every.POOR)
def test_it_does_with_less(shown: dict[str, str], name: str, word: str) -> None:
    text = shown[f"{name} {word}"]
    assert len(widest(text)) <= WIDTH
    assert not _COLOURS.search(text)
    if word == "TERM":
        assert "\x1b" not in text
        assert name != "train" or re.search(r"10/\d+ steps: reward -123", text)


def test_a_terminal_has_a_bar_with_colours(shown: dict[str, str]) -> None:
    """Else the tests above tell nothing."""
    assert _COLOURS.search(shown["train"])
    assert "error 1.23e-05" in shown["train"]


@pytest.mark.parametrize("name", [name for name in every.CALLS if name not in WITH_JSON])
def test_in_a_pipe_it_is_plain(piped: dict[str, Result], name: str) -> None:
    assert piped[name].exit_code in {0, 2}
    for text in (piped[name].stdout, piped[name].stderr):
        assert "\x1b" not in text
        assert "\r" not in text
    assert max(map(len, ["", *piped[name].stdout.splitlines()])) <= WIDTH


@pytest.mark.parametrize("name", WITH_JSON)
def test_json_is_clean(piped: dict[str, Result], name: str) -> None:
    result = piped[name]
    if result.exit_code == 0 or result.stdout:
        json.loads(result.stdout)
        assert "\x1b" not in result.stdout + result.stderr
        assert "{" not in result.stderr
    else:
        assert result.stderr.startswith("error: ")
