"""The package's structure: no circle of imports, class names once, no file too long."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

SRC = Path(__file__).parents[1] / "src"
MOST_LINES = 300
# What is still to be put right; entries only ever leave these lists.
CIRCLES: frozenset[str] = frozenset()
TWICE: frozenset[str] = frozenset()
# Files that are one table each: features, vehicles, and the content of a study's results.
TABLES: frozenset[str] = frozenset({"ddpg_mpc_pid/results.py"})


@cache
def modules() -> dict[str, ast.Module]:
    """Each module's tree by its dotted name."""
    out = {}
    for file in sorted(SRC.rglob("*.py")):
        name = ".".join(file.relative_to(SRC).with_suffix("").parts).removesuffix(".__init__")
        out[name] = ast.parse(file.read_text(encoding="utf-8"))
    return out


def executed(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes but those under ``if TYPE_CHECKING``."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            continue
        yield node
        yield from executed(node)


def imported(name: str, tree: ast.Module) -> set[str]:
    """Modules of ours that a module imports, functions' imports included."""
    out: set[str] = set()
    known = modules()
    for node in executed(tree):
        if isinstance(node, ast.Import):
            out |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                out.add(inner if inner in known else node.module)
    return {other for other in out if other in known and other != name}


def circles() -> list[set[str]]:
    """Groups of modules that import each other in a circle (Tarjan's components)."""
    edges = {name: imported(name, tree) for name, tree in modules().items()}
    order, low, stack, found = {}, {}, [], []

    def visit(name: str) -> None:
        order[name] = low[name] = len(order)
        stack.append(name)
        for other in edges[name]:
            if other not in order:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == order[name]:
            at = stack.index(name)
            found.append(set(stack[at:]))
            del stack[at:]

    for name in edges:
        if name not in order:
            visit(name)
    return [group for group in found if len(group) > 1]


def test_no_module_imports_itself_through_others() -> None:
    wrong = {name for group in circles() for name in group}
    assert wrong - CIRCLES == set(), [sorted(group) for group in circles()]


def test_a_class_name_occurs_once() -> None:
    places = defaultdict(list)
    for name, tree in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(name)
    twice = {name: where for name, where in places.items() if len(where) > 1}
    assert {n: w for n, w in twice.items() if n not in TWICE} == {}


def test_no_file_is_too_long() -> None:
    long = {
        file.relative_to(SRC).as_posix()
        for file in SRC.rglob("*.py")
        if len(file.read_text(encoding="utf-8").splitlines()) > MOST_LINES
    }
    assert long == TABLES


def test_pages_that_the_source_names_are_there() -> None:
    """Docstrings and messages send readers to pages."""
    named = {
        (page, file.name)
        for file in SRC.rglob("*.py")
        for page in re.findall(r"\bdocs/[\w/]+\.md", file.read_text(encoding="utf-8"))
    }
    assert named
    assert [pair for pair in sorted(named) if not (SRC.parent / pair[0]).is_file()] == []
