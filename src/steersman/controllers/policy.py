"""A trained policy as a controller: ONNX network, encoding from its card, nothing unpickled."""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple

import numpy as np

from steersman.config import param, register
from steersman.controllers.adjustment import Adjuster, adjustments
from steersman.controllers.base import ControllerComponent, within_limits
from steersman.controllers.card import card_base, card_layout, card_parameters
from steersman.controllers.plausible import ACROSS, moving_time
from steersman.errors import ConfigError, DataError
from steersman.kernels import encode as kernel
from steersman.kernels import observe
from steersman.kernels.encode import EncodingTable
from steersman.network_file import PolicyNetwork
from steersman.policy_file import PolicyCard, locate, read_policy
from steersman.sensing import to_observation, to_row
from steersman.speed_share import share_of, share_under
from steersman.types import CarAhead, Decision, FloatArray, Observation, Status
from steersman.vehicles import Vehicle

# Periods [s] and distances [m] that differ by less are the same but for rounding.
_SAME = 1e-9


class PolicyState(NamedTuple):
    """The network, its input's layout, and the little memory that the encoding keeps."""

    run: Any
    """Maps float32 features (1, n) to actions (m,) in [-1, 1]."""
    table: EncodingTable
    features: int
    memory: FloatArray
    rate_step: float
    """Largest change of steering in one step, 0 for direct actions."""
    waypoints: int
    trim: float
    """Rate of the integral loop around the network [1/s]."""
    shift: float
    """Shift to the right of the path in the network's input [m]."""
    base: ControllerComponent | None = None
    """The controller whose steering the action corrects."""
    authority: float = 0.0
    """Largest correction of normalised steering."""
    base_state: Any = None
    """The base's state; where actions set its parameters, an :class:`Adjusted`."""
    base_share: float = 1.0
    """Share of the base's steering that is corrected."""
    adjuster: Adjuster | None = None
    """Sets the base's parameters; None: the action is a steering, a rate or a correction."""
    period: int = 1
    """Control steps for which an action holds."""
    held: int = 0
    """Control steps for which the present one has held."""
    joint: bool = False
    """Whether a second action is the speed."""
    ahead: bool = False
    """Whether a feature needs a car ahead."""
    limit: float = math.nan
    """The largest speed for the next control period [m/s]."""


