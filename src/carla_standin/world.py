"""The world of the stand-in: settings, actors, and what happens in a tick."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from itertools import chain, combinations, product
from typing import Any, NamedTuple

from carla_standin.actors import Actor, overlap
from carla_standin.blind import BLIND
from carla_standin.blueprints import COLLISION, LANE_INVASION, SPECTATOR, check
from carla_standin.bystanders import EXTENTS, PEDESTRIANS, WEIGHT, WalkerControl
from carla_standin.car import Car, VehicleControl
from carla_standin.catalogue import VehicleBlueprint, note
from carla_standin.maps import WorldMap, default_map
from carla_standin.sensors import HEADER, Hit, StreamedSensor
from carla_standin.settings import EpisodeSettings
from carla_standin.wire import Refused, Transform, read_transform, shaped, warn_once

# Stream of the snapshots; those of sensors follow.
SNAPSHOTS = 1
# Actors that a world holds: what a client asks for is bounded.
MAX_ACTORS = 1000

# Episode, wall clock [s], period [s], map origin, state of the simulation.
_EPISODE = struct.Struct("<Qdf3iI")
_WORLD_OBSERVER = 17
_NO_CHANGE = 0
# A clear day: the weather until a client sets another.
_WEATHER = [10.0, 0.0, 0.0, 10.0, 0.0, 45.0, 2.0, 0.75, 0.1, 0.0, 1.0, 0.03, 0.0331, 0.0]


class StreamMessage(NamedTuple):
    """A message for all listeners of a stream."""

    stream: int
    payload: bytes


class StandinWorld:
    """All that clients share. Times in seconds, CARLA's axes outside, ours inside the cars."""

    def __init__(self, vehicles: dict[str, VehicleBlueprint]) -> None:
        """An empty default map in asynchronous mode."""
        self.vehicles = vehicles
        self.settings = EpisodeSettings()
        self.map: WorldMap = default_map()
        self.opendrive: WorldMap | None = None
        """What a client has sent and not yet loaded."""
        self.weather: list[Any] = list(_WEATHER)
        self.managers: dict[int, str] = {}
        """Addresses of clients' traffic managers by port."""
        self.frame = 1
        self.episode = 0
        self.actors: dict[int, Actor] = {}
        self._gone: dict[int, tuple[int, Actor]] = {}  # by their numbers; after which frame
        self._next_actor = 1
        self._next_stream = SNAPSHOTS + 1
        self._begin()

    def _begin(self) -> None:
        """A new episode with nothing in it but the spectator."""
        self.episode += 1
        self.elapsed = 0.0
        self.actors, self._gone = {}, {}
        self.spectator = self._add([0, SPECTATOR, []], Transform(), None)

    def load(self, world_map: WorldMap, reset_settings: bool) -> None:
        """Replace the map, and everything that stood on it."""
        self.map = world_map
        if reset_settings:
            self.settings = self.settings.after_loading()
        self._begin()

    # ------------------------------------------------------------------------------ actors

    def actor(self, number: Any) -> Actor:
        """The actor of that number.

        Raises:
            Refused: there is none.
        """
        found = self.actors.get(number) if isinstance(number, int) else None
        if found is None:
            raise Refused(f"there is no actor {number!r:.20}; it may have been destroyed")
        return found

    def seen(self, number: Any) -> Actor:
        """The actor of that number, also one that was destroyed after the last frame but one.

        Clients have it in their snapshots until then, and the traffic manager, which runs in
        threads of a client, ends the whole program where it gets an error.

        Raises:
            Refused: there is none.
        """
        gone = self._gone.get(number) if isinstance(number, int) else None
        return self.actor(number) if gone is None else gone[1]

    def car(self, number: Any) -> tuple[Actor, Car]:
        """The vehicle of that number.

        Raises:
            Refused: there is none, or it is no vehicle.
        """
        actor = self.actor(number)
        if actor.car is None:
            raise Refused(f"actor {actor.number} ({actor.kind}) is no vehicle")
        return actor, actor.car

    def spawn(self, description: Any, transform: Any, parent: Any = None) -> Actor:
        """A new vehicle or sensor.

        Raises:
            Refused: unknown blueprint, wrong parent, too many actors, or the place is taken.
        """
        uid, name, given = shaped(description, (0, "", [("", 0, "")]))
        check(name, self.vehicles)
        where = read_transform(transform)
        if len(self.actors) >= MAX_ACTORS:
            raise Refused(f"{MAX_ACTORS} actors are enough; destroy some first")
        owner = None if parent in {None, 0} else self.actor(parent)
        shown = [uid, name, given]
        if name in self.vehicles:
            if owner is not None:
                raise Refused("a vehicle cannot be attached to another actor")
            note(name)
            return self._add_vehicle(shown, where)
        if name in EXTENTS:
            return self._add_bystander(shown, where, owner)
        if name in {COLLISION, LANE_INVASION} and (owner is None or owner.car is None):
            raise Refused(f"{name} has to be attached to a vehicle")
        if name == LANE_INVASION:  # the client works it out by itself: no stream
            if not self.map.marked:
                raise Refused(f"{name} needs a roadMark at the beginning of every lane of the map")
            return self._add(shown, where, owner)
        attributes = {key: value for key, _, value in given}
        sensor = StreamedSensor.read(name, self._next_stream, attributes, self.map.origin)
        self._next_stream += 1
        if name in BLIND:
            warn_once(f"stand-in: {name} sends {BLIND[name].seen}: nothing is drawn or seen here")
        actor = self._add(shown, where, owner)
        actor.sensor = sensor
        return actor

    def _add(self, description: list[Any], pose: Transform, parent: Actor | None) -> Actor:
        actor = Actor(self._next_actor, description, pose, parent)
        self.actors[actor.number] = actor
        self._next_actor += 1
        return actor

    def _add_vehicle(self, description: list[Any], where: Transform) -> Actor:
        model = self.vehicles[description[1]]
        car = Car(model.vehicle, model.offset)
        car.transform = where
        given = {key: value for key, _, value in description[2]}
        control = VehicleControl(given.get("sticky_control", "true").lower() != "false")
        return self._enter(
            Actor(0, description, where, extent=model.extent, car=car, model=model, control=control)
        )

    def _add_bystander(
        self, description: list[Any], where: Transform, owner: Actor | None
    ) -> Actor:
        walk = WalkerControl() if description[1] in PEDESTRIANS else None
        new = Actor(0, description, where, owner, EXTENTS[description[1]], walk=walk)
        if walk is not None:
            new.pose = where._replace(z=new.extent[2])  # its origin is in its middle
        return self._enter(new)

    def _enter(self, new: Actor) -> Actor:
        """Let a solid actor in, if there is room.

        Raises:
            Refused: there is none.
        """
        for other in self.actors.values():
            if other.solid and other is not new.parent and overlap(new, other):
                raise Refused(
                    f"spawn failed because of a collision with actor {other.number} "
                    "at the spawn position"
                )
        new.number = self._next_actor
        self._next_actor += 1
        self.actors[new.number] = new
        return new

    def destroy(self, number: Any) -> bool:
        """Remove an actor; what was attached to it stays where it was. Whether there was one.

        Raises:
            Refused: it is the spectator.
        """
        if not isinstance(number, int) or number not in self.actors:
            return False
        actor = self.actors[number]
        if actor is self.spectator:
            raise Refused("the spectator cannot be destroyed")
        for other in self.actors.values():
            if other.parent is actor:
                other.pose, other.parent = other.transform, None
        self._gone[number] = self.frame, self.actors.pop(number)
        return True

    # ------------------------------------------------------------------------------- time

    def tick(
        self, clock: float, heard: Callable[[int], bool] = lambda _: True
    ) -> list[StreamMessage]:
        """Advance by the period of the settings; what to send, the snapshot first.

        ``heard`` says which streams have listeners.
        """
        dt, substeps = self.settings.period, self.settings.substeps
        for actor in self.actors.values():
            if actor.car is not None and actor.control is not None:
                actor.car.command = actor.control.command(actor.car, dt) or actor.car.command
                actor.car.reverse = actor.control.reverse
                actor.car.advance(dt, substeps)
            else:
                actor.advance(dt)
        self.frame += 1
        self.elapsed += dt
        self._gone = {n: each for n, each in self._gone.items() if each[0] >= self.frame - 1}
        sent = [StreamMessage(SNAPSHOTS, self.snapshot(clock))]
        sensors = [actor for actor in self.actors.values() if actor.sensor is not None]
        hits = self._hits() if sensors else []
        for actor in sensors:
            assert actor.sensor is not None
            stream = actor.sensor.stream
            for payload in actor.sensor.measure(
                actor, hits, self.frame, self.elapsed, heard(stream)
            ):
                sent.append(StreamMessage(stream, payload))
        return sent

    def snapshot(self, clock: float) -> bytes:
        """The state of everything, as the snapshot's stream carries it."""
        return b"".join(
            (
                HEADER.pack(_WORLD_OBSERVER, self.frame, self.elapsed, *[0.0] * 6),
                _EPISODE.pack(self.episode, clock, self.settings.period, 0, 0, 0, _NO_CHANGE),
                *(actor.snapshot() for actor in self.actors.values()),
            )
        )

    def _hits(self) -> list[Hit]:
        """Vehicles that overlap with something. Nothing is done about it: they pass through."""
        cars: list[tuple[float, float, float, Actor]] = []
        others: list[tuple[float, float, float, Actor]] = []
        for actor in self.actors.values():
            if actor.solid:
                x, y = actor.transform[:2]
                placed = x, y, math.hypot(*actor.extent[:2]), actor
                (others if actor.car is None else cars).append(placed)
        return [
            Hit(one, other, _impulse(one, other))
            for (x, y, r, one), (u, v, s, other) in chain(
                combinations(cars, 2), product(cars, others)
            )
            if math.hypot(x - u, y - v) <= r + s and one is not other.parent and overlap(one, other)
        ]


def _impulse(one: Actor, other: Actor) -> tuple[float, float]:
    """Impulse on ``one`` that stops two actors from coming closer, along their centres [N s]."""
    a, b = one.transform, other.transform
    x, y = a.x - b.x, a.y - b.y
    length = math.hypot(x, y) or 1.0
    (v_x, v_y), (w_x, w_y) = one.velocity, other.velocity
    closing = max(-((v_x - w_x) * x + (v_y - w_y) * y) / length, 0.0)
    size = closing / (_yields(one) + _yields(other)) / length
    return size * x, size * y


def _yields(actor: Actor) -> float:
    """One over an actor's mass [1/kg]."""
    if actor.car is not None:
        return 1.0 / actor.car.vehicle.mass
    return 0.0 if actor.walk is None else 1.0 / WEIGHT
