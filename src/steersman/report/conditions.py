"""Drives on one road that are worth a look together: those under the same conditions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from steersman.report.scene import Group
from steersman.report.seen import recorded
from steersman.report.signals import Drive
from steersman.report.tables import flat, text

CROWD = 6
"""Up to so many drives are shown together whatever their conditions."""
# Parts of a configuration that are no conditions: the controller, and what the group shares.
_OTHERS = ("controller", "path", "seed")


def by_conditions(group: Group) -> list[Group]:
    """The group, or, of a crowd, one group for each set of conditions; their titles tell them."""
    if len(group.drives) <= CROWD:
        return [group]
    found = [_conditions(drive) for drive in group.drives]
    keys = list(dict.fromkeys(key for one in found for key in one))
    # Fields that only some kinds have differ if those that have them do.
    differ = [k for k in keys if len({json.dumps(one[k]) for one in found if k in one}) > 1]
    parts: dict[str, list[Drive]] = {}
    for drive, one in zip(group.drives, found, strict=True):
        words = ", ".join(f"{key} {text(one[key])}" for key in differ if key in one)
        parts.setdefault(words, []).append(drive)
    # Where every drive is on its own, nothing is gained.
    if len(parts) in {1, len(found)}:
        return [group]
    return [_named(group, words, drives) for words, drives in parts.items()]


def _conditions(drive: Drive) -> dict[str, Any]:
    config: Mapping[str, Any] = recorded(drive.episode)
    return flat({key: value for key, value in config.items() if key not in _OTHERS})


def _named(group: Group, words: str, drives: Sequence[Drive]) -> Group:
    title = f"{group.title}: {words}" if words else f"{group.title}: conditions not recorded"
    return group._replace(title=title, drives=drives)
