"""Cameras, lidars and the radar: their blueprints, and measurements in which nothing is seen.

There is no picture of the world here. What a camera sends is black and says nothing of the road; a
lidar's or a radar's measurement has no points. Sizes, angles of view, channels, frames, times and
poses are right. Numbers and layouts of the data are those of CARLA 0.9.16's client.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import NamedTuple, TypeAlias

from carla_standin.wire import Refused

Body: TypeAlias = Callable[[float], bytes]

# Most pixels of an image and most channels of a lidar: a stream's messages are bounded.
MOST_PIXELS = 2**22
_MOST_CHANNELS = 1024
# Width and height [pixels], horizontal angle of view [deg].
_IMAGE = struct.Struct("<IIf")
# Angle of the beam [rad], channels; their counts of points follow.
_LIDAR = struct.Struct("<fI")
# Pixels: blue, green, red, alpha; a flow is two float32. Nothing is nearer than the farthest depth.
_BLACK, _FAR, _STILL = b"\0\0\0\xff", b"\xff\xff\xff\xff", bytes(8)

_LENS = {
    "image_size_x": "800",
    "image_size_y": "600",
    "fov": "90.0",
    "lens_circle_falloff": "5.0",
    "lens_circle_multiplier": "0.0",
    "lens_k": "-1.0",
    "lens_kcube": "0.0",
    "lens_x_size": "0.08",
    "lens_y_size": "0.08",
}
_PICTURE = {
    "exposure_mode": "histogram",
    "exposure_compensation": "0.0",
    "shutter_speed": "200.0",
    "iso": "100.0",
    "fstop": "1.4",
    "enable_postprocess_effects": "true",
    "gamma": "2.2",
    "motion_blur_intensity": "0.45",
    "motion_blur_max_distortion": "0.35",
    "lens_flare_intensity": "0.1",
    "bloom_intensity": "0.675",
    "motion_blur_min_object_screen_size": "0.1",
    "exposure_min_bright": "10.0",
    "exposure_max_bright": "12.0",
    "exposure_speed_up": "3.0",
    "exposure_speed_down": "1.0",
    "calibration_constant": "16.0",
    "focal_distance": "1000.0",
    "min_fstop": "1.2",
    "blade_count": "5",
    "blur_amount": "1.0",
    "blur_radius": "0.0",
    "slope": "0.88",
    "toe": "0.55",
    "shoulder": "0.26",
    "black_clip": "0.0",
    "white_clip": "0.04",
    "temp": "6500.0",
    "tint": "0.0",
    "chromatic_aberration_intensity": "0.0",
    "chromatic_aberration_offset": "0.0",
}
_EVENTS = {
    "positive_threshold": "0.3",
    "negative_threshold": "0.3",
    "sigma_positive_threshold": "0.0",
    "sigma_negative_threshold": "0.0",
    "refractory_period_ns": "0",
    "use_log": "true",
    "log_eps": "0.001",
}
_BEAMS = {
    "channels": "32",
    "range": "10.0",
    "points_per_second": "56000",
    "rotation_frequency": "10.0",
    "upper_fov": "10.0",
    "lower_fov": "-30.0",
    "horizontal_fov": "360.0",
}
_LOSSES = {
    "atmosphere_attenuation_rate": "0.004",
    "noise_seed": "0",
    "dropoff_general_rate": "0.45",
    "dropoff_intensity_limit": "0.8",
    "dropoff_zero_intensity": "0.4",
    "noise_stddev": "0.0",
}
_RADAR = {
    "horizontal_fov": "30.0",
    "vertical_fov": "30.0",
    "range": "100.0",
    "points_per_second": "1500",
    "noise_seed": "0",
}


def _image(pixel: bytes) -> Callable[[Mapping[str, str]], Body]:
    """Images of that one colour; none of it at all where it is empty, as of a camera of events."""

    def read(given: Mapping[str, str]) -> Body:
        width, height = (_whole(given, f"image_size_{axis}", MOST_PIXELS) for axis in "xy")
        if width * height > MOST_PIXELS:
            raise Refused(f"an image of {width} x {height} pixels; {MOST_PIXELS} are allowed")
        view = _number(given, "fov")
        if not 0.0 < view < 360.0:  # noqa: PLR2004 - a full circle
            raise Refused(f"fov {view:g}; above 0 and below 360 degrees is allowed")
        return lambda _: _picture(width, height, view, pixel)

    return read


@lru_cache(maxsize=4)
def _picture(width: int, height: int, view: float, pixel: bytes) -> bytes:
    return _IMAGE.pack(width, height, view) + pixel * (width * height)


def _lidar(given: Mapping[str, str]) -> Body:
    """No point in any channel, and the angle to which the beams have turned."""
    channels = _whole(given, "channels", _MOST_CHANNELS)
    turns, view = _number(given, "rotation_frequency"), _number(given, "horizontal_fov")
    round_ = math.radians(min(max(view, 1.0), 360.0))
    counts = bytes(4 * channels)
    return lambda time: _LIDAR.pack(turns * round_ * time % round_, channels) + counts


def _radar(_: Mapping[str, str]) -> Body:
    return lambda _: b""


class BlindSensor(NamedTuple):
    """A kind of sensor that sees nothing here."""

    data: int
    """Number of its data in CARLA's registry of sensors."""
    attributes: dict[str, str]
    """With the values that CARLA's blueprint begins with."""
    body: Callable[[Mapping[str, str]], Body]
    """From the attributes, what follows the header at a time [s]."""
    seen: str
    """What it sends, in words."""


_BLACK_FRAMES = "black frames"
_NO_POINTS = "no points"
BLIND = {
    "sensor.camera.rgb": BlindSensor(13, _LENS | _PICTURE, _image(_BLACK), _BLACK_FRAMES),
    "sensor.camera.depth": BlindSensor(1, _LENS, _image(_FAR), "frames of the farthest depth"),
    "sensor.camera.normals": BlindSensor(2, _LENS, _image(_BLACK), _BLACK_FRAMES),
    "sensor.camera.semantic_segmentation": BlindSensor(14, _LENS, _image(_BLACK), _BLACK_FRAMES),
    "sensor.camera.instance_segmentation": BlindSensor(15, _LENS, _image(_BLACK), _BLACK_FRAMES),
    "sensor.camera.cosmos_visualization": BlindSensor(16, _LENS, _image(_BLACK), _BLACK_FRAMES),
    "sensor.camera.optical_flow": BlindSensor(8, _LENS, _image(_STILL), "frames without a flow"),
    "sensor.camera.dvs": BlindSensor(3, _LENS | _PICTURE | _EVENTS, _image(b""), "no events"),
    "sensor.lidar.ray_cast": BlindSensor(11, _BEAMS | _LOSSES, _lidar, _NO_POINTS),
    "sensor.lidar.ray_cast_semantic": BlindSensor(10, _BEAMS, _lidar, _NO_POINTS),
    "sensor.other.radar": BlindSensor(9, _RADAR, _radar, _NO_POINTS),
}


def _number(given: Mapping[str, str], name: str) -> float:
    try:
        value = float(given[name])
    except ValueError:
        raise Refused(f"{name} {given[name]!r:.20} is no number") from None
    if not math.isfinite(value):
        raise Refused(f"{name} {value} is not finite")
    return value


def _whole(given: Mapping[str, str], name: str, most: int) -> int:
    value = _number(given, name)
    if value != int(value) or not 1 <= value <= most:
        raise Refused(f"{name} {value:g}; a whole number from 1 to {most} is allowed")
    return int(value)
