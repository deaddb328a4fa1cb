"""What a policy's card names: its input's layout, and what it corrects or adjusts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from steersman.config import dump, resolve
from steersman.controllers.base import ControllerComponent
from steersman.controllers.process import Process
from steersman.encoding import EncodingComponent, Layout
from steersman.errors import ConfigError, DataError
from steersman.policy_file import LEARNED, PolicyCard
from steersman.provenance import missing_plugins


def card_layout(card: PolicyCard) -> Layout:
    """The layout that a card describes.

    Raises:
        DataError: the card contradicts itself.
        ConfigError: its encoding is unknown or holds values that are not allowed.
    """
    try:
        encoding = resolve("encoding", card.encoding)
    except ConfigError as error:
        lost = ", ".join(missing_plugins(card.versions))
        more = f"; the policy was made with {lost}, which is not installed" if lost else ""
        raise ConfigError(error.what + more, error.where) from None
    assert isinstance(encoding, EncodingComponent)
    action = "direct" if card.rate_limit is None else "rate"
    if card.base is not None:
        action = "parameters" if card.parameters else "residual"
    layout = encoding.layout(card.spacing, card.dt, action, joint=card.joint)
    if len(layout.names) != len(card.scale):
        raise DataError(f"{len(card.scale)} scales for {len(layout.names)} features")
    if layout.reads > card.waypoints:  # the kernel would read beyond the row
        raise DataError(
            f"its encoding reads {layout.reads} waypoints, but there are {card.waypoints}"
        )
    return layout


def card_base(card: PolicyCard) -> ControllerComponent | None:
    """The controller that a card's policy corrects or adjusts.

    Raises:
        ConfigError: it is unknown or holds values that are not allowed.
        DataError: it cannot be a base.
    """
    if card.base is None:
        return None
    base = resolve("controller", card.base)
    assert isinstance(base, ControllerComponent)
    try:
        check_base(base, joint=card.joint)
    except ValueError as error:
        raise DataError(str(error)) from None
    return base


def card_parameters(card: PolicyCard) -> dict[str, str | tuple[Any, ...]]:
    """The fields of the base that a card's policy sets, as :func:`adjustments` takes them."""
    given = card.parameters or {}
    return {name: each if isinstance(each, str) else tuple(each) for name, each in given.items()}


def check_base(base: ControllerComponent, *, joint: bool) -> None:
    """Refuse a base that no card can describe, or of which a policy would use a half.

    Args:
        base: the controller.
        joint: whether the policy chooses the speed, too.

    Raises:
        ValueError: the base holds a policy, whose file would have to travel with the card, or a
            program, which would run wherever the card is read; or it limits the speed, and the
            policy is not joint.
    """
    if base.limits_speed() and not joint:
        raise ValueError(
            f"base {base.kind!r} limits the speed, which this policy would not; set joint=true "
            "(with action=residual), or name a controller that only steers"
        )
    if any(_holds(dump(base), kind) for kind in LEARNED):
        raise ValueError("a policy cannot be the base, as its file is no part of the card")
    if _holds(dump(base), Process.kind):
        raise ValueError("a program cannot be the base: no card may start one")


def _holds(data: Any, kind: str) -> bool:
    if isinstance(data, list):
        return any(_holds(each, kind) for each in data)
    if not isinstance(data, Mapping):
        return False
    return data.get("kind") == kind or any(_holds(each, kind) for each in data.values())
