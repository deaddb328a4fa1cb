"""XML files of unknown origin: read without entities and network, every fault with its line."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman.errors import DataError, shortened, suggestion
from steersman.files import read_bytes

if TYPE_CHECKING:
    from lxml import etree

MAX_BYTES = 100_000_000
"""Largest file that is read."""
MAX_ELEMENTS = 1_000_000
"""Most elements of a file: they take ten times its size in memory, and some 50 us each."""
FARTHEST = 1e8
"""Largest number of any kind: more is no metre, no radian and no curvature."""
_CURE = "give an OpenDRIVE file (*.xodr)"


class Node:
    """An element and the file it stands in; names are compared without their namespace."""

    def __init__(self, file: FilePath, element: etree._Element) -> None:
        """``element`` was read from ``file``."""
        self.file, self._element = file, element
        self.tag = _plain(str(element.tag))

    @property
    def line(self) -> int:
        """Line of the file, from 1."""
        return int(getattr(self._element, "sourceline", None) or 0)

    def fault(self, text: str) -> DataError:
        """The error to raise about this element."""
        return DataError(f"{self.file}: line {self.line}: <{self.tag}>: {text}")

    def children(self, *tags: str) -> list[Node]:
        """Child elements with one of these names (all of them without names), in order."""
        found = [Node(self.file, child) for child in self._element.iterchildren("*")]
        return [node for node in found if not tags or node.tag in tags]

    def child(self, tag: str) -> Node | None:
        """The first child of that name."""
        return next(iter(self.children(tag)), None)

    def down(self, *tags: str) -> list[Node]:
        """What is found by going from child to child by these names."""
        found = [self]
        for tag in tags:
            found = [child for node in found for child in node.children(tag)]
        return found

    def get(self, name: str, default: str | None = None) -> str:
        """An attribute's text.

        Raises:
            DataError: it is missing and there is no default.
        """
        value = self._element.get(name, default)
        if value is None:
            names = [str(key) for key in self._element.keys()]  # noqa: SIM118 - no mapping
            raise self.fault(f"{name} is missing{suggestion(name, names) if names else ''}")
        return str(value).strip()

    def set(self, name: str, value: str) -> None:
        """Change an attribute."""
        self._element.set(name, value)

    def written(self) -> bytes:
        """The element with all that is in it, as a file."""
        from lxml import etree

        return bytes(etree.tostring(self._element))

    def number(self, name: str, default: float | None = None, low: float = -FARTHEST) -> float:
        """A finite number.

        Raises:
            DataError: it is missing, no number, or out of range.
        """
        text = self.get(name, None if default is None else repr(default))
        try:
            value = float(text)
        except ValueError:
            raise self.fault(f"{name} is {shortened(text)!r}, not a number") from None
        if not (math.isfinite(value) and low <= value <= FARTHEST):
            allowed = f"{low:g} to {FARTHEST:g}"
            raise self.fault(f"{name} is {shortened(text)}, not within {allowed}")
        return value

    def integer(self, name: str) -> int:
        """A whole number.

        Raises:
            DataError: it is missing or no whole number of usual size.
        """
        text = self.get(name)
        try:
            value = int(text)
        except ValueError:
            raise self.fault(f"{name} is {shortened(text)!r}, not a whole number") from None
        if abs(value) > FARTHEST:
            raise self.fault(f"{name} is {shortened(text)}, too large")
        return value

    def choice(self, name: str, allowed: dict[str, Any], default: str | None = None) -> Any:
        """What the attribute's word stands for.

        Raises:
            DataError: the word is none of ``allowed``.
        """
        word = self.get(name, default)
        if word not in allowed:
            raise self.fault(f"{name} is {shortened(word)!r}{suggestion(word, allowed)}")
        return allowed[word]


def parse(file: FilePath, cure: str = _CURE) -> tuple[Node, str]:
    """The root element of an XML file, and the SHA-256 of the file.

    Raises:
        DataError: the file cannot be read, is too large, or no XML without a document type.
    """
    from lxml import etree

    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
    )
    data = read_bytes(file, cure, MAX_BYTES)
    if not data.strip():
        raise DataError(f"{file}: is empty; {cure}")
    digest = hashlib.sha256(data).hexdigest()
    try:
        root = etree.fromstring(_without_late_declaration(data), parser)
    except etree.XMLSyntaxError as error:
        line, text = error.lineno or 1, str(error.msg).partition(", line ")[0]
        raise DataError(f"{file}: line {line}: not valid XML: {text.strip()}") from None
    except ValueError as error:
        raise DataError(f"{file}: not valid XML: {error}") from None
    # Entities can make a small file huge and open other files; roads need none.
    if getattr(root.getroottree().docinfo, "doctype", ""):
        raise DataError(f"{file}: has a document type (<!DOCTYPE>), which is not read; remove it")
    if sum(1 for _ in root.iter()) > MAX_ELEMENTS:
        raise DataError(f"{file}: has more than {MAX_ELEMENTS} elements")
    return Node(file, root), digest


def _plain(tag: str) -> str:
    return tag.rpartition("}")[2]


def _without_late_declaration(data: bytes) -> bytes:
    """The file without an XML declaration after blanks or comments, where none is allowed.

    Programs write it there all the same. Without it a file is in UTF-8.
    """
    at = 0
    while True:
        at = len(data) - len(data[at:].lstrip())
        if not data.startswith(b"<!--", at):
            break
        end = data.find(b"-->", at + 4)
        if end < 0:
            return data
        at = end + 3
    end = data.find(b"?>", at)
    if at == 0 or end < 0 or not data.startswith(b"<?xml", at):
        return data
    return data[:at] + b" " * (end + 2 - at) + data[end + 2 :]
