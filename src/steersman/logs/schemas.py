"""Topics, message types and frames of a recorded episode; docs/logs.md.

REP 103 and 105: metres, radians, seconds, x forward, y left, z up; frame ``map`` is the path's
plane, ``base_link`` the vehicle. Here ``base_link`` is at the **centre of mass**, where all of
Steersman's states are; Autoware puts it at the rear axle, ``l_r`` behind.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

from steersman.episode import COLUMNS
from steersman.types import Driver, Reason, Status

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

PATH, ODOMETRY = "/steersman/path", "/steersman/odometry"
LATERAL, DIAGNOSTICS = "/steersman/lateral", "/steersman/diagnostics"
TF, MARKERS = "/tf", "/steersman/markers"
PATH_TYPE, ODOMETRY_TYPE = "nav_msgs/msg/Path", "nav_msgs/msg/Odometry"
LATERAL_TYPE = "autoware_control_msgs/msg/Lateral"
DIAGNOSTICS_TYPE = "steersman_msgs/msg/Diagnostics"
TYPES = {
    PATH: PATH_TYPE,
    ODOMETRY: ODOMETRY_TYPE,
    LATERAL: LATERAL_TYPE,
    DIAGNOSTICS: DIAGNOSTICS_TYPE,
    TF: "tf2_msgs/msg/TFMessage",
    MARKERS: "visualization_msgs/msg/MarkerArray",
}
POSE_TYPES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
TRAJECTORY_TYPE = "autoware_planning_msgs/msg/Trajectory"
CONTROL_TYPE = "autoware_control_msgs/msg/Control"
STEERING_REPORT_TYPE = "autoware_vehicle_msgs/msg/SteeringReport"

MAP, BASE_LINK = "map", "base_link"
EPOCH = 946_684_800
"""Simulated time zero is 2000-01-01T00:00:00Z: this many seconds of Unix time. (Zero itself means
"no time" to much of ROS.)"""
HEAD = ("end", "distance", "dt", "path_length", "closed")
"""Fields of an episode, beside ``meta``, that the metadata record holds."""
METADATA = "steersman"
"""Name of the metadata record that holds an episode's head."""

# What Odometry and the stamps hold already.
_ELSEWHERE = frozenset({"time", "x", "y", "v_x", "v_y", "yaw_rate"})
DIAGNOSTIC_FIELDS = tuple(name for name in COLUMNS if name not in _ELSEWHERE)
"""Columns of an episode that the diagnostics carry; ``psi`` is there with its whole turns."""
ENUMS: dict[str, type[IntEnum]] = {"status": Status, "driver": Driver, "reason": Reason}
"""Columns that number something; the message's constants name the numbers."""

_TIME = "builtin_interfaces/Time stamp\n"
# Autoware's messages; a definition in the recording itself is preferred.
_AUTOWARE = {
    LATERAL_TYPE: _TIME
    + "builtin_interfaces/Time control_time\n"
    + "float32 steering_tire_angle\n"
    + "float32 steering_tire_rotation_rate\n"
    + "bool is_defined_steering_tire_rotation_rate\n",
    "autoware_control_msgs/msg/Longitudinal": _TIME
    + "builtin_interfaces/Time control_time\n"
    + "float32 velocity\n"
    + "float32 acceleration\n"
    + "float32 jerk\n"
    + "bool is_defined_acceleration\n"
    + "bool is_defined_jerk\n",
    CONTROL_TYPE: _TIME
    + "builtin_interfaces/Time control_time\n"
    + "Lateral lateral\n"
    + "Longitudinal longitudinal\n",
    STEERING_REPORT_TYPE: _TIME + "float32 steering_tire_angle\n",
    "autoware_planning_msgs/msg/TrajectoryPoint": "builtin_interfaces/Duration time_from_start\n"
    + "geometry_msgs/Pose pose\n"
    + "float32 longitudinal_velocity_mps\n"
    + "float32 lateral_velocity_mps\n"
    + "float32 acceleration_mps2\n"
    + "float32 heading_rate_rps\n"
    + "float32 front_wheel_angle_rad\n"
    + "float32 rear_wheel_angle_rad\n",
    TRAJECTORY_TYPE: "std_msgs/Header header\nTrajectoryPoint[] points\n",
}


def diagnostics_definition() -> str:
    """Our own message: a field for each column that no standard message carries."""
    lines = ["std_msgs/Header header"]
    for name, enum in ENUMS.items():
        lines += [f"uint8 {name.upper()}_{member.name}={member.value}" for member in enum]
    for name in DIAGNOSTIC_FIELDS:
        kind = "uint8" if name in ENUMS else "float64"
        lines.append(f"{kind} {name}  # [{COLUMNS[name]}]")
    return "\n".join(lines) + "\n"


def typestore() -> Typestore:
    """The message types that are written and read: those of ROS 2 Humble, Autoware's, ours."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in {**_AUTOWARE, DIAGNOSTICS_TYPE: diagnostics_definition()}.items():
        store.register(get_types_from_msg(text, name))
    return store


def schema_text(store: Typestore, name: str) -> str:
    """The definition of a type and of all that it uses, as ``ros2msg`` schemas are written."""
    text = str(store.generate_msgdef(name, ros_version=2)[0])
    if name != DIAGNOSTICS_TYPE:
        return text
    _, line, rest = text.partition("=" * 80)
    return diagnostics_definition() + line + rest  # with the units
