"""A client that owns the clock of a CARLA server: connect, recover, load, spawn, tick, leave.

The module ``carla`` is handed in (:mod:`steersman.plants.carla` imports it). Whatever goes wrong
becomes a :class:`~steersman.errors.PlantError` of one line that names the server and the cure.
"""

from __future__ import annotations

import atexit
import logging
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from steersman.errors import PlantError, suggestion
from steersman.plants import carla_steps
from steersman.plants.carla_server import Clock, Server, check_version, retried, stem

_log = logging.getLogger("steersman.carla")

ROLE = "steersman"
"""Role name of what we spawn, by which left-over actors are known again."""
# While another client drives a synchronous server, its ticks are no farther apart [s].
_OTHERS_TICK = 1.0
# First pause before looking again whether a new world is there; the next are longer [s].
_FIRST_LOOK = 0.03


class Session:
    """A synchronous server, from ``open`` to ``close``."""

    def __init__(self, lib: Any, server: Server, clock: Clock) -> None:
        """Not connected yet."""
        self.lib = lib
        self.server = server
        self.clock = clock
        self.client: Any = None
        self.world: Any = None
        self.version = ""
        self.notes: list[str] = []
        """What was found and mended on the way, for the reader."""
        self._actors: list[int] = []
        self._found: Any = None
        self._driving = False

    # ------------------------------------------------------------------------ coming, going

    def open(self, *, aloud: bool = True) -> None:
        """Connect, mend what a crash left behind, and take over the clock.

        What was mended is in ``notes``, and in the log if ``aloud``.

        Raises:
            PlantError: there is no server, it is of another version, or another client drives it.
        """
        retried(self.server.knock, self.server.attempts)
        atexit.register(self.close)  # after errors that are not caught
        with self.server.answers("connecting"):
            self.client = self.lib.Client(self.server.host, self.server.port)
            self.client.set_timeout(self.server.timeout)
            self.version = str(self.client.get_server_version())
        check_version(self.version, str(self.client.get_client_version()))
        with self.server.answers("reading the world"):
            self.world = self.client.get_world()
            self._found = self.world.get_settings()
        if self._found.synchronous_mode:
            self._recover()
        for text in self.notes if aloud else ():
            _log.warning(text)
        self.take_clock()

    def _recover(self) -> None:
        """A synchronous server waits for its client: is there one, or did it crash?

        Raises:
            PlantError: there is one.
        """
        wait = min(_OTHERS_TICK, self.server.timeout)
        try:
            self.world.wait_for_tick(wait)
        except RuntimeError:
            pass  # no client ticks: it is stale
        else:
            raise PlantError(
                f"{self.server}: another client is driving this server in synchronous mode; stop "
                "it, or use a server of your own (plant.port)"
            )
        with self.server.answers("recovering a stale session"):
            self.world.tick(self.server.timeout)
            gone = self.remove_leftovers()
            settings = self.world.get_settings()
            settings.synchronous_mode, settings.fixed_delta_seconds = False, None
            settings.no_rendering_mode = False
            self._found = settings
        self.notes.append(
            f"{self.server} was left in synchronous mode by a client that is gone; recovered, "
            f"{gone} of its vehicles destroyed"
        )

    def remove_leftovers(self) -> int:
        """Destroy vehicles of ours that are not this session's; how many."""
        old = [
            actor.id
            for actor in self.world.get_actors().filter("vehicle.*")
            if actor.attributes.get("role_name") == ROLE and actor.id not in self._actors
        ]
        self._destroy(old)
        return len(old)

    def take_clock(self) -> None:
        """Synchronous mode with our period; loading a world undoes it."""
        with self.server.answers("setting synchronous mode"):
            settings = self.world.get_settings()
            settings.synchronous_mode = True
            settings.fixed_delta_seconds = self.clock.dt
            settings.substepping = True
            settings.max_substep_delta_time = self.clock.substep
            settings.max_substeps = self.clock.substeps
            settings.no_rendering_mode = not self.clock.rendering
            self.world.apply_settings(settings)
        self._driving = True

    def release_clock(self) -> None:
        """The settings that were found, so that the server goes on by itself."""
        if self._driving:
            self._driving = False
            with self.server.answers("restoring the settings"):
                self.world.apply_settings(self._found)

    def close(self) -> None:
        """Destroy what was spawned and give the clock back, if the server still answers."""
        atexit.unregister(self.close)
        if self.client is None:
            return
        client, self.client = self.client, None
        if self.server.alive():
            with suppress(RuntimeError, PlantError):
                client.set_timeout(min(self.server.timeout, 5.0))
                self._destroy(self._actors, client)
                self.release_clock()
        self._actors, self._driving = [], False

    # ------------------------------------------------------------------------------- worlds

    def load(self, name: str) -> None:
        """The map of that name, unless it is there already.

        Raises:
            PlantError: there is none.
        """
        with self.server.answers("listing maps"):
            if stem(self.world.get_map().name) == stem(name):
                return
            known = [stem(found) for found in self.client.get_available_maps()]
        if stem(name) not in known:
            raise PlantError(f"{self.server} has no map {name!r}{suggestion(stem(name), known)}")
        self._change(lambda: self.client.load_world(stem(name)))
        with self.server.answers(f"loading {name}"):
            self._await_map(lambda found: bool(stem(found.name) == stem(name)))

    def generate(self, text: str) -> None:
        """The world of an OpenDRIVE text, unless it is there already.

        Raises:
            PlantError: it is refused, or not ready in time.
        """
        with self.server.answers("reading the map"):
            if self.world.get_map().to_opendrive().split() == text.split():
                return
        # No walls: the road is a plane, and what leaves it is put back.
        shape = self.lib.OpendriveGenerationParameters(
            vertex_distance=2.0,
            max_road_length=500.0,
            wall_height=0.0,
            additional_width=2.0,
            smooth_junctions=True,
            enable_mesh_visibility=True,
        )
        before = self.world.id
        self._change(lambda: self.client.generate_opendrive_world(text, shape))
        with self.server.answers("generating the world"):
            self._await_map(lambda _: bool(self.world.id != before))

    def _change(self, load: Callable[[], Any]) -> None:
        """Replace the world; with it go our actors and settings."""
        self.release_clock()
        self._actors = []
        with self.server.answers("loading a world"):
            load()

    def _await_map(self, ready: Callable[[Any], bool]) -> None:
        """Ask until the new world answers, then take over its clock: loading does not wait.

        Raises:
            PlantError: not within the time-out.
        """
        until = time.monotonic() + self.server.timeout
        pause = _FIRST_LOOK
        while True:
            with suppress(RuntimeError):
                self.world = self.client.get_world()
                if ready(self.world.get_map()):
                    break
            if time.monotonic() > until:
                raise PlantError(
                    f"{self.server}: the new world is not ready after {self.server.timeout:g} s; "
                    "give it longer with plant.timeout"
                )
            time.sleep(pause)
            pause = min(2.0 * pause, 1.0)
        self.take_clock()

    # ------------------------------------------------------------------------------- actors

    def spawn(self, blueprint: str, transform: Any) -> Any:
        """A vehicle of ours.

        Raises:
            PlantError: no such blueprint, or the place is taken.
        """
        with self.server.answers("reading the blueprints"):
            library = self.world.get_blueprint_library()
            known = [found.id for found in library.filter("vehicle.*")]
            if blueprint not in known:
                raise PlantError(
                    f"plant.vehicle: {self.server} has no {blueprint!r}"
                    f"{suggestion(blueprint, known)}"
                )
            found = library.find(blueprint)
            if found.has_attribute("role_name"):
                found.set_attribute("role_name", ROLE)
            if self.remove_leftovers():
                self.tick()  # they are gone only then

        def attempt() -> Any:
            with self.server.answers("spawning"):
                actor = self.world.try_spawn_actor(found, transform)
                self.tick()  # what was destroyed is gone only then
            if actor is None:
                raise PlantError(self._in_the_way(transform))
            return actor

        actor = retried(attempt, self.server.attempts)
        self._actors.append(actor.id)
        return actor

    def _in_the_way(self, transform: Any) -> str:
        where = transform.location
        others = self.world.get_actors().filter("vehicle.*")
        near = min(others, key=lambda a: a.get_location().distance(where), default=None)
        what = "something stands there"
        if near is not None:
            gap = near.get_location().distance(where)
            what = f"nearest is actor {near.id}, {near.type_id}, {gap:.1f} m away"
        return (
            f"{self.server}: spawning at x {where.x:.1f}, y {where.y:.1f} (CARLA's axes) collides; "
            f"{what}; destroy it ('steersman carla doctor --clean') or begin elsewhere with start="
        )

    def _destroy(self, actors: list[int], client: Any = None) -> None:
        if actors:
            commands = [self.lib.command.DestroyActor(number) for number in actors]
            (client or self.client).apply_batch_sync(commands, False)

    def forget(self, number: int) -> None:
        """An actor of ours is no more."""
        self._actors = [other for other in self._actors if other != number]

    # --------------------------------------------------------------------------------- time

    def tick(self) -> Any:
        """One period; the snapshot at its end.

        Raises:
            PlantError: the server does not answer, or another client ticks it too.
        """
        return carla_steps.tick(self.server, self.client, self.world)

    def send(self, commands: list[Any]) -> None:
        """Commands that are executed, in their order, before this returns.

        Raises:
            PlantError: one is refused, or there is no answer.
        """
        carla_steps.send(self.server, self.client, commands)
