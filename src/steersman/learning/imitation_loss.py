"""An imitation loss for the actors of Stable-Baselines3, as a part of their own updates."""

from __future__ import annotations

from typing import Any

import torch


def imitate(
    policy: Any, critic: Any, batch: tuple[Any, Any], weight: float, *, q_filter: bool
) -> None:
    """Add the gradient of weight * mean |mu(s) - demonstrated action|^2 to the actor's.

    Called between the backward pass of the actor's own loss and its step, so that the step
    descends the sum of both. Samples without a demonstrated action count as zero.

    Args:
        policy: of which the actor's mean action is mu.
        critic: rates actions; the least of its values counts.
        batch: observations (B, k) and demonstrated actions (B, m), NaN where there is none.
        weight: of the loss.
        q_filter: leave out samples whose demonstrated action the critic does not rate above mu(s).

    Source: Nair et al., Overcoming exploration in reinforcement learning with demonstrations, ICRA
    2018, equations 4 and 5.
    """
    observations, wanted = batch
    counts = ~torch.isnan(wanted)
    if weight == 0.0 or not counts.any():
        return
    wanted = torch.where(counts, wanted, 0.0)
    actions = policy._predict(observations, deterministic=True)
    if q_filter:
        with torch.no_grad():  # ``forward``, as a hook watches the calls of the update itself
            own, shown = (
                torch.min(torch.cat(critic.forward(observations, a), dim=1), dim=1, keepdim=True)[0]
                for a in (actions, wanted)
            )
        counts &= shown > own
    loss = weight * (counts * (actions - wanted) ** 2).sum(dim=1).mean()
    parameters = [p for p in policy.actor.parameters() if p.grad is not None]
    for p, more in zip(
        parameters, torch.autograd.grad(loss, parameters, allow_unused=True), strict=True
    ):
        if more is not None:
            p.grad += more
