"""The ROS 2 package: built by its own CMake against stand-ins of ROS, it steers as Python does.

There is no ROS here. The stand-ins (ros2_stubs) have the names and types that the node uses.
"""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import sys
from pathlib import Path as FilePath

import numpy as np
import pytest
import yaml
from lxml import etree
from typer.testing import CliRunner

from steersman.cli import app
from steersman.cli.exported import ToExport, setting_of
from steersman.delivery.ros2 import DEPENDENCIES, write_package
from steersman.logs import schemas
from steersman.paths.random_road import RandomRoad
from steersman.sensing import WaypointSensor, track
from steersman.types import VehicleState

STUBS = FilePath(__file__).parent / "ros2_stubs"
HEADERS = (
    *("rclcpp/rclcpp.hpp", "nav_msgs/msg/odometry.hpp", "autoware_control_msgs/msg/lateral.hpp"),
    *("autoware_planning_msgs/msg/trajectory.hpp", "autoware_vehicle_msgs/msg/steering_report.hpp"),
)
AMENT = f"""
function(ament_target_dependencies target)
  target_include_directories(${{target}} PRIVATE "{STUBS}" "${{CMAKE_CURRENT_LIST_DIR}}/stubs")
endfunction()
function(ament_package)
endfunction()
"""
needs_tools = pytest.mark.skipif(
    sys.platform == "win32" or not (shutil.which("cmake") and shutil.which("c++")),
    reason="there is no CMake, or no C++ compiler",
)


def package(folder: FilePath, word: str, precision: str = "double") -> FilePath:
    folder.mkdir()
    write_package(setting_of(ToExport(word, precision=precision)), folder)
    return folder


