"""Lines of C: without what nothing reads, indented, expressions without brackets around them."""

from __future__ import annotations

import re
from collections import Counter

_LOCAL = re.compile(r"\s*(?:const )?(?:real|int) (\w+)(?:\[\d+\])?(?: = (?!.*/\* kept \*/).*)?;")
_STORED = re.compile(r"\s*(\w+) = (?!.*\b\1\b).*;")
_KEPT = re.compile(r"\s*(?:real|int) (\w+) = (.*;) /\* kept \*/")
_NAME = re.compile(r"[A-Za-z_]\w*")


def names(text: str) -> set[str]:
    """All names in a text of C."""
    return set(_NAME.findall(text))


def bare(text: str) -> str:
    """An expression without the brackets around it."""
    depth = 0
    for i, each in enumerate(text):
        depth += (each == "(") - (each == ")")
        if depth == 0 and i < len(text) - 1:
            return text
    return text[1:-1] if text.startswith("(") else text


def without_unused(lines: list[str]) -> list[str]:
    """The lines without local variables that nothing reads; of a call that writes it stays."""
    while True:
        count = Counter(name for each in lines for name in _NAME.findall(each))
        written = Counter(m[1] for each in lines if (m := _STORED.fullmatch(each)))
        declared = {m[1] for each in lines if (m := _LOCAL.fullmatch(each))}
        unread = {name for name in declared if count[name] == 1 + written[name]}
        kept = [
            each
            for each in lines
            if not any((m := form.fullmatch(each)) and m[1] in unread for form in (_LOCAL, _STORED))
        ]
        if len(kept) == len(lines):
            answers = [_KEPT.fullmatch(each) for each in kept]
            return [
                f"(void){m[2]}" if m and count[m[1]] == 1 else each
                for each, m in zip(kept, answers, strict=True)
            ]
        lines = kept


def indented(lines: list[str]) -> list[str]:
    """Lines indented by their braces."""
    out, depth = [], 1
    for each in lines:
        depth -= each.startswith("}")
        out.append(f"{'    ' * depth}{each}")
        depth += each.endswith("{")
    return out
