"""The parts by themselves, without sockets and without the wheel."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from carla_standin import actor_calls, physics
from carla_standin.actors import Actor, overlap
from carla_standin.blueprints import IMU
from carla_standin.calls import Dispatcher, answered
from carla_standin.car import Car
from carla_standin.catalogue import MODEL3, default_models
from carla_standin.maps import MapLibrary, default_map, read_map
from carla_standin.settings import EpisodeSettings
from carla_standin.streams import MAX_WAITING, Streams
from carla_standin.wire import Incoming, NotARequest, Transform, framed, request, shaped
from carla_standin.world import StandinWorld, StreamMessage
from steersman.plants.carla_frame import CarlaFrame
from steersman.types import Pose
from steersman.vehicles import CarlaModel3

from .serving import ROAD

metres = st.floats(-1e4, 1e4)
angles = st.floats(-10.0, 10.0)
SPAWN = [[1, MODEL3, []], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]]


def desk() -> tuple[Dispatcher, list[StreamMessage]]:
    """A world, and what it sends."""
    assert actor_calls
    sent: list[StreamMessage] = []
    world = StandinWorld(default_models())
    world.settings = EpisodeSettings(synchronous=True, fixed_delta=0.05)
    streams = Streams()
    streams.publish = sent.append  # type: ignore[method-assign]
    return Dispatcher(world, MapLibrary(), 2001, streams), sent


@given(metres, metres, angles, st.floats(-2.0, 2.0))
def test_a_pose_survives_the_way_there_and_back(x: float, y: float, psi: float, l: float) -> None:  # noqa: E741
    back = Transform.of(Pose(x, y, psi), l).pose(l)
    assert (back.x, back.y) == pytest.approx((x, y), abs=1e-9)
    assert math.remainder(back.psi - psi, math.tau) == pytest.approx(0.0, abs=1e-12)


@given(angles, metres, metres)
def test_a_velocity_survives_the_way_there_and_back(psi: float, u: float, v: float) -> None:
    assert CarlaFrame.body_vector(psi, *CarlaFrame.world_vector(psi, u, v)) == pytest.approx(
        (u, v), abs=1e-9
    )
    assert math.hypot(*CarlaFrame.world_vector(psi, u, v)) == pytest.approx(math.hypot(u, v))
    assert CarlaFrame.radians_left(CarlaFrame.degrees_right(u)) == pytest.approx(u)


def test_left_is_right_the_other_way_round() -> None:
    # Ours: facing north-west at (3, 4); CARLA's y points the other way, and so does yaw.
    where = Transform.of(Pose(3.0, 4.0, 0.75 * math.pi), 0.0)
    assert (where.x, where.y, where.yaw) == pytest.approx((3.0, -4.0, -135.0))
    assert CarlaFrame.world_vector(0.0, 1.0, 2.0) == (1.0, -2.0)
    assert CarlaFrame.degrees_right(1.0) < 0.0


@given(angles, metres, metres)
def test_what_is_mounted_on_a_car_turns_with_it(psi: float, x: float, y: float) -> None:
    parent = Transform.of(Pose(x, y, psi), 0.0)
    mounted = parent.placed(Transform(x=2.0, y=1.0, z=0.5, yaw=90.0))
    there = CarlaFrame.world_vector(psi, 2.0, -1.0)
    assert (mounted.x - parent.x, mounted.y - parent.y) == pytest.approx(there, abs=1e-8)
    assert mounted.z == 0.5
    assert math.remainder(mounted.yaw - parent.yaw - 90.0, 360.0) == pytest.approx(0.0, abs=1e-9)


@given(metres, metres, st.floats(-180, 180), st.floats(-180, 180), st.floats(0.0, 12.0), angles)
def test_boxes_overlap_as_their_points_do(
    x: float, y: float, yaw: float, other: float, apart: float, towards: float
) -> None:
    def box(at_x: float, at_y: float, turned: float) -> Actor:
        return Actor(1, [], Transform(at_x, at_y, yaw=turned), extent=(2.4, 1.1, 0.7))

    one = box(x, y, yaw)
    two = box(x + apart * math.cos(towards), y + apart * math.sin(towards), other)
    assert overlap(one, two) == overlap(two, one)
    # A grid of points of one box, in the axes of the other.
    u, v = np.meshgrid(np.linspace(-2.4, 2.4, 49), np.linspace(-1.1, 1.1, 23))
    c, s = math.cos(math.radians(other)), math.sin(math.radians(other))
    dx = two.pose.x - x + c * u - s * v
    dy = two.pose.y - y + s * u + c * v
    c, s = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    inside = (abs(c * dx + s * dy) < 2.4) & (abs(c * dy - s * dx) < 1.1)
    if inside.any():
        assert overlap(one, two)
    if apart > 2.0 * math.hypot(2.4, 1.1):
        assert not overlap(one, two)


def test_boxes_that_only_cross_overlap() -> None:
    bar = Actor(1, [], Transform(), extent=(5.0, 0.1, 1.0))
    across = Actor(2, [], Transform(yaw=90.0), extent=(5.0, 0.1, 1.0))
    beside = Actor(3, [], Transform(y=0.3, yaw=1.0), extent=(5.0, 0.05, 1.0))
    assert overlap(bar, across)
    assert not overlap(bar, beside)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_request_or_a_value_error(data: bytes) -> None:
    reader = Incoming()
    try:
        reader.feed(data)
        while (message := reader.message()) is not None:
            assert request(message).number >= 0
    except (NotARequest, ValueError, msgpack.UnpackException):
        pass


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.binary(),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=12,
)


@settings(max_examples=40)
@given(st.sampled_from(sorted(answered())), st.lists(values, max_size=4))
def test_any_arguments_get_an_answer(name: str, arguments: list[Any]) -> None:
    counter, _ = desk()
    answer = counter.answer(name, arguments)
    assert isinstance(answer, list)
    msgpack.packb(answer)


def test_a_traffic_manager_is_kept_until_it_is_destroyed() -> None:
    counter, _ = desk()

    def call(name: str, *arguments: Any) -> Any:
        return counter.answer(name, list(arguments))[0][1]

    assert call("get_traffic_manager_running", 8000) == ["", 0]
    assert call("add_traffic_manager_running", ["127.0.0.1", 8000]) is True
    assert call("add_traffic_manager_running", ["127.0.0.1", 8000]) is False
    assert call("is_traffic_manager_running", 8000) is True
    assert call("get_traffic_manager_running", 8000) == ["127.0.0.1", 8000]
    assert call("destroy_traffic_manager", 8000) is True
    assert call("is_traffic_manager_running", 8000) is False
    assert "no port" in call("add_traffic_manager_running", ["", 70_000])[0]


def valid(counter: Dispatcher, number: int) -> dict[str, list[Any]]:
    """Arguments that calls about vehicle ``number`` take."""
    pose = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    control = [0.5, 0.2, 0.0, False, False, False, 1]
    follow = [2, [number, control]]
    spawn = [[1, MODEL3, []], [[80.0, 0.0, 0.0], [0.0] * 3], [False], [[follow]]]
    return {
        "set_episode_settings": [counter.world.settings.wire()],
        "spawn_actor": [[1, MODEL3, [["role_name", 4, "hero"]]], [[50.0, 0.0, 0.0], [0.0] * 3]],
        "spawn_actor_with_parent": [[1, IMU, [["noise_seed", 2, "1"]]], pose, number, 0, ""],
        "set_actor_transform": [number, pose],
        "set_actor_location": [number, pose[0]],
        "set_actor_target_velocity": [number, [20.0, 3.0, 0.0]],
        "set_actor_target_angular_velocity": [number, [0.0, 0.0, 9.0]],
        "apply_control_to_vehicle": [number, control],
        "apply_ackermann_control_to_vehicle": [number, [0.1, 0.2, 3.0, 1.0, 0.0]],
        "apply_ackermann_controller_settings": [number, [0.15, 0.0, 0.25, 0.01, 0.0, 0.01]],
        "apply_physics_control": [number, counter.answer("get_physics_control", [number])[0][1]],
        "apply_batch": [[[[0, spawn]], [follow], [[6, [number, pose]]]], True],
    }


odd = st.sampled_from(
    [math.nan, math.inf, -math.inf, 1e308, -1e308, 1e-320, 0.0, -1.0, 2**63, -1, None, "", b"", []]
)


def damaged(value: Any, draw: Any) -> Any:
    """``value`` with one leaf replaced, or one list cut."""
    if not isinstance(value, list) or not value or draw(st.integers(0, 9)) == 0:
        return draw(odd)
    at = draw(st.integers(0, len(value)))
    if at == len(value):
        return value[:-1]
    return [*value[:at], damaged(value[at], draw), *value[at + 1 :]]


@settings(max_examples=300)
@given(st.data())
def test_no_damaged_argument_breaks_the_world(data: Any) -> None:
    counter, sent = desk()
    ((_, (number, *_)),) = counter.answer("spawn_actor", SPAWN)
    name = data.draw(st.sampled_from(sorted(valid(counter, number))))
    arguments = damaged(valid(counter, number)[name], data.draw)
    msgpack.packb(counter.answer(name, arguments))
    begun = len(sent)
    for _ in range(3):
        counter.tick()
    assert len(sent) >= begun + 3
    for actor in counter.world.actors.values():
        assert actor.car is None or np.isfinite(actor.car.motion._row).all()
        if actor.car is not None:
            told = counter.answer("get_physics_control", [actor.number])[0][1]
            assert shaped(told, physics._LIKE) == told
        assert shaped(actor.wire()[2], (0, "", [("", 0, "")])) == actor.wire()[2]
    assert EpisodeSettings.read(counter.world.settings.wire()) == counter.world.settings


def test_errors_do_not_quote_all_that_was_sent() -> None:
    counter, _ = desk()
    ((_, (number, *_)),) = counter.answer("spawn_actor", SPAWN)
    long = "x" * 3_000_000
    for name, arguments in (
        ("spawn_actor", [[1, long, []], SPAWN[1]]),
        ("spawn_actor_with_parent", [[1, IMU, [["sensor_tick", 3, long]]], SPAWN[1], number]),
        ("load_new_episode", [long]),
        ("get_physics_control", [long]),
        ("apply_batch", [[[[0, [[1, long, []], SPAWN[1], [False], []]]], [[1, [number, long]]]]]),
    ):
        assert len(repr(counter.answer(name, arguments))) < 1000


def test_undamaged_arguments_are_taken() -> None:
    counter, _ = desk()
    ((_, (number, *_)),) = counter.answer("spawn_actor", SPAWN)
    for name, arguments in valid(counter, number).items():
        (first, *others) = counter.answer(name, arguments)
        if name == "apply_batch":
            assert [answer[0][0] for answer in (first, *others)] == [1, 1, 1]
        else:
            assert first[0] in ([1, False] if len(first) > 1 else [False]), name


@given(
    st.floats(allow_nan=True), st.floats(allow_nan=True), st.floats(allow_nan=True), st.booleans()
)
def test_no_control_makes_a_car_that_cannot_be_told(
    throttle: float, steer: float, brake: float, hand: bool
) -> None:
    counter, sent = desk()
    ((_, (number, *_)),) = counter.answer("spawn_actor", SPAWN)
    control = [throttle, steer, brake, hand, False, False, 2**40]
    assert counter.answer("apply_control_to_vehicle", [number, control]) == [[False]]
    for _ in range(3):
        counter.answer("tick_cue", [])
    assert len(sent) == 3
    assert np.isfinite(counter.world.actors[number].car.motion._row).all()  # type: ignore[union-attr]


# What a physics control changes in the car; all else is told to be without effect.
ACTS = {
    *("mass", "drag_coefficient", "center_of_mass.x", "steering_curve", "wheels.tire_friction"),
    *("wheels.max_steer_angle", "wheels.max_brake_torque", "wheels.lat_stiff_value"),
}


def test_each_value_of_a_physics_control_acts_or_is_told() -> None:
    counter, _ = desk()
    ((_, (number, *_)),) = counter.answer("spawn_actor", SPAWN)
    actor = counter.world.actors[number]
    assert actor.car is not None
    given = physics.PhysicsControl(*physics.read_out(actor))
    assert physics.apply(actor, list(given)) == []
    before, tried = actor.car.vehicle, set()

    def other(value: Any) -> Any:
        if isinstance(value, list):
            return [other(each) for each in value]
        return (not value) if isinstance(value, bool) else 0.9 * value + 0.01

    wheels = physics.WheelPhysics._fields[:-1]
    changes = [(f"wheels.{name}", k) for k, name in enumerate(wheels)]
    changes += [(f"center_of_mass.{axis}", k) for k, axis in enumerate("xyz")]
    changes += [(name, -1) for name in given._fields]
    for name, k in changes:
        field = name.partition(".")[0]
        old = getattr(given, field)
        if field == "wheels" and k >= 0:
            new = [[other(v) if i == k else v for i, v in enumerate(wheel)] for wheel in old]
        elif k >= 0:
            new = [other(v) if i == k else v for i, v in enumerate(old)]
        elif field in {"wheels", "center_of_mass"}:
            continue
        else:
            new = other(old)
        idle = physics.apply(actor, list(given._replace(**{field: new})))
        assert (actor.car.vehicle != before) is (name in ACTS), name
        assert idle == ([] if name in ACTS else [name])
        tried.add(name)
        assert physics.apply(actor, list(given)) == []
    assert tried >= ACTS


def test_a_car_of_other_mass_centre_stays_where_it_is() -> None:
    car = Car(CarlaModel3(), 0.45)
    car.transform = Transform(5.0, 6.0, yaw=40.0)
    car.fit(CarlaModel3(mass=2000.0), 0.1)
    assert car.transform == pytest.approx(Transform(5.0, 6.0, yaw=40.0))
    assert car.motion.pose.x == pytest.approx(5.0 + 0.1 * math.cos(math.radians(40.0)))


@pytest.mark.parametrize(
    ("found", "period", "substeps"),
    [
        (EpisodeSettings(fixed_delta=0.05), 0.05, 5),
        (EpisodeSettings(fixed_delta=0.05, max_substep_delta=0.016), 0.05, 4),
        (EpisodeSettings(fixed_delta=0.5, max_substep_delta=0.01, max_substeps=10), 0.5, 10),
        (EpisodeSettings(fixed_delta=0.05, substepping=False), 0.05, 1),
        (EpisodeSettings(), 0.02, 2),
    ],
)
def test_substeps_are_those_of_the_settings(
    found: EpisodeSettings, period: float, substeps: int
) -> None:
    assert (found.period, found.substeps) == (period, substeps)
    assert EpisodeSettings.read(found.wire()) == found


class Ear:
    """Somebody who listens."""

    def __init__(self) -> None:
        self.heard: list[bytes] = []

    def send(self, data: bytes) -> None:
        self.heard.append(data)

    def waiting(self) -> int:
        return 0


def test_a_subscription_counts_from_the_question() -> None:
    now = 0.0
    streams = Streams(lambda: now)
    early, late, other = Ear(), Ear(), Ear()
    streams.join(1, early)
    streams.publish(StreamMessage(1, b"a"))
    streams.expect(1)
    streams.publish(StreamMessage(1, b"b"))
    streams.publish(StreamMessage(2, b"x"))
    streams.publish(StreamMessage(1, b"c"))
    streams.join(1, late)
    streams.publish(StreamMessage(1, b"d"))
    assert b"".join(early.heard) == b"".join(framed(bytes([c])) for c in b"abcd")
    assert b"".join(late.heard) == b"".join(framed(bytes([c])) for c in b"bcd")
    # Who asks and does not come is forgotten, and never kept more than a limit for.
    streams.expect(1)
    for _ in range(3):
        streams.publish(StreamMessage(1, bytes(MAX_WAITING // 2)))
    streams.expect(1)
    now = 60.0
    streams.join(1, other)
    assert other.heard == []
    streams.expect(1)
    for _ in range(3):
        streams.publish(StreamMessage(1, bytes(MAX_WAITING // 2)))
    last = Ear()
    streams.join(1, last)
    assert 0 < sum(map(len, last.heard)) <= MAX_WAITING
    streams.leave(1, last)
    streams.publish(StreamMessage(1, b"e"))
    assert b"e" not in last.heard[-1]


def test_what_a_lost_client_asked_for_is_no_other_ones() -> None:
    streams, lost, present = Streams(), object(), Ear()
    streams.asker = lost
    streams.expect(1)
    streams.publish(StreamMessage(1, b"a"))
    streams.asker = present
    streams.expect(1)
    streams.forget(lost)
    streams.publish(StreamMessage(1, b"b"))
    streams.join(1, present)
    assert present.heard == [framed(b"b")]


def test_cars_can_be_spawned_along_lanes(caplog: pytest.LogCaptureFixture) -> None:
    found = read_map("road", ROAD).spawn_points
    # 5 m along the lane, and every 20 m, 2 m right of the line, mirrored into CARLA's axes.
    c, s = math.cos(0.5), math.sin(0.5)
    assert [(p.x, -p.y) for p in found] == [
        pytest.approx((5 + along * c + 2 * s, 6 + along * s - 2 * c), abs=1e-6)
        for along in (5.0, 25.0, 45.0, 65.0)
    ]
    assert [p.yaw for p in found] == pytest.approx(4 * [-math.degrees(0.5)])
    points = default_map().spawn_points
    assert len(points) == 2 * 50
    assert {round(abs(p.yaw)) for p in points} == {0, 180}
    # The same road once more, 3 m ahead: no two cars are put into one place.
    twice = (
        ROAD[: ROAD.index("<road ")] + 2 * ROAD[ROAD.index("<road ") : ROAD.index("</OpenDRIVE>")]
    )
    twice = twice.replace('id="7"', 'id="8"', 1).replace('x="5.0"', 'x="8.0"', 1) + "</OpenDRIVE>"
    both = read_map("twice", twice).spawn_points
    boxes = [Actor(0, [], point, extent=(2.5, 1.1, 1.0)) for point in both]
    assert len(both) >= len(found)
    assert not any(overlap(a, b) for a, b in combinations(boxes, 2))
    unread = ROAD.replace('length="80.0"', 'length="many"')
    assert read_map("road", unread).spawn_points == ()
    assert "no spawn points" in caplog.text
