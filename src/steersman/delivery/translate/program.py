"""A C program: functions made for the types they are called with, constants, parameters."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from steersman.delivery import c_text
from steersman.delivery.translate import arguments
from steersman.delivery.translate.emitter import c_type, texts
from steersman.delivery.translate.expressions import Expressions
from steersman.delivery.translate.helpers import HELPER_NAMES, HELPERS, RESERVED
from steersman.delivery.translate.lines import indented, names, without_unused
from steersman.delivery.translate.statements import Statements
from steersman.delivery.translate.values import (
    NEVER,
    REAL,
    Array,
    NotTranslatable,
    Root,
    Scalar,
    Static,
    Type,
    Value,
    join,
    key,
    leaves,
    type_of,
)


class Parameter(NamedTuple):
    """A number, or an array of numbers, that can be changed without compiling."""

    path: str
    value: Any
    name: str
    """In C."""


class Function(NamedTuple):
    """A function in C."""

    name: str
    result: Type
    single: str | None
    """Kind of the number that it returns; None: it writes to where it is told."""
    written: tuple[bool, ...]
    """Which of the arrays it gets it writes to, leaf by leaf of its arguments."""
    text: str


class Program:
    """Makes functions as they are called for.

    Args:
        single: whether numbers are float, else double.
        pinned: parameters that are constants.
        tunable: whether numbers with a path are parameters.
    """

    def __init__(self, *, single: bool, pinned: frozenset[str] = frozenset()) -> None:
        """Begin with nothing."""
        self.single, self.pinned = single, pinned
        self.parameters: dict[str, Parameter] = {}
        self.constants: dict[Any, tuple[str, str]] = {}
        self.helpers: dict[str, str] = {}
        self.unsolved = False
        """Whether some function may answer NaN because its equations have no solution."""
        self.functions: dict[Any, Function] = {}
        self._names: set[str] = set()
        self._alive: list[Any] = []
        self._open: list[Any] = []

    def literal(self, value: float) -> str:
        """A number in C."""
        if isinstance(value, bool | int | np.integer):
            return str(int(value)) if value >= 0 else f"({int(value)})"
        if np.isnan(value):
            return "(real)NAN"
        if np.isinf(value):
            return "(real)INFINITY" if value > 0.0 else "(-(real)INFINITY)"
        if not self.single:
            text = repr(float(value))
        else:
            text = c_text.decimal(value) if abs(value) > 1e-37 or value == 0.0 else "0.0f"  # noqa: PLR2004
            text = text if {".", "e"} & set(text) else f"{text[:-1]}.0f"
        return text if value >= 0.0 else f"({text})"

    def math(self, name: str) -> str:
        """The function of math.h."""
        return f"{name}f" if self.single else name

    def helper(self, name: str) -> str:
        """A small function that is written once."""
        self.helpers[name] = HELPERS[name]
        return HELPER_NAMES.get(name, name)

    def is_parameter(self, path: str | None) -> bool:
        """Whether what has this path can be changed without compiling."""
        return path is not None and path not in self.pinned

    def parameter(self, path: str, value: Any) -> str:
        """The text of a parameter."""
        if path not in self.parameters:
            name = path.replace(".", "_")
            self.parameters[path] = Parameter(path, value, name)
        return f"p->{self.parameters[path].name}"

    def constant(self, value: Static) -> Array:
        """A known array: a parameter, or a constant of the program."""
        known = np.asarray(value.value)
        whole = known.dtype.kind in "iub"
        if self.is_parameter(value.path) and not whole:
            assert value.path is not None
            return Array(self.parameter(value.path, known), known.shape, Root("p"))
        found = self.constants.get(key(known))
        if found is None:
            name = f"constant_{len(self.constants) + 1}"
            kind = "int" if whole else "real"
            numbers = [self.literal(x) for x in known.ravel().tolist()]
            rows = [", ".join(numbers[i : i + 6]) for i in range(0, len(numbers), 6)]
            body = "".join(f"    {row},\n" for row in rows) or "    0,\n"
            text = f"static const {kind} {name}[{max(known.size, 1)}] = {{\n{body}}};\n"
            found = self.constants[key(known)] = (name, text)
        return Array(found[0], known.shape, Root(found[0]), (), "int" if whole else REAL)

    def call(
        self,
        out: Expressions,
        function: Callable[..., Any],
        given: list[Value],
        named: dict[str, Value],
    ) -> Value:
        """Call a Python function from C code that is being written."""
        values = arguments.bound(function, given, named)
        parts = [leaf for each in values.values() for leaf in leaves(each)]
        values = {k: arguments.dense(out, v) for k, v in values.items()}
        made = self.function(function, values)
        words = ["p", *(text for each in values.values() for text in texts(each))]
        given_parts = [leaf for each in values.values() for leaf in leaves(each)]
        changed: list[tuple[Array, Array]] = []
        for part, leaf, written in zip(parts, given_parts, made.written, strict=True):
            if written and isinstance(leaf, Array) and isinstance(part, Array):
                part.root.written = leaf.root.written = True
                if part.text != leaf.text:
                    changed.append((part, leaf))
        result = self._called(out, made, words)
        for part, leaf in changed:  # numbers with gaps between them went as a copy
            out.copy(part, leaf)
        return result

    @staticmethod
    def _called(out: Expressions, made: Function, words: list[str]) -> Value:
        """Write the call; its result."""
        if made.result.form == "static" or not list(leaves(arguments.example(made.result))):
            if any(made.written):
                out.lines.append(f"{made.name}({', '.join(words)});")
            return arguments.example(made.result)
        if made.single is not None:
            text = f"{made.name}({', '.join(words)})"
            if not any(made.written):
                return Scalar(text, made.single)
            name = out.fresh("answer_store")
            out.lines.append(f"{c_type(made.single)} {name} = {text}; /* kept */")
            return Scalar(name, made.single)
        result = out.storage(made.result, "result", out.lines)
        words += [
            each.text if isinstance(each, Array) else f"&{each.text}" for each in leaves(result)
        ]
        out.lines.append(f"{made.name}({', '.join(words)});")
        return result

    def needed(self, lines: Sequence[str]) -> list[str]:
        """The texts of the functions that lines call, and of those that these call."""
        called, out = names("\n".join(lines)), []
        for each in reversed(self.functions.values()):
            if each.name in called:
                out.append(each.text)
                called |= names(each.text)
        return out[::-1]

    def constants_of(self, lines: Sequence[str]) -> str:
        """The definitions of the constants that lines read."""
        used = names("\n".join(lines))
        return "".join(f"{text}\n" for name, text in self.constants.values() if name in used)

    def written(self, key: Any, wanted: str, write: Callable[[str], str]) -> str:
        """The name of a function that is no Python; ``write`` makes its text of its name."""
        if key not in self.functions:
            name = self._name(wanted)
            self.functions[key] = Function(name, NEVER, None, (), write(name))
        return self.functions[key].name

    def function(self, function: Callable[..., Any], values: dict[str, Value]) -> Function:
        """The C function for arguments of these types."""
        types = tuple(type_of(each) for each in values.values())
        this = (function, types)
        if this in self.functions:
            return self.functions[this]
        if this in self._open:
            raise NotTranslatable(f"{function.__name__} calls itself")
        self._alive += [each.value for each in values.values() if isinstance(each, Static)]
        self._open.append(this)
        try:
            made = self._translated(function, values)
        except NotTranslatable as error:
            if not hasattr(error, "where"):
                file, line = function.__code__.co_filename, getattr(error, "line", 1)
                error.where = f"{file}:{function.__code__.co_firstlineno + line - 1}"  # type: ignore[attr-defined]
            raise
        finally:
            self._open.pop()
        self.functions[this] = made
        return made

    def _translated(self, function: Callable[..., Any], values: dict[str, Value]) -> Function:
        tree, read = _parsed(function)
        world = {**function.__globals__, **inspect.getclosurevars(function).nonlocals}
        result = NEVER
        while True:
            writer, formals, targets = self._pass(tree, read, values, world, result)
            found = join(result, writer.returned)
            if found == result:
                break
            result = found
        name = self._name(function.__name__.lstrip("_"))
        single = result.detail if targets is None and result.form == "scalar" else None
        outputs = [] if targets is None else list(leaves(targets))
        heads = [self._formal(leaf) for leaf in formals]
        heads += [f"{c_type(leaf.kind)} *{leaf.text.strip('()*')}" for leaf in outputs]
        heads_text = ", ".join(["const parameters *p", *heads])
        lines = without_unused([*writer.top, *writer.lines])
        used = names("\n".join(lines))
        unused = [leaf for leaf in ["p", *(leaf.text for leaf in formals)] if leaf not in used]
        lines = [f"(void){each};" for each in unused] + lines
        kind = "void" if single is None else c_type(single)
        text = f"static {kind} {name}({heads_text})\n{{\n" + "\n".join(indented(lines)) + "\n}\n"
        written = tuple(isinstance(leaf, Array) and leaf.root.written for leaf in formals)
        return Function(name, result, single, written, text)

    def _pass(
        self,
        tree: ast.FunctionDef,
        read: frozenset[tuple[str, int]],
        values: dict[str, Value],
        world: dict[str, Any],
        result: Type,
    ) -> tuple[Statements, list[Scalar | Array], Value | None]:
        """Translate once, for a result of a type."""
        writer = Statements(self, {}, world, result)
        given = {k: arguments.formal(writer, k, v) for k, v in values.items()}
        formals = [leaf for each in given.values() for leaf in leaves(each)]
        writer.names, writer.read = dict(given), read
        targets = None
        if result.form not in {"never", "static", "scalar"}:
            targets = arguments.pointers(writer.storage(result, "out", []))
            writer.targets = targets
        writer.block(tree.body)
        if not writer.over:
            writer.returned = join(writer.returned, type_of(Static(None)))
            if writer.targets is not None:
                writer.finish(Static(None))
        return writer, formals, targets

    @staticmethod
    def _formal(leaf: Scalar | Array) -> str:
        if isinstance(leaf, Scalar):
            return f"{c_type(leaf.kind)} {leaf.text}"
        const = "" if leaf.root.written else "const "
        return f"{const}{c_type(leaf.kind)} *{leaf.text}"

    def _name(self, wanted: str) -> str:
        name, count = wanted, 1
        while name in self._names or name in RESERVED:
            count += 1
            name = f"{wanted}_{count}"
        self._names.add(name)
        return name


@cache
def _parsed(function: Callable[..., Any]) -> tuple[ast.FunctionDef, frozenset[tuple[str, int]]]:
    """A function's syntax tree, and the names that it reads with their lines."""
    tree = getattr(function, "placed", None)
    tree = tree or ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    return tree, frozenset(
        (each.id, each.lineno)
        for each in ast.walk(tree)
        if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Load)
    )