@register("controller", "policy")
class Policy(ControllerComponent):
    """A trained policy: one of the package, or a file of ``steersman train`` with its card.

    If the card names a base controller, the network corrects that one's steering or sets its
    parameters; in the second case all steering, limits and fallbacks are the base's.

    Around the network an integral loop may be closed: network and base get a path that is shifted
    away from the car at a rate of ``trim`` times the lateral error. If they settle beside the
    shifted path, the shift grows until the car itself is on the true path.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".onnx",)

    file: str = param("precision", "-", "A policy of the package, or an ONNX file.")
    trim: float | None = param(
        None, "1/s", "Rate of the integral loop; null: as the card says.", ge=0, le=10
    )
    trim_speed: float = param(0.01, "m/s", "Largest speed of the path's shift.", ge=0)
    trim_limit: float = param(0.3, "m", "Longest shift of the path.", ge=0)

    def init(self, vehicle: Vehicle, dt: float) -> PolicyState:
        """Load the network and its base, and check that they fit this loop.

        Raises:
            DataError: the files are missing or corrupt.
            ConfigError: the policy was trained for another control period.
        """
        data, card = self.read()
        if abs(card.dt - dt) > _SAME:
            raise ConfigError(
                f"{self.file}: trained for a control period of {card.dt} s, but plant.dt is {dt} s"
            )
        try:
            base, layout = card_base(card), card_layout(card)
            table = layout.table
            chosen = adjustments(base, card_parameters(card)) if base is not None else ()
        except (ConfigError, DataError) as error:
            raise DataError(f"{self.file}: card: {error}") from None
        adjuster = Adjuster(base, chosen, vehicle, dt) if base is not None and chosen else None
        base_state = adjuster.begin() if adjuster else base and base.init(vehicle, dt)
        memory = np.zeros(kernel.memory_size(table))
        step = 0.0 if card.rate_limit is None else card.rate_limit * dt
        return PolicyState(
            PolicyNetwork(data, self.file, len(card.scale), card.actions),
            table,
            len(card.scale),
            memory,
            step,
            card.waypoints,
            card.trim if self.trim is None else self.trim,
            0.0,
            base,
            card.authority or 0.0,
            base_state,
            card.base_share,
            adjuster,
            card.period,
            joint=card.joint,
            ahead=any(feature.lead for feature in layout.features),
        )

    def read(self) -> tuple[bytes, PolicyCard]:
        """The network's file and its card.

        Raises:
            DataError: the files are missing or corrupt.
        """
        return read_policy(locate(self.file))

    def decide(
        self, state: PolicyState, observation: Observation
    ) -> tuple[float, Status, PolicyState]:
        """Normalised steering, unclipped; a fallback if the base's is one, or against the road."""
        table, status = state.table, Status.SOLVED
        if abs(observation.heading_error) > ACROSS:
            status = Status.FALLBACK
        row = to_row(observation, state.waypoints, table.spacing)
        shift = self._shift(state, observation)
        row[observe.O_D] += shift
        row[observe.O_PREVIEW + 1 :: 2] -= shift
        memory = state.memory.copy()
        if state.joint:
            kernel.see_wishes(self._wished(observation), table.spacing, memory)
        if state.ahead:
            kernel.see_lead(*self._ahead(observation), memory)
        features = np.zeros(state.features)
        kernel.encode(table, row, memory, features)
        shifted = to_observation(row, observation.time, table.spacing)
        if state.joint:
            shifted = shifted._replace(wished=observation.wished, ahead=observation.ahead)
        state, start, allowed = state._replace(memory=memory, shift=shift), 0.0, math.nan
        if state.base is not None and state.adjuster is None:
            decision, after = state.base.step(state.base_state, shifted)
            state, start = state._replace(base_state=after), state.base_share * decision.steer
            allowed = decision.speed_limit
            status = decision.status if decision.status is Status.FALLBACK else status
            kernel.tell_base(table, row, memory, start, features)
        if state.adjuster is not None:
            decision, state = self._through(state, features, shifted)
            steer, status = decision.steer, max(decision.status, status)
        else:
            answer = network_answer(state, features)
            action = steer = float(answer[0])
            if state.joint:
                wished = float(observation.wished[0])
                share = share_under(float(answer[1]), share_of(allowed, wished))
                memory[kernel.LAST_SHARE] = share
                state = state._replace(limit=share * wished)
            if state.rate_step > 0.0:
                steer = memory[kernel.LAST_COMMAND] + action * state.rate_step
            elif state.base is not None:
                steer = start + state.authority * action
        kernel.remember(table, row, memory, within_limits(steer))
        state = state._replace(memory=memory)
        return float(steer), status, self.executed(state, float(within_limits(steer)))

    def speed_limit(self, state: PolicyState) -> float:
        """What a joint policy allows [m/s]; else NaN."""
        return state.limit

    def limits_speed(self) -> bool:
        """Whether its second action is the speed."""
        return self.read()[1].joint

    def follows(self) -> bool:
        """Whether its network or its base reads the gap to a car ahead."""
        card = self.read()[1]
        base = card_base(card)
        read = any(feature.lead for feature in card_layout(card).features)
        return read or (base is not None and base.follows())

    def _wished(self, observation: Observation) -> FloatArray:
        """The speeds wished ahead [m/s]; a ConfigError, if there are none."""
        if not len(observation.wished):
            what = "takes a share of the wished speed, but none is wished; set speed=constant_speed"
            raise ConfigError(f"{self.file}: {what}, or another but constant_throttle")
        return observation.wished

    def _ahead(self, observation: Observation) -> CarAhead:
        """The car ahead; a ConfigError, if there is none."""
        if observation.ahead is None:
            raise ConfigError(f"{self.file}: needs a car ahead; set lead.speed=nedc, say")
        return observation.ahead

    def _through(
        self, state: PolicyState, features: FloatArray, observation: Observation
    ) -> tuple[Decision, PolicyState]:
        """The base's decision under the parameters that the network gave last."""
        assert state.adjuster is not None
        adjusted = state.base_state
        if state.held == 0:
            adjusted = state.adjuster.adjust(adjusted, network_answer(state, features))
        decision, adjusted = adjusted.step(observation)
        held = (state.held + 1) % state.period
        return decision, state._replace(base_state=adjusted, held=held)

    def executed(self, state: PolicyState, steer: float) -> PolicyState:
        """The executed command becomes the last command of the network and of its base."""
        if state.adjuster is not None:
            state = state._replace(base_state=state.base_state.executed(steer))
        elif state.base is not None:
            state = state._replace(base_state=state.base.executed(state.base_state, steer))
        if steer == state.memory[kernel.LAST_COMMAND]:
            return state
        memory = state.memory.copy()
        memory[kernel.LAST_COMMAND] = steer
        return state._replace(memory=memory)

    def _shift(self, state: PolicyState, observation: Observation) -> float:
        """The shift of this step; at standstill it stays as it is."""
        speed = state.trim * observation.lateral_error
        speed = min(max(speed, -self.trim_speed), self.trim_speed)
        shift = state.shift + speed * moving_time(observation.v_x, state.table.dt)
        return min(max(shift, -self.trim_limit), self.trim_limit)


def network_answer(state: PolicyState, features: FloatArray) -> Any:
    """The network's actions (m,)."""
    with np.errstate(over="ignore"):  # the network clips: infinity is as good as 1e300
        single = features.astype(np.float32)
    return state.run(single[None, :])
