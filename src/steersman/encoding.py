"""Encodings: from an observation to the input of a policy's network.

Training and the exported policy's controller use the same kernel. The raw features are divided
by fixed scales to about unit size; the scale is applied here for training and is part of the
card of an exported policy.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import final

import numpy as np

from steersman.config import Component, param, register
from steersman.kernels import encode as kernel
from steersman.kernels.encode import EncodingTable
from steersman.types import FloatArray


class EncodingComponent(Component):
    """Layout and scales of a policy's input."""

    @abstractmethod
    def table(self, spacing: float, dt: float, rate_action: bool) -> EncodingTable:
        """The layout as the kernels read it."""

    @final
    def layout(self, spacing: float, dt: float, action: str) -> EncodingTable:
        """The layout for an action: ``residual`` adds the last command and the base's."""
        table = self.table(spacing, dt, action == "rate")
        return table._replace(command=1, base=1) if action == "residual" else table

    def names(self, table: EncodingTable) -> list[str]:
        """Name of each feature, with its unit in brackets."""
        names = []
        for i in range(table.waypoints):
            names += [f"waypoint_{i}_x [m]", f"waypoint_{i}_y [m]"]
        names += [f"road_curvature_{2 * i * table.spacing:g}m [1/m]" for i in range(table.roads)]
        names += ["v_x [m/s]", "v_y [m/s]", "yaw_rate [rad/s]"]
        names += ["steer [-]"] * table.steer
        if table.errors:
            names += ["lateral_error [m]", "heading_error [rad]"]
            names += ["lateral_error_fine [-]", "heading_error_fine [-]"]
        names += ["lateral_error_integral [m s]"] * table.integral
        names += ["last_command [-]"] * table.command
        names += [f"lateral_error_{i + 1}_ago [m]" for i in range(table.history)]
        names += [f"command_{i + 2}_ago [-]" for i in range(table.history)]
        names += ["base_command_less_last [-]"] * table.base
        return names

    def mirror(self, table: EncodingTable) -> FloatArray:
        """Factor on each feature that gives those of the mirrored scene: all but v_x and x turn."""
        even = ("v_x", "waypoint")
        return np.array(
            [
                1.0 if name.startswith(even) and not name.endswith("_y [m]") else -1.0
                for name in self.names(table)
            ]
        )

    def scale(self, table: EncodingTable) -> FloatArray:
        """Factor on each feature that brings it to about unit size."""
        reach = max(table.waypoints - 1, 1) * table.spacing
        factors: list[float] = []
        for _ in range(table.waypoints):
            factors += [1.0 / reach, 4.0 / reach]
        factors += [20.0] * table.roads
        factors += [1.0 / 15.0, 0.5, 1.0]
        factors += [5.0] * table.steer
        if table.errors:
            factors += [1.0, 4.0, 1.0, 1.0]
        factors += [1.0 / table.integral_limit] * table.integral
        factors += [5.0] * table.command
        factors += [1.0] * table.history + [5.0] * table.history
        factors += [20.0] * table.base  # a car at speed is steered by a twentieth in a step
        return np.array(factors)


@register("encoding", "waypoints")
class WaypointEncoding(EncodingComponent):
    """The paper's observation: waypoints in the vehicle's frame and the physical state.

    The steering is added when the action is its rate, or when asked for.
    """

    waypoints: int = param(15, "-", "Waypoints among the features.", ge=1)
    steer: bool = param(False, "-", "Include the actual steering for direct actions too.")

    def table(self, spacing: float, dt: float, rate_action: bool) -> EncodingTable:
        """The layout as the kernels read it."""
        steer = int(rate_action or self.steer)
        return EncodingTable(self.waypoints, 0, steer, 0, 0, 0, 0, spacing, 1.0, 1.0, 1.0, dt)


@register("encoding", "extended")
class ExtendedEncoding(EncodingComponent):
    """Explicit errors, their integral, the last command, road curvatures, a short history."""

    waypoints: int = param(0, "-", "Waypoints among the features.", ge=0)
    roads: int = param(7, "-", "Road curvatures: beside the car and over 4, 8, ... m.", ge=0)
    errors: bool = param(True, "-", "Lateral and heading error, plain and finely scaled.")
    integral: bool = param(True, "-", "Integral of the lateral error.")
    command: bool = param(True, "-", "Last command.")
    history: int = param(0, "-", "Past lateral errors and commands, this many of each.", ge=0)
    fine_error: float = param(0.05, "m", "Error at half range of the fine feature.", gt=0)
    fine_heading: float = param(0.02, "rad", "Heading at half range of the fine feature.", gt=0)
    integral_limit: float = param(0.25, "m s", "Bound of the integral.", gt=0)

    def table(self, spacing: float, dt: float, rate_action: bool) -> EncodingTable:
        """The layout as the kernels read it."""
        return EncodingTable(
            self.waypoints,
            self.roads,
            1,
            int(self.errors),
            int(self.integral),
            int(self.command),
            self.history,
            spacing,
            self.fine_error,
            self.fine_heading,
            self.integral_limit,
            dt,
        )


__all__ = ["EncodingComponent", "EncodingTable", "ExtendedEncoding", "WaypointEncoding", "kernel"]
