"""YAML as version 1.2 reads it (its core schema, https://yaml.org/spec/1.2.2/#103-core-schema).

PyYAML follows version 1.1, in which ``no`` is false, ``1e-3`` is text, ``010`` is 8, ``1:30`` is
90 and ``2026-01-01`` is a date. In a configuration each of these is a mistake that stays unseen,
and a key that stands twice silently counts once; here it is an error.

A file of unknown origin costs little: its size, the depth to which it nests, the number of values
after aliases are followed, and the digits of a number are bounded.
"""

from __future__ import annotations

import itertools
import re
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.resolver import Resolver

from steersman.bounds import DEEPEST, MOST_DIGITS
from steersman.errors import ConfigError, DataError, near_file, shortened

_TAG = "tag:yaml.org,2002:"
_CORE = [
    (f"{_TAG}null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    (f"{_TAG}bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    (f"{_TAG}int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    (
        f"{_TAG}float",
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
    (f"{_TAG}merge", r"<<", ["<"]),  # 1.1 only, but people use it
]
_UNFOLDED = 1_000_000
_KINDS = ("null", "bool", "float", "str", "seq", "map")
MOST_BYTES, MOST_VALUES = 1_000_000, 100_000
"""Bounds of a file: its size, and its values with aliases followed."""
_FLOW_OR_QUOTED = ("[", "{", '"', "'")

_R = TypeVar("_R", type[yaml.SafeLoader], type[yaml.SafeDumper])


def _with_core_rules(cls: _R) -> _R:
    for tag, pattern, first in _CORE:
        # \Z, for "$" would let a line feed follow.
        cls.add_implicit_resolver(tag, re.compile(rf"(?:{pattern})\Z"), first)
    return cls


class _Extent(NamedTuple):
    """How much stands below a node, with aliases followed."""

    values: int
    depth: int


if TYPE_CHECKING or not yaml.__with_libyaml__:
    _Base = yaml.SafeLoader
else:

    class _Base(Composer, yaml.cyaml.CParser, SafeConstructor, Resolver):
        """PyYAML's composer on libyaml's parser, which is far faster than PyYAML's own."""

        def __init__(self, text: str) -> None:
            yaml.cyaml.CParser.__init__(self, text)
            Composer.__init__(self)
            SafeConstructor.__init__(self)
            Resolver.__init__(self)


class _Loader(_Base):
    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - PyYAML's own way
    # Dates, sets and binary data are no part of the core schema.
    yaml_constructors = {  # noqa: RUF012
        tag: yaml.SafeLoader.yaml_constructors[tag]
        for tag in (None, *(f"{_TAG}{kind}" for kind in _KINDS))
    }

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth, self._extents = 0, dict[int, _Extent]()

    def construct_int(self, node: yaml.ScalarNode) -> int:
        """Decimal unless it says otherwise: 010 is ten."""
        text = self.construct_scalar(node)
        if len(text) > MOST_DIGITS:
            raise _bound(f"a number has more than {MOST_DIGITS} digits", node)
        return int(text, 0) if text[:2] in {"0o", "0x"} else int(text)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Refuse a text that is not what its tag says."""
        try:
            return super().construct_object(node, deep=deep)
        except (ValueError, LookupError, AttributeError):
            kind = node.tag.removeprefix(_TAG)
            raise _fault(f"{shortened(str(node.value))!r} is no {kind}", node) from None

    def compose_node(self, parent: Any, index: Any) -> yaml.Node:
        """Refuse what nests too deep, holds too much, or holds itself."""
        self._depth += 1
        if self._depth > DEEPEST:
            raise _bound(f"nests deeper than {DEEPEST} levels", self.peek_event())  # type: ignore[no-untyped-call]
        again = self.check_event(yaml.AliasEvent)
        node = super().compose_node(parent, index)
        self._depth -= 1
        assert node is not None  # the stream's end is no node
        if again and id(node) not in self._extents:
            raise _bound("an alias stands for what it is a part of", node)
        found = self._extents[id(node)] if again else self._extent(node)
        self._extents[id(node)] = found
        if self._depth + found.depth > DEEPEST:
            raise _bound(f"nests deeper than {DEEPEST} levels", node)
        if found.values > MOST_VALUES:
            raise _bound(f"holds more than {MOST_VALUES} values, aliases followed", node)
        return node

    def _extent(self, node: yaml.Node) -> _Extent:
        """That of a new node, whose children are known."""
        if isinstance(node, yaml.ScalarNode):
            return _Extent(1, 1)
        inner = itertools.chain(*node.value) if isinstance(node, yaml.MappingNode) else node.value
        below = [self._extents[id(child)] for child in inner]
        depth = max((each.depth for each in below), default=0)
        return _Extent(1 + sum(each.values for each in below), 1 + depth)

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Refuse a key that stands twice."""
        node = super().compose_mapping_node(anchor)
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in seen:
                raise _fault(f"{key.value!r} stands twice", key)
            seen.add(str(key.value))
        return node


class _BoundExceeded(yaml.MarkedYAMLError):
    """The text is YAML, but of a size that is not read."""


def _bound(problem: str, where: Any) -> _BoundExceeded:
    return _BoundExceeded(problem=problem, problem_mark=where.start_mark)


def _fault(problem: str, where: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=where.start_mark)


class _Dumper(yaml.SafeDumper):
    """Quotes whatever either version of YAML would take for something else than text."""


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    # Escape all that is not printable: PyYAML folds lone line separators away.
    return dumper.represent_scalar(f"{_TAG}str", text, None if text.isprintable() else '"')


_with_core_rules(_Loader).add_constructor(f"{_TAG}int", _Loader.construct_int)
_with_core_rules(_Dumper).add_representer(str, _represent_text)


def load(text: str) -> Any:
    """The data in a YAML text.

    Raises:
        yaml.YAMLError: it is not valid.
    """
    return yaml.load(text, _Loader)  # a SafeLoader: builds plain data only


def dump(data: Any) -> str:
    """Plain data as YAML, in the order given."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=_UNFOLDED)


def value(text: str) -> Any:
    """What stands after the "=" of an assignment: a list, a mapping, a quoted text, or a scalar.

    >>> [value(text) for text in ("1e-3", "20", "true", "no", "0..4", "[1, 2]", "'5'", "a: b #1")]
    [0.001, 20, True, 'no', '0..4', [1, 2], '5', 'a: b #1']

    Raises:
        ConfigError: it nests too deep, or has too many digits.
    """
    loader = _Loader("")
    try:
        if text.lstrip().startswith(_FLOW_OR_QUOTED):
            return load(text)
        tag = loader.resolve(yaml.ScalarNode, text, (True, False))  # type: ignore[no-untyped-call]
        if tag == f"{_TAG}merge":  # means something as a key only
            return text
        return loader.construct_object(yaml.ScalarNode(tag, text))
    except _BoundExceeded as error:
        raise ConfigError(f"{shortened(text)!r}: {error.problem}") from None
    except yaml.YAMLError:
        return text


def read_yaml(file: FilePath | str) -> dict[str, Any]:
    """A YAML file that holds one mapping.

    Raises:
        DataError: the file is missing, not YAML, or not a mapping.
    """
    try:
        with FilePath(file).open("rb") as stream:
            text = stream.read(MOST_BYTES + 1)
        if len(text) > MOST_BYTES:
            raise DataError(f"{file}: is larger than {MOST_BYTES // 1_000_000} MB, the most read")
        data = load(text.decode("utf-8"))
    except DataError:
        raise
    except OSError as error:
        missing = isinstance(error, FileNotFoundError)
        fault = "no such file" if missing else f"cannot be read ({error.strerror})"
        near = near_file(str(file), (".yaml", ".yml")) if missing else ""
        raise DataError(f"{file}: {fault}{'; ' * bool(near)}{near}") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"line {mark.line + 1}: " if mark is not None else ""
        raise DataError(f"{file}: {line}not valid YAML: {error.problem}") from None
    except (yaml.YAMLError, ValueError) as error:  # not UTF-8, or control characters
        line = " ".join(str(error).split())
        raise DataError(f"{file}: not valid YAML: {line}") from None
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise DataError(f"{file}: holds a {type(data).__name__}, expected key: value pairs")
    return data
