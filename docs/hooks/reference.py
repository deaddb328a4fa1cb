"""The reference pages: every command with its options, every component with its fields."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer
from mkdocs.structure.files import File, Files

from steersman.cli.app import app
from steersman.cli.components import _COMMANDS, paragraphs
from steersman.command_table import settings_of
from steersman.config import components, families
from steersman.fields import fields_of

PAGES = Path(__file__).resolve().parents[1] / "equations"
HEAD = "| field | default | unit | allowed | meaning |\n|---|---|---|---|---|"


def on_files(files: Files, config: Any, **_: Any) -> Files:
    """Add the generated pages."""
    files.append(File.generated(config, "reference/commands.md", content=commands()))
    files.append(File.generated(config, "reference/settings.md", content=settings()))
    for family in families():
        page = f"reference/{family}.md"
        files.append(File.generated(config, page, content=family_page(family)))
    return files


def commands() -> str:
    """What ``--help`` says, command by command."""
    root = typer.main.get_command(app)
    parts = ["# Commands", "What `steersman COMMAND --help` says; [more about them](../cli.md)."]
    return "\n\n".join([*parts, *_help(root, "steersman", None)])


def _help(command: Any, name: str, parent: Any) -> list[str]:
    with command.make_context(name, [], parent=parent, resilient_parsing=True) as context:
        text = command.get_help(context)
        out = [f"## {context.command_path}", f"```text\n{text.strip()}\n```"]
        for sub in command.list_commands(context) if hasattr(command, "list_commands") else []:
            out += _help(command.get_command(context, sub), sub, context)
    return out


def settings() -> str:
    """All that a command can be told."""
    parts = ["# Settings of commands", "What `steersman show COMMAND` lists: `key=value`."]
    for command in _COMMANDS:
        cls = settings_of(command)
        parts += [f"## {command}", *map(_cell, paragraphs(cls)), _table(cls)]
    return "\n\n".join(parts)


def family_page(family: str) -> str:
    """The components of one family."""
    parts = [f"# {family}", f"What `steersman show {family} NAME` lists."]
    for name, cls in components(family).items():
        parts += [f"## {name}", *map(_cell, paragraphs(cls)), _equations(name), _table(cls)]
    return "\n\n".join(part for part in parts if part)


def _equations(name: str) -> str:
    """The page that has a component's equations, if there is one."""
    page = PAGES / f"{name}.md"
    return f"[Its equations](../equations/{name}.md)" if page.is_file() else ""


def _table(cls: Any) -> str:
    rows = [f"| `{c[0]}` | {' | '.join(map(_cell, c[1:]))} |" for c in map(_cells, fields_of(cls))]
    return "\n".join([HEAD, *rows]) if rows else ""


def _cells(field: Any) -> tuple[str, ...]:
    return tuple(field.cells())


def _cell(text: str) -> str:
    """Plain text: nothing in it is Markdown."""
    return "".join(f"&#{ord(c)};" if c in "|<>*_[]`\\$" else c for c in text)
