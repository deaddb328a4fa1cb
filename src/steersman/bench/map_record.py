"""What a benchmark says of a map that its ways lead over."""

from __future__ import annotations

from steersman.stored import StoredResult


class MapRecord(StoredResult):
    """What a benchmark made of an OpenDRIVE map."""

    sha256: str | None
    courses: list[str]
    distance_m: list[float]
    """Lengths of the courses."""
    min_radius_m: float
    lanes_km: float
    """Length of all lanes that can be driven."""
    lanes_too_sharp_km: float
    """Length of those that are left out because they bend below ``min_radius_m``."""
    why_not_more: str = ""
