"""Latitude and longitude as metres in the plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from steersman.types import FloatArray

# WGS 84, NGA.STND.0036: half of the major axis [m], flattening.
_AXIS, _FLATTENING = 6378137.0, 1.0 / 298.257223563
_ECCENTRICITY2 = _FLATTENING * (2.0 - _FLATTENING)


class Plane(NamedTuple):
    """Positions east and north of an origin, in the plane that touches the ellipsoid there."""

    east: FloatArray
    """[m]"""
    north: FloatArray
    """[m]"""


def projected(latitude: FloatArray, longitude: FloatArray) -> Plane:
    """Metres east and north of the first point, by WGS 84.

    Earth-centred coordinates, rotated into east and north (Misra and Enge, *Global Positioning
    System*, 4.A). Lengths at a distance d from the first point are short by (d / R)^2 / 2, R the
    earth's radius: 1e-6 of them at 10 km.

    Args:
        latitude: of each point, north positive [rad].
        longitude: of each point, east positive [rad].
    """
    sin, cos = np.sin(latitude), np.cos(latitude)
    # The curvature across the meridian.
    radius = _AXIS / np.sqrt(1.0 - _ECCENTRICITY2 * sin**2)
    turn = longitude - longitude[0]
    out, height = radius * cos, radius * (1.0 - _ECCENTRICITY2) * sin
    along = out * np.cos(turn) - out[0]
    return Plane(out * np.sin(turn), cos[0] * (height - height[0]) - sin[0] * along)
