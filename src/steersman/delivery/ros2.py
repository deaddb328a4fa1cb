"""A controller as a ROS 2 package: an ament_cmake node around its C, with Autoware's messages."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path as FilePath

from steersman.delivery import controller_text as text
from steersman.delivery.c_text import fill, identifier
from steersman.delivery.controller import Setting, Translated
from steersman.delivery.controller_package import controller_card, prepared
from steersman.delivery.package import Tell, unsaid
from steersman.delivery.parameter_table import entries
from steersman.delivery.translate.lines import indented, without_unused
from steersman.delivery.translate.program import Program
from steersman.delivery.translate.statements import Statements
from steersman.delivery.translate.values import NEVER, REAL, Scalar, Static, Value
from steersman.errors import ConfigError
from steersman.files import replacing
from steersman.kernels import vehicle as car
from steersman.kernels.vehicle import VehicleTable

DEPENDENCIES = (
    *("rclcpp", "nav_msgs", "autoware_control_msgs", "autoware_planning_msgs"),
    "autoware_vehicle_msgs",
)
"""Packages of ROS 2 and Autoware that the node is built with."""


def write_package(setting: Setting, folder: FilePath, tell: Tell = unsaid) -> Sequence[FilePath]:
    """The package in ``folder``, which is the package's own; ``package.xml`` first.

    Raises:
        ConfigError: C cannot be made of the controller.
        DataError: a number of the design that was given is none of its own.
    """
    if setting.limits_speed:
        raise ConfigError(f"{setting.name} limits the speed, which the node of ROS 2 does not do")
    made, sources = prepared(setting, tell)
    prefix, words = setting.prefix, _words(made)
    card = controller_card(made, sources)
    contents = {
        "package.xml": fill("ros2_package.xml.in", words),
        "CMakeLists.txt": fill("ros2_CMakeLists.txt.in", words),
        f"src/{prefix}.c": sources[f"{prefix}.c"],
        f"src/{prefix}_steering.c": fill("ros2_steering.c.in", words | _law(setting)),
        "src/node.cpp": fill("ros2_node.cpp.in", words),
        f"include/{prefix}.h": sources[f"{prefix}.h"],
        f"include/{prefix}_steering.h": fill("ros2_steering.h.in", words),
        "include/road.hpp": fill("ros2_road.hpp.in", words),
        "config/parameters.yaml": _yaml(made),
        f"config/{identifier(setting.name)}.json": card,
        f"launch/{prefix}.launch.py": fill("ros2_launch.py.in", words),
    }
    for each, content in contents.items():
        (folder / each).parent.mkdir(exist_ok=True)
        with replacing(folder / each) as stream:
            stream.write(content.encode())
    return [folder / each for each in contents]


def _words(made: Translated) -> dict[str, object]:
    setting = made.setting
    numbers = [each.value for each in entries(made)]
    reset = f"{setting.prefix}_reset(&state_);\n        "
    gap = (
        "      // Nothing is published once the supervisor can only hold the steering.\n"
        f"      if (drives_ && {setting.prefix}_step(&state_, nullptr, &steer) != "
        f"{setting.prefix.upper()}_FALLBACK) {{\n        publish(steer);\n      }}\n"
        if setting.controller.gaps
        else "      // Nothing is published: the vehicle interface needs a time-out of its own.\n"
    )
    release = re.match(r"\d+(\.\d+){0,2}", version("steersman"))
    return {
        **text.words(made),
        "count": len(numbers),
        "list_size": max(len(numbers), 1),
        "defaults": ", ".join(repr(each) for each in numbers) or "0.0",
        "l_r": repr(setting.vehicle.l_r),
        "period": f"{setting.dt:g}",
        "reset": "drives_ = true;\n        " if setting.controller.gaps else reset,
        "gap": gap,
        "drives": "  bool drives_ = false;\n" if setting.controller.gaps else "",
        "find": "".join(f"find_package({each} REQUIRED)\n" for each in DEPENDENCIES),
        "depend": "".join(f"  <depend>{each}</depend>\n" for each in DEPENDENCIES),
        "dependencies": " ".join(DEPENDENCIES),
        "package_version": ".".join(((release[0] if release else "0") + ".0.0").split(".")[:3]),
    }


def _yaml(made: Translated) -> str:
    """The node's parameters, those of the controller with their names."""
    rows = [f"      - {e.value!r}  # {e.name} [{e.unit}]" for e in entries(made)]
    values = "\n".join(["    parameters:", *rows]) if rows else "    # the controller has none"
    return (
        f"{made.setting.prefix}:\n  ros__parameters:\n"
        f"    base_to_centre: {made.setting.vehicle.l_r!r}  # odometry's point to the centre [m]\n"
        f"    timeout: 0.2  # [s]\n{values}\n"
    )


def _angle(table: VehicleTable, steer: float, speed: float) -> float:
    """The single-track wheel angle [rad]."""
    return math.atan(car.wheel_tangents(table, 0, steer, abs(speed))[2])


def _steer(table: VehicleTable, angle: float, speed: float) -> float:
    """The normalised steering."""
    return car.steer_for_wheel(table, 0, angle, abs(speed))


def _law(setting: Setting) -> dict[str, str]:
    """C of the car's steering, for double."""
    program = Program(single=False)
    bodies = {}
    for word, function, given in (("angle", _angle, "steer"), ("steer", _steer, "angle")):
        writer = Statements(program, {}, {"__builtins__": {}}, NEVER)
        values: list[Value] = [Static(setting.vehicle.table), Scalar(given, REAL)]
        found = writer.call(function, [*values, Scalar("speed", REAL)])
        lines = without_unused([*writer.top, *writer.lines, f"return {writer.real(found)};"])
        bodies[word] = lines
    called = [line for lines in bodies.values() for line in lines]
    return {
        "helpers": "".join(f"{each}\n" for each in program.helpers.values()),
        "constants": program.constants_of([*called, *(texts := program.needed(called))]),
        "functions": "".join(f"{each}\n" for each in texts),
        **{word: "\n".join(indented(lines)) for word, lines in bodies.items()},
    }
