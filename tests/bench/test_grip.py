"""The grip that a run asks for, against what can be computed by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steersman.bench.disturbance import Disturbance
from steersman.bench.grip import demanded_grip, grip_class
from steersman.bench.standard import disturbances, standard
from steersman.config import build
from steersman.paths.generated import ClothoidRoad
from steersman.profiles import curvature_cap
from steersman.rollout import RunConfig
from steersman.vehicles import CarlaModel3

CAR = CarlaModel3()
GRIP = CAR.friction * 9.81


def share(**words: Any) -> float:
    run = {"path": "circle", "speed": {"kind": "constant_speed", "speed": 15.0}, "duration": 5.0}
    return demanded_grip(build(RunConfig, run | words))


def test_a_steady_turn_asks_for_its_lateral_acceleration() -> None:
    """The drive against the drag takes a little of it, too."""
    assert share() == pytest.approx(15.0**2 / 50.0 / GRIP, rel=2e-3)
    slippery = CAR.replace(friction=1.0)
    assert share(vehicle=slippery) == pytest.approx(15.0**2 / 50.0 / 9.81, rel=2e-3)


@pytest.mark.parametrize("front", [0.0, 0.3, 1.0])
def test_the_axle_that_drives_or_brakes_needs_its_own_grip(front: float) -> None:
    """Stop and go with 2 m/s^2 on a straight: an axle's force over its load."""
    speed = {"kind": "stop_and_go", "speed": 8.0, "change": 2.0, "hold": 1.0, "stand": 1.0}
    flat = CAR.replace(drag_area=1e-6, roll_arm=0.0, drive_front=front, brake_front=0.5)
    on_front = flat.l_r / (flat.l_f + flat.l_r)

    def needed(share_front: float) -> float:
        return 2.0 / GRIP * max(share_front / on_front, (1.0 - share_front) / (1.0 - on_front))

    run = {"path": "straight", "speed": speed, "vehicle": flat}
    assert share(**run, duration=5.5) == pytest.approx(needed(front), rel=0.05)
    assert share(**run, duration=12.0) == pytest.approx(max(needed(front), needed(0.5)), rel=0.05)


def test_a_way_out_of_a_bend_that_is_taken_gently_needs_less() -> None:
    speed = {"kind": "constant_speed", "speed": 15.0, "a_lat_max": 3.0}
    bend = {"path": "figure_eight", "vehicle": CAR.replace(friction=0.5), "duration": 30.0}
    floored = share(**bend, speed=speed)
    gentle = share(**bend, speed=speed | {"acceleration": 1.0})
    assert 0.6 < gentle < 0.9 < floored


@pytest.mark.parametrize(
    "speed",
    [
        {"kind": "constant_speed", "speed": 15.0},
        {"kind": "stop_and_go", "speed": 12.0, "hold": 30.0},
        {"kind": "path"},
        {"kind": "profile", "a_lat_max": 8.0, "deceleration": 1.5, "acceleration": 5.0},
    ],
    ids=lambda speed: str(speed["kind"]),
)
@pytest.mark.parametrize("friction", [0.4, 0.8])
def test_a_slippery_road_leaves_every_source_of_speed_some_grip(
    tmp_path: Path, speed: dict[str, Any], friction: float
) -> None:
    """The recorded speeds brake gently and start like a drag racer behind each bend."""
    road = ClothoidRoad(seed=1, distance=300.0)
    s = np.arange(0.0, 300.0, 1.0)
    points = [road.at(float(each)) for each in s]
    fast = curvature_cap(road, 8.0, 1.5)[: len(s)]
    rows = [f"{p.x:.6f},{p.y:.6f},{v:.3f}" for p, v in zip(points, fast, strict=True)]
    (tmp_path / "line.csv").write_text("\n".join(["x,y,speed", *rows]), encoding="utf-8")
    path = {"kind": "csv", "file": str(tmp_path / "line.csv")}
    run = build(RunConfig, {"path": path, "speed": speed})
    slippery = Disturbance(friction=friction).apply(run)
    assert 0.3 < demanded_grip(slippery) < 0.9


def test_a_patch_takes_its_share_where_the_drive_meets_it() -> None:
    patch = {"kind": "friction_patch", "begin": 40.0, "length": 10.0, "left": 0.2, "right": 0.6}
    assert share(disturbances=[patch]) == pytest.approx(share() / 0.4)
    assert share(disturbances=[patch], duration=2.0) == pytest.approx(share())


def test_a_slow_engine_does_not_reach_what_is_wished_for() -> None:
    wish = {"kind": "constant_throttle", "throttle": 0.4, "initial": 5.0}
    assert share(speed=wish) < share()


@pytest.mark.parametrize("path", ["circle_50_left", "clothoid_0", "surveyed_3"])
def test_only_what_is_named_so_is_beyond_grip(path: str) -> None:
    whole = standard()
    part = whole.model_copy(update={"courses": {path: whole.courses[path]}})
    for scenario in part.scenarios():
        beyond = grip_class(demanded_grip(scenario.run)) == "beyond"
        named = scenario.disturbance.endswith(("_beyond", "_floored"))
        assert beyond <= named, scenario.name
        if scenario.speed == "constant" and not scenario.run.path.closed:
            assert beyond == named, scenario.name


def test_every_class_of_grip_is_there() -> None:
    whole = standard()
    names = ("clean", "friction_0.7_fast", "friction_0.5_beyond")
    assert set(names) <= set(disturbances())
    part = whole.model_copy(
        update={
            "courses": {"spline_1": whole.courses["spline_1"]},
            "disturbances": {name: whole.disturbances[name] for name in names},
            "mixed": {},
        }
    )
    found = [grip_class(demanded_grip(s.run)) for s in part.scenarios() if s.speed == "constant"]
    assert found == ["within 60 %", "60 to 90 %", "beyond"]
