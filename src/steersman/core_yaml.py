"""YAML as version 1.2 reads it (its core schema, https://yaml.org/spec/1.2.2/#103-core-schema).

PyYAML follows version 1.1, in which ``no`` is false, ``1e-3`` is text, ``010`` is 8, ``1:30`` is
90 and ``2026-01-01`` is a date. In a configuration each of these is a mistake that stays unseen,
and a key that stands twice silently counts once; here it is an error.
"""

from __future__ import annotations

import re
from pathlib import Path as FilePath
from typing import Any, TypeVar

import yaml

from steersman.errors import DataError

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
_FLOW_OR_QUOTED = ("[", "{", '"', "'")

_R = TypeVar("_R", type[yaml.SafeLoader], type[yaml.SafeDumper])


def _with_core_rules(cls: _R) -> _R:
    for tag, pattern, first in _CORE:
        # \Z, for "$" would let a line feed follow.
        cls.add_implicit_resolver(tag, re.compile(rf"(?:{pattern})\Z"), first)
    return cls


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - PyYAML's own way

    def construct_int(self, node: yaml.ScalarNode) -> int:
        """Decimal unless it says otherwise: 010 is ten."""
        text = node.value
        return int(text, 0) if text[:2] in {"0o", "0x"} else int(text)

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Refuse a key that stands twice."""
        node = super().compose_mapping_node(anchor)
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"{key.value!r} stands twice", problem_mark=key.start_mark
                )
            seen.add(str(key.value))
        return node


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
    """
    if text.lstrip().startswith(_FLOW_OR_QUOTED):
        try:
            return load(text)
        except yaml.YAMLError:
            return text
    loader = _Loader("")
    tag = loader.resolve(yaml.ScalarNode, text, (True, False))  # type: ignore[no-untyped-call]
    if tag == f"{_TAG}merge":  # means something as a key only
        return text
    return loader.construct_object(yaml.ScalarNode(tag, text))


def read_yaml(file: FilePath | str) -> dict[str, Any]:
    """A YAML file that holds one mapping.

    Raises:
        DataError: the file is missing, not YAML, or not a mapping.
    """
    try:
        data = load(FilePath(file).read_text(encoding="utf-8"))
    except OSError as error:
        missing = isinstance(error, FileNotFoundError)
        fault = "no such file" if missing else f"cannot be read ({error.strerror})"
        raise DataError(f"{file}: {fault}") from None
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
