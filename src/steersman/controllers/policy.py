"""A trained policy as a controller: ONNX network, encoding from its card, nothing unpickled."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from steersman.config import param, register, resolve
from steersman.controllers.base import ControllerComponent
from steersman.encoding import EncodingComponent
from steersman.errors import ConfigError, DataError, one_line
from steersman.kernels import encode as kernel
from steersman.kernels import observe
from steersman.kernels.encode import EncodingTable
from steersman.policy_file import PolicyCard, locate, read_policy
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

# Periods [s] and distances [m] that differ by less are the same, written differently.
_SAME = 1e-9


class PolicyState(NamedTuple):
    """The network, its input's layout, and the little memory that the encoding keeps."""

    run: Any
    """Maps float32 features (1, n) to an action (1, 1) in [-1, 1]."""
    table: EncodingTable
    features: int
    memory: FloatArray
    rate_step: float
    """Largest change of steering in one step, 0 for direct actions."""
    waypoints: int
    trim: float
    """Rate of the integral loop around the network [1/s]."""
    shift: float
    """How far the path that the network is told lies to the right of the true one [m]."""


@register("controller", "policy")
class Policy(ControllerComponent):
    """A trained policy: one of the package, or a file of ``steersman train`` with its card.

    Around the network an integral loop may be closed: it is told of a path that moves away from
    the car at ``trim`` times the lateral error. Wherever the network lets the car settle beside
    the path that it is told, the shift grows until the car itself is on the path.
    """

    file: str = param("precision", "-", "A policy of the package, or an ONNX file.")
    trim: float | None = param(
        None, "1/s", "Rate of the integral loop; null: as the card says.", ge=0, le=10
    )
    trim_speed: float = param(0.01, "m/s", "Largest speed of the path's shift.", ge=0)
    trim_limit: float = param(0.3, "m", "Longest shift of the path.", ge=0)

    def init(self, vehicle: Vehicle, dt: float) -> PolicyState:
        """Load the network and check that it belongs into this loop.

        Raises:
            DataError: the files are missing or corrupt.
            ConfigError: the policy was trained for another control period.
        """
        data, card = read_policy(locate(self.file))
        if abs(card.dt - dt) > _SAME:
            raise ConfigError(
                f"{self.file}: trained for a control period of {card.dt} s, but plant.dt is {dt} s"
            )
        try:
            table = card_table(card)
        except (ConfigError, DataError) as error:
            raise DataError(f"{self.file}: card: {error}") from None
        memory = np.zeros(kernel.memory_size(table))
        step = 0.0 if card.rate_limit is None else card.rate_limit * dt
        return PolicyState(
            load_network(data, self.file, len(card.scale)),
            table,
            len(card.scale),
            memory,
            step,
            card.waypoints,
            card.trim if self.trim is None else self.trim,
            0.0,
        )

    def decide(
        self, state: PolicyState, observation: Observation
    ) -> tuple[float, Status, PolicyState]:
        """Normalised steering, unclipped."""
        table = state.table
        row = to_row(observation, state.waypoints, table.spacing)
        shift = self._shift(state, observation.lateral_error)
        row[observe.O_D] += shift
        row[observe.O_PREVIEW + 1 :: 2] -= shift
        memory = state.memory.copy()
        features = np.zeros(state.features)
        kernel.encode(table, row, memory, features)
        with np.errstate(over="ignore"):  # the network clips: infinity is as good as 1e300
            single = features.astype(np.float32)
        action = float(state.run(single[None, :]))
        steer = action
        if state.rate_step > 0.0:
            steer = memory[kernel.LAST_COMMAND] + action * state.rate_step
        kernel.remember(table, row, memory, min(max(steer, -1.0), 1.0))
        return float(steer), Status.SOLVED, state._replace(memory=memory, shift=shift)

    def _shift(self, state: PolicyState, error: float) -> float:
        """The shift of this step; an error that is not finite leaves it as it is."""
        speed = state.trim * error
        if not math.isfinite(speed):
            return state.shift
        speed = min(max(speed, -self.trim_speed), self.trim_speed)
        shift = state.shift + speed * state.table.dt
        return min(max(shift, -self.trim_limit), self.trim_limit)


def to_row(observation: Observation, waypoints: int, spacing: float) -> FloatArray:
    """An observation as the kernels' row.

    Raises:
        ConfigError: the sensor's waypoints are not those that the policy was trained with.
    """
    given = len(observation.preview)
    if given < waypoints or abs(observation.spacing - spacing) > _SAME:
        raise ConfigError(
            f"the policy reads {waypoints} waypoints {spacing:g} m apart, but the sensor gives "
            f"{given}, {observation.spacing:g} m apart; set sensor.count and sensor.spacing"
        )
    row = np.empty(observe.O_PREVIEW + 2 * waypoints)
    row[: observe.O_PREVIEW] = observation[1:8]
    row[observe.O_PREVIEW :] = observation.preview[:waypoints].ravel()
    return row


def card_table(card: PolicyCard) -> EncodingTable:
    """The layout that a card describes.

    Raises:
        DataError: the card contradicts itself.
        ConfigError: its encoding is unknown or holds values that are not allowed.
    """
    encoding = resolve("encoding", card.encoding)
    assert isinstance(encoding, EncodingComponent)
    table = encoding.table(card.spacing, card.dt, card.rate_limit is not None)
    if kernel.feature_count(table) != len(card.scale):
        raise DataError(f"{len(card.scale)} scales for {kernel.feature_count(table)} features")
    return table


def load_network(data: bytes, name: str, features: int) -> Any:
    """The network in an ONNX file as a function.

    Raises:
        DataError: ONNX Runtime cannot read it, or it does not map that many features to an action.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # noqa: BLE001 - its exceptions share no base class
        line = one_line(str(error))
        raise DataError(f"{name}: not a network that ONNX Runtime reads: {line[:160]}") from None
    entry = session.get_inputs()[0].name

    def run(x: Any) -> float:
        return float(session.run(None, {entry: x})[0][0, 0])

    try:
        run(np.zeros((1, features), dtype=np.float32))
    except Exception as error:  # noqa: BLE001 - its exceptions share no base class
        line = one_line(str(error))
        raise DataError(
            f"{name}: does not map {features} features to an action: {line[:160]}"
        ) from None
    return run
