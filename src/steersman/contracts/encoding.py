"""What every encoding has to fulfil."""

from __future__ import annotations

from collections.abc import Iterator

from steersman.contracts import Contract
from steersman.contracts import feature as feature_contract
from steersman.encoding import EncodingComponent
from steersman.registry import components

ACTIONS = ("rate", "direct", "residual")


def names_are_unique_and_sizes_equal(encoding: EncodingComponent) -> Iterator[str]:
    """For each kind of action, as many names as scales, signs and numbers."""
    for action in ACTIONS:
        layout = encoding.layout(2.0, 0.05, action)
        found = [*feature_contract.declared(layout), *feature_contract.driven(layout)]
        yield from (f"action {action}: {text}" for text in found)


def its_features_are_registered(encoding: EncodingComponent) -> Iterator[str]:
    """A policy's card names them by their kinds."""
    for feature in encoding.layout(2.0, 0.05, "residual").features:
        if components("feature").get(feature.kind) is not type(feature):
            yield f"{type(feature).__name__} is no registered feature"


check: Contract[EncodingComponent] = Contract(
    names_are_unique_and_sizes_equal, its_features_are_registered
)
