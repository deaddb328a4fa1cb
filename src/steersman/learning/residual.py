"""A residual agent begins as its base: the output layers of its networks for the action are zero.

Silver, Allen, Tenenbaum and Kaelbling, Residual policy learning, arXiv:1812.06298, 2018: a
random network would spoil the base from the first step on, and all that is collected with it. Zero
weights of the last layer alone leave it a gradient, as the hidden units differ.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from torch import nn


def start_at_zero(policy: Any) -> None:
    """Make the mean action of an SB3 policy (and of its target) zero, whatever is seen."""
    with torch.no_grad():
        for layer in _outputs(policy):
            for parameter in layer.parameters():
                parameter.zero_()


def _outputs(policy: Any) -> Iterator[nn.Module]:
    """Layers whose output is the mean action before it is squashed."""
    for name in ("actor", "actor_target"):
        if hasattr(policy, name):
            mean = getattr(policy, name).mu
            linear = [layer for layer in mean.modules() if isinstance(layer, nn.Linear)]
            yield linear[-1]
    if hasattr(policy, "action_net"):
        yield policy.action_net
