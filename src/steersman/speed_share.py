"""The second action of joint policies: which share of the wished speed the car may drive.

Shares are in [0, 1]. An action of 0 is the share that the base controller allows (1 without a base,
or if that sets no limit), -1 is standstill, 1 as fast as wished, and linear between.
"""

from __future__ import annotations


def share_of(limit: float, wished: float) -> float:
    """A speed limit as a share of the wished speed, both in [m/s]; NaN is no limit.

    >>> share_of(8.0, 10.0), share_of(12.0, 10.0), share_of(float("nan"), 10.0), share_of(0.0, 0.0)
    (0.8, 1.0, 1.0, 1.0)
    """
    if not limit < wished:
        return 1.0
    return max(limit, 0.0) / wished


def share_under(action: float, base: float) -> float:
    """The share under an action in [-1, 1], and a base's share.

    >>> share_under(0.0, 0.6), share_under(-0.5, 0.6), share_under(0.5, 0.6), share_under(2.0, 1.0)
    (0.6, 0.3, 0.8, 1.0)
    """
    bounded = min(max(action, -1.0), 1.0)
    if bounded < 0.0:
        return base * (1.0 + bounded)
    return base + bounded * (1.0 - base)


def action_for(share: float, base: float) -> float:
    """The action in [-1, 1] that leads from a base's share to another one.

    >>> action_for(0.5, 0.5), action_for(0.25, 0.5), action_for(0.75, 0.5), action_for(1.0, 1.0)
    (0.0, -0.5, 0.5, 0.0)
    """
    if share < base:
        return share / base - 1.0
    if base < 1.0:
        return (share - base) / (1.0 - base)
    return 0.0
