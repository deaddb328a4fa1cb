"""CARLA's own traffic manager, in a client of its own, drives a car of the stand-in."""

from __future__ import annotations

import subprocess
import sys

import pytest

from .serving import Serving

pytest.importorskip("carla", reason="the wheel 'carla' is not installed")

# In about one of thirty runs the client waits for ever in TrafficManagerLocal::SynchronousTick, for
# a condition of its own threads, while no call of it is without an answer. Then another one tries.
ATTEMPTS, PATIENCE = 4, 20.0
CLIENT = """
import sys, carla
client = carla.Client("127.0.0.1", int(sys.argv[1]))
client.set_timeout(20.0)
world = client.get_world()
settings = world.get_settings()
settings.synchronous_mode, settings.fixed_delta_seconds = True, 0.05
world.apply_settings(settings)
world.tick()
# By a run that was ended; the client knows of them after a tick.
for left in world.get_actors().filter("vehicle.*"):
    left.destroy()
world.tick()
manager = client.get_trafficmanager(int(sys.argv[2]))
manager.set_synchronous_mode(True)
model = world.get_blueprint_library().find("vehicle.tesla.model3")
car = world.spawn_actor(model, world.get_map().get_spawn_points()[0])
world.tick()
start = car.get_location()
car.set_autopilot(True, manager.get_port())
for _ in range(60):
    world.tick()
print(car.get_location().distance(start))
car.set_autopilot(False, manager.get_port())
world.tick()
print(car.destroy())
settings.synchronous_mode = False
world.apply_settings(settings)
manager.set_synchronous_mode(False)
world.wait_for_tick(10.0)
world.wait_for_tick(10.0)
print(len(world.get_actors().filter("vehicle.*")))
car = world.spawn_actor(model, world.get_map().get_spawn_points()[0])
world.wait_for_tick(10.0)
go = carla.command
batch = [go.SetAutopilot(car, False, manager.get_port()), go.DestroyActor(car)]
print(sum(bool(answer.error) for answer in client.apply_batch_sync(batch)))
world.wait_for_tick(10.0)
world.wait_for_tick(10.0)
"""


def test_it_drives_a_car_and_lets_it_go(server: Serving) -> None:
    """A client aborts where its traffic manager gets an error for a car that it still sees."""
    for attempt in range(ATTEMPTS):
        words = (sys.executable, "-c", CLIENT, str(server.port), str(8100 + attempt))
        try:
            done = subprocess.run(
                words, capture_output=True, text=True, check=False, timeout=PATIENCE
            )
        except subprocess.TimeoutExpired:
            continue
        assert done.returncode == 0, done.stderr
        moved, destroyed, left, refused = done.stdout.split()
        assert 5.0 < float(moved) < 30.0
        assert (destroyed, left, refused) == ("True", "0", "0")
        return
    pytest.fail(f"{ATTEMPTS} clients did not end")
