"""A classical controller of which a trained policy sets the parameters while it drives."""

from __future__ import annotations

from typing import Annotated, ClassVar

from steersman.config import Of, dump, param, register, required
from steersman.controllers.base import ControllerComponent
from steersman.controllers.policy import Policy
from steersman.errors import ConfigError
from steersman.policy_file import PolicyCard


@register("controller", "adaptive")
class Adaptive(Policy):
    """A base controller of which a policy sets the parameters; the base does all the steering.

    The policy is one of ``steersman train`` with ``problem.action=parameters``. The base's limits,
    its solver's status and its fallback are its own. docs/through.md
    """

    suffixes: ClassVar[tuple[str, ...]] = ()

    file: str = required("-", "A policy of action parameters: an ONNX file.")
    base: Annotated[ControllerComponent | None, Of("controller", optional=True)] = param(
        None,
        "-",
        "Base in place of the card's, of the same kind, for the fields that the policy does not "
        "set; null: the card's.",
    )

    def read(self) -> tuple[bytes, PolicyCard]:
        """The network's file, and its card with this base.

        Raises:
            DataError: the files are missing or corrupt.
            ConfigError: the policy sets no parameters, or those of another kind of controller.
        """
        data, card = super().read()
        if not card.parameters:
            raise ConfigError(
                f"{self.file}: its action is {card.action!r}; adaptive needs a policy trained with "
                "problem.action=parameters",
                ("file",),
            )
        if self.base is None:
            return data, card
        kind = (card.base or {}).get("kind")
        if self.base.kind != kind:
            raise ConfigError(
                f"{self.base.kind!r} is given, but {self.file} sets parameters of {kind!r}",
                ("base",),
            )
        return data, card.model_copy(update={"base": dump(self.base)})
