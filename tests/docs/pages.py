"""The code that stands in the documentation: blocks of Python, and commands for the shell."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import NamedTuple

ROOT = FilePath(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
_FENCE = re.compile(r"^(?P<indent> *)```(?P<language>\w*)[^\n]*\n(?P<body>.*?)^ *```", re.M | re.S)
# A block may be quoted from a file, whose own tests run it (tests/docs/test_plugin.py).
_EXCUSE = re.compile(r"<!-- (?:not run: |from )(?P<why>[^>]+?) -->\s*\Z")
_SHELL = {"", "sh", "bash", "console"}


class Block(NamedTuple):
    """A block of code: where it stands, its language, and why it is not run ("" if it is)."""

    page: FilePath
    line: int
    language: str
    body: str
    excuse: str

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: FilePath) -> Iterator[Block]:
    """The fenced blocks of a page. ``<!-- not run: why -->`` above one excuses it."""
    text = page.read_text(encoding="utf-8")
    for match in _FENCE.finditer(text):
        before = text[: match.start()]
        excuse = _EXCUSE.search(before)
        indent = len(match["indent"])
        body = "\n".join(row[indent:] for row in match["body"].splitlines())
        why = excuse["why"] if excuse else ""
        yield Block(page, before.count("\n") + 1, match["language"], body, why)


def commands(block: Block, program: str = "steersman") -> list[list[str]]:
    """The calls of a program in a block for the shell, each as its words; none if it is excused."""
    if block.excuse or block.language not in _SHELL:
        return []
    text = block.body.replace("\\\n", " ")
    found = []
    lines = [line.strip().removeprefix("$ ") for line in text.splitlines()]
    for line in (line for line in lines if line.startswith(f"{program} ")):
        lexer = shlex.shlex(line, posix=True, punctuation_chars=";|>")
        lexer.whitespace_split = True
        found += list(_calls(lexer, program))
    return found


def _calls(words: Iterator[str], program: str) -> Iterator[list[str]]:
    """What stands between semicolons, pipes and redirections, if the program begins it."""
    call: list[str] = []
    for word in [*words, ";"]:
        if set(word) <= set(";|>"):
            if call[:1] == [program]:
                yield call[1:]
            call = []
        else:
            call.append(word)
