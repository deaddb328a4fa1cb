"""Where a map lies on Earth: its geographic reference, and positions relative to it."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

# Equatorial radius of the sphere [m], and the scale of its central meridian: those of CARLA 0.9.16.
_RADIUS, _SCALE = 6378137.0, 0.9996
_POLE, _AROUND = 90.0, 360.0  # [deg]
_NUMBER = r"=\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,2})?)"


class GeoReference(NamedTuple):
    """Latitude and longitude of a map's origin [deg]; the defaults are CARLA's."""

    latitude: float = 42.0
    longitude: float = 2.0

    @classmethod
    def read(cls, opendrive: str) -> GeoReference:
        """That of ``lat_0`` and ``lon_0`` in a map's geoReference, whatever projection it names.

        Where one is missing, or beyond the poles, both are the defaults, as for the client.
        """
        found = re.search(r"<geoReference>(.{0,2000}?)</geoReference>", opendrive, re.DOTALL)
        text = found[1] if found else ""
        lat, lon = (re.search(name + _NUMBER, text) for name in ("lat_0", "lon_0"))
        if (
            lat is None
            or lon is None
            or abs(float(lat[1])) >= _POLE
            or abs(float(lon[1])) > _AROUND
        ):
            return cls()
        return cls(float(lat[1]), float(lon[1]))

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Latitude and longitude [deg] of a location in CARLA's world [m].

        The inverse of the transverse Mercator projection of a sphere (Snyder, *Map Projections: A
        Working Manual*, USGS 1395, 1987, 8-6 and 8-7), with y to the north, as the client's
        ``map.transform_to_geolocation`` has it.
        """
        east = x / (_SCALE * _RADIUS)
        north = y / (_SCALE * _RADIUS) + math.radians(self.latitude)
        return (
            math.degrees(math.asin(math.sin(north) / math.cosh(east))),
            self.longitude + math.degrees(math.atan2(math.sinh(east), math.cos(north))),
        )


CARLAS_ORIGIN = GeoReference()
