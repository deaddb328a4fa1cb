"""The code in the documentation works: Python runs, and so do commands that are short.

Commands that take long, or need a server, are checked as far as they come before any work begins:
their words are parsed, their settings and files read and validated. ``<!-- not run: why -->`` above
a block says why neither is possible.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path as FilePath
from typing import Any, NoReturn

import pytest
import typer
from typer.testing import CliRunner

import steersman as sm
from steersman import files, registry
from steersman.cli import app
from steersman.cli.outcome import _UsageError
from steersman.registry import components, families

from . import world
from .pages import PAGES, ROOT, Block, blocks, commands

# Commands that are short, so that they run as they stand. `drive` runs unless it records.
RUN = {"list", "show", "drive", "path"}
# What is asked of a server: words and options are checked, nothing else.
SERVER = {"carla"}
BLOCKS = [block for page in PAGES for block in blocks(page)]


def name(block: Block) -> str:
    return str(block)


class Checked(BaseException):
    """Everything that comes before the work is done."""


def stop(*_: Any, **__: Any) -> NoReturn:
    raise Checked


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """The files that the pages name, as their readers would have them by then."""
    folder = tmp_path_factory.mktemp("reader")
    world.make(folder)
    return folder


@pytest.fixture(autouse=True)
def there(folder: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


@pytest.fixture(autouse=True)
def unregistered(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a page registers is gone after it; other tests list what is registered."""
    for family in families():
        monkeypatch.setitem(registry._REGISTRY, family, dict(components(family)))


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "python"], ids=name)
def test_python(block: Block) -> None:
    code = compile(block.body, str(block), "exec")
    names: dict[str, Any] = {"__name__": "__main__"}
    if not block.excuse:
        exec(code, names)
    assert block.excuse or set(code.co_names) & set(names)


@pytest.mark.parametrize("block", [b for b in BLOCKS if commands(b)], ids=name)
def test_commands(block: Block, monkeypatch: pytest.MonkeyPatch) -> None:
    for words in commands(block):
        code, told = call(words, monkeypatch)
        assert code == 0, f"{block}: steersman {' '.join(words)}\n{told}"


def call(words: list[str], monkeypatch: pytest.MonkeyPatch) -> tuple[int, str]:
    """Exit code and output of a command that runs, or is stopped where its work begins."""
    if words[0] in SERVER:
        return parse(words), "see --help"
    with monkeypatch.context() as patch:
        long = words[0] not in RUN
        if long:
            patch.setattr("steersman.api.benching.kept", stop)
            patch.setattr("steersman.learning.adopt.read_bytes", stop)
            for work in ("bound", "serve_stream"):
                patch.setattr(f"steersman.delivery.serving.{work}", stop)
        if long or "--out" in words:
            patch.setattr(files, "out_folder", stop)
        for place in ("driving", "studies", "benching"):  # which connects to a server
            tell = stop if long or "plant=carla" in words else (lambda *_: None)
            patch.setattr(f"steersman.api.{place}.announce", tell)
        if _missing_map(words):
            patch.setattr("steersman.api.driving.announce_drive", stop)
        try:
            result = CliRunner().invoke(app, short(words), catch_exceptions=False)
        except Checked:
            return 0, ""
    return result.exit_code, result.output


def short(words: list[str]) -> list[str]:
    """The same drive for five seconds."""
    return [re.sub(r"^(laps|duration)=[0-9.]+$", "duration=5", word) for word in words]


def parse(words: list[str]) -> int:
    """Whether there is such a command with such options; 0 if there is."""
    command: Any = typer.main.get_command(app)
    while hasattr(command, "get_command"):
        command, words = command.get_command(None, words[0]), words[1:]
        if command is None:
            return 2
    try:
        command.make_context("", list(words))
    except (typer.Exit, _UsageError) as error:
        return error.exit_code
    return 0


def _missing_map(words: list[str]) -> bool:
    """CARLA's maps are CARLA's: nobody has them here."""
    named = [word.partition("=")[2] for word in words if word.endswith(".xodr") and "=" in word]
    return any(not FilePath(file).exists() for file in named)


@pytest.mark.parametrize(
    "target", sorted({w[0] for b in BLOCKS for w in commands(b, "make") if w and w[0] != "-C"})
)
def test_make(target: str) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{target}:", makefile, re.M)


NAMED = re.compile(r"`steersman ([a-z]+)(?: ([a-z]+))?[^`]*`")
GROUPS = ("path", "carla")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_named_in_the_text_exist(page: FilePath) -> None:
    root: Any = typer.main.get_command(app)
    for first, second in NAMED.findall(page.read_text(encoding="utf-8")):
        assert first in root.commands, first
        if first in GROUPS and second:
            assert second in root.commands[first].commands, f"{first} {second}"


def test_settings_that_the_guide_to_training_suggests() -> None:
    text = (ROOT / "docs" / "train_your_own.md").read_text(encoding="utf-8")
    table = text.partition("| what | for example |")[2].partition("\n\n")[0]
    suggested = re.findall(r"`([^`]*=[^`]*)`", table)
    assert len(suggested) > 8
    for words in suggested:
        given = [word for word in shlex.split(words) if not word.startswith("seeds=")]
        sm.configure("train", "demo", *given)


@pytest.mark.parametrize("words", ["drive path=circel", "train demo --out x agent.gama=1"])
def test_a_wrong_command_is_found(words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert call(words.split(), monkeypatch)[0] != 0


@pytest.mark.parametrize("words", [["carla", "docter"], ["carla", "map", "--too", "x"]])
def test_a_wrong_command_for_a_server_is_found(words: list[str]) -> None:
    assert parse(words) != 0


def _block(text: str, tmp_path: FilePath) -> list[Block]:
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    return list(blocks(page))


def test_what_is_found_on_a_page(tmp_path: FilePath) -> None:
    code = "$ steersman list; steersman --version\nmake x\nsteersman show \\\n  a 'b c'  # why\n"
    text = f"one\n\n```sh\n{code}```\n"
    (block,) = _block(text, tmp_path)
    assert (block.line, block.language, block.excuse) == (3, "sh", "")
    assert commands(block) == [["list"], ["--version"], ["show", "a", "b c"]]
    assert commands(block, "make") == [["x"]]


def test_an_excuse_holds_for_the_next_block_alone(tmp_path: FilePath) -> None:
    text = "<!-- not run: too long -->\n\n```\na\n```\n\n```\nb\n```\n"
    assert [block.excuse for block in _block(text, tmp_path)] == ["too long", ""]
