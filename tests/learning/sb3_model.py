"""A model's file as Stable-Baselines3 writes it, with known weights."""

from __future__ import annotations

import io
import json
import zipfile
from typing import Any

import torch

BOX = {":type:": "<class 'gymnasium.spaces.box.Box'>", "low": "[-0.5]", "high": "[0.7]"}
ABOUT = {
    "policy_class": {"__module__": "stable_baselines3.common.policies"},
    "policy_kwargs": {},
    "observation_space": BOX,
    "action_space": BOX,
    "use_sde": False,
}
# Steers back, straightens, and follows the bend; the mean of a PPO without hidden layers.
LINEAR = {
    "action_net.weight": torch.tensor([[-0.06, -0.36, 1.8]]),
    "action_net.bias": torch.tensor([0.1]),
    "log_std": torch.zeros(1),
}
READS = ["lateral_error", "heading_error", {"kind": "road_curvatures", "count": 1}]
LIST = {"kind": "list", "features": READS}


def model(tensors: Any = LINEAR, **about: Any) -> bytes:
    """A model's file with these tensors."""
    weights, out = io.BytesIO(), io.BytesIO()
    torch.save(tensors, weights)
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("data", json.dumps(ABOUT | about))
        archive.writestr("policy.pth", weights.getvalue())
        archive.writestr("_stable_baselines3_version", "2.3.2")
    return out.getvalue()
