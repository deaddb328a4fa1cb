"""Every learning algorithm fulfils the contract that plug-ins are held to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.config import components
from steersman.contracts.agent import check
from steersman.learning.algorithms.td3 import Td3


@pytest.mark.parametrize("kind", components("agent"))
def test_contract(kind: str) -> None:
    agent: Any = components("agent")[kind]
    assert check(agent) == []


def test_what_does_otherwise_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    class Careless(Td3):
        """Seeds nothing and answers beyond the limits."""

        def make(self, config: Any, env: Any) -> Any:
            made = super().make(config, env)
            made.actor_net().flat[:] += np.random.default_rng().normal(size=1).astype(np.float32)
            made.act = lambda features: np.full((len(features), 1), 2.0)  # type: ignore[method-assign]
            return made

    Careless.kind = "td3"
    found = [text.partition(": ")[2] for text in check(Careless)]
    assert "act gives no actions (n, m) in [-1, 1]" in found
    assert "act and predict(deterministic=True) differ" in found
    assert "the same seed gives other weights" in found