def built(folder: FilePath) -> FilePath:
    """The node, by its CMakeLists.txt."""
    for name in (*DEPENDENCIES, "ament_cmake"):
        file = folder / "cmake" / f"{name}Config.cmake"
        file.parent.mkdir(exist_ok=True)
        file.write_text(AMENT if name == "ament_cmake" else "")
    for name in HEADERS:
        header = folder / "stubs" / name
        header.parent.mkdir(parents=True, exist_ok=True)
        header.write_text('#include "stubs.hpp"\n')
    words = ["-DCMAKE_BUILD_TYPE=None", "-DCMAKE_CXX_FLAGS=-Werror -Wconversion"]
    words.append(f"-DCMAKE_PREFIX_PATH={folder / 'cmake'}")
    for each in (["-S", folder, "-B", folder / "build", *words], ["--build", folder / "build"]):
        done = subprocess.run(["cmake", *each], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    return folder / "build" / "node"


NAMES = ("gain", "softening", "yaw_damping", "steer_damping")
SET_AT = {8: (1.0, 1.0, 0.1), 9: (5.0, -1.0, 0.1, 0.0), 36: (5.0, 20.0, 0.1, 0.05)}
"""Parameters that are set at a step; the first have too few numbers, the second a wrong one."""
LATE = 20


@needs_tools
def test_the_node_steers_as_python_does(tmp_path: FilePath) -> None:
    word = "tuned/stanley"  # with "supervised/tuned/pid" it passes too, and takes twice as long
    setting = setting_of(ToExport(word))
    assert setting is not None
    controller, vehicle = setting.controller, setting.vehicle
    road, sensor, rng = RandomRoad(seed=1), WaypointSensor(), np.random.default_rng(0)
    points = [road.at(float(s)) for s in np.arange(0.0, 120.0, 1.0)]
    lines = [str(len(points)), *(f"{p.x!r} {p.y!r}" for p in points)]
    start = state = setting.start()
    expected: dict[int, tuple[float, float]] = {}
    for k in range(60):
        at, d = road.at(5.0 + 0.5 * k), 0.2 * math.sin(0.15 * k)
        psi, v_x, v_y, rate = at.psi + 0.03 * math.cos(0.15 * k), 10.0, 0.1, 10.0 * at.curvature
        x, y = at.x - d * math.sin(at.psi), at.y + d * math.cos(at.psi)
        steer = 2.0 * at.curvature
        arrives = k not in range(30, 36)  # 0.3 s, of which 0.2 s are bridged by what is there
        base = (x - vehicle.l_r * math.cos(psi), y - vehicle.l_r * math.sin(psi))
        turned = (math.sin(0.5 * psi), math.cos(0.5 * psi))
        motion = (v_x, v_y - vehicle.l_r * rate, rate, vehicle.wheel_angle(steer, v_x))
        numbers = (1.0 + k * 0.05 + 0.01 * (not arrives), int(arrives), *base, *turned, *motion)
        late = 0.25 if k == LATE else 0.01  # on its way, of which the former is too long
        given = SET_AT.get(k, ())
        lines.append(" ".join(map(repr, (*numbers, late, len(given), *given))))
        if not arrives or k == LATE:
            continue
        if k in {LATE + 1, 36}:  # a new drive
            state = start
        if k == 36:  # from when on the last parameters hold
            controller = controller.model_copy(update=dict(zip(NAMES, SET_AT[k], strict=True)))
        full = VehicleState(k * 0.05, x, y, psi, v_x, v_y, rate, 0.0, 0.0, steer, 0.0, 0.0, 0.0)
        place = track(full, road, 5.0 + 0.5 * k)
        seen = sensor.observe(None, full, place, road, rng)
        decision, state = controller.step(state, seen)
        expected[k] = vehicle.wheel_angle(decision.steer, v_x), numbers[0] - late
    made = package(tmp_path / "package", word, "mixed")  # in which float meets the node's double
    done = subprocess.run(
        [built(made)], input="\n".join(lines) + "\n",
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    found = [tuple(map(float, each.split())) for each in done.stdout.splitlines()]
    # Nothing is published where the inputs are older than 0.2 s.
    published = [k for k in range(60) if k != LATE and k not in range(33, 36)]
    pairs = [(one, expected[k]) for k, one in zip(published, found, strict=True) if k in expected]
    assert len(pairs) == len(expected) == 53
    assert max(abs(a[0] - b[0]) for a, b in pairs) < 2e-3
    assert max(abs(a[1] - b[1]) for a, b in pairs) < 1e-6  # the stamp of what was decided from
    assert np.ptp([b[0] for _, b in pairs]) > 0.05
    assert done.stderr.splitlines() == [
        "refused: parameters: 3 numbers, expected 4",
        "refused: parameters: number 1 is beyond its limits or not finite",
        "taken",
    ]


def test_the_files_name_the_same_packages_and_messages(tmp_path: FilePath) -> None:
    folder = package(tmp_path / "package", "tuned/lqr")
    parser = etree.XMLParser(resolve_entities=False, no_network=True)
    root = etree.parse(folder / "package.xml", parser).getroot()
    assert root.get("format") == "3"
    tags = [each.tag for each in root]
    order = ["name", "version", "description", "maintainer", "license", "buildtool_depend"]
    assert tags[: len(order)] == order
    assert re.fullmatch(r"\d+\.\d+\.\d+", root.findtext("version"))
    assert root.findtext("export/build_type") == "ament_cmake"
    cmake = (folder / "CMakeLists.txt").read_text()
    needed = [each.text for each in root.findall("depend")]
    assert needed == re.findall(r"find_package\((\w+) REQUIRED\)", cmake)[1:] == list(DEPENDENCIES)
    assert f"project({root.findtext('name')} " in cmake
    node = (folder / "src" / "node.cpp").read_text()
    assert set(re.findall(r'#include "(\w+)/', node)) == set(DEPENDENCIES)
    for field in re.findall(r"message\.(\w+) =", node):  # as in our recordings
        assert f" {field}\n" in schemas._AUTOWARE[schemas.LATERAL_TYPE]
    compile((folder / "launch" / "steersman_lqr.launch.py").read_text(), "launch", "exec")
    given = yaml.safe_load((folder / "config" / "parameters.yaml").read_text())
    numbers = given["steersman_lqr"]["ros__parameters"]["parameters"]
    assert f"{len(numbers)}" in re.findall(r"expected (\d+)", node)


def test_a_car_is_refused(tmp_path: FilePath) -> None:
    words = ["export", "carla_model3", "--to", "ros2", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert "unknown controller 'carla_model3'" in result.stderr
