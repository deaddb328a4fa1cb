"""The Gymnasium environment ``steersman/PathFollowing-v0``: one vehicle of a Problem."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from steersman.config import build, dump, merge
from steersman.errors import ConfigError, suggestion
from steersman.kernels import observe
from steersman.kernels import world as kernel
from steersman.kernels.fleet import Fleet
from steersman.kernels.vehicle import PSI, STEER, VX, VY, WHEEL, X, Y
from steersman.learning.fleet import FleetDriver
from steersman.learning.observed import observation_space
from steersman.learning.options import EpisodeOptions
from steersman.learning.problem import Problem
from steersman.learning.starts import FleetStart
from steersman.outcome import end_of
from steersman.paths.base import PathComponent
from steersman.rendering import RenderedStep, RoadRenderer, road_line

Features = NDArray[np.float32]


class PathFollowingEnv(gymnasium.Env[Features, Features]):
    """Follow a path; the action is the steering, its rate, or a correction of it.

    Observation: (features,) float32, about unit size; named in ``observation_names``.
    Action: (1,) in [-1, 1], left positive; (2,) where ``problem.joint`` adds the speed; (n,) for n
    ``problem.parameters``. Leaving the corridor, rolling over, a collision and passing the end at
    which the car is to stand terminate; time and the end of a road truncate. ``info`` holds the
    true lateral error [m], heading error [rad], speed [m/s], arc length ``s`` [m], the steering
    that the car has (normalised), ``end``, the reason of the episode's end ("" while it goes on),
    and for the returned observation the base's steering (if there is a base) and the
    demonstrator's steering and action (if there is one, and the episode goes on).
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's
        "render_modes": ["human", "rgb_array"],
        "render_fps": 20,
    }

    def __init__(
        self,
        problem: Problem | Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        **fields: Any,
    ) -> None:
        """Make the environment.

        Args:
            problem: a Problem, or the fields that differ from its default.
            render_mode: ``human`` shows every step in a window, ``rgb_array`` lets
                :meth:`render` return a picture; None draws nothing. Both need the extra ``video``.
            fields: further fields of the problem, as ``roads=["circle"]``.

        Raises:
            ConfigError: a field or the mode is not allowed.
        """
        if fields or not isinstance(problem, Problem):
            given = dump(problem) if isinstance(problem, Problem) else _fields(problem or {})
            problem = build(Problem, merge(merge({}, given or {}), _fields(fields)))
        if render_mode not in (None, *self.metadata["render_modes"]):
            near = suggestion(str(render_mode), self.metadata["render_modes"])
            raise ConfigError(f"{render_mode!r} is not allowed{near}", ("render_mode",))
        self.problem, self.render_mode = problem, render_mode
        self.metadata = {**self.metadata, "render_fps": round(1.0 / problem.plant.dt)}
        self._own = self.driver = FleetDriver(problem, 1)
        self.observation_space = observation_space(problem)
        self.action_space = spaces.Box(-1.0, 1.0, problem.turned.shape, np.float32)
        self.observation_names = problem.layout.names
        self._seeded = False
        self._picture: tuple[int, FleetDriver, RoadRenderer] | None = None

    @property
    def _fleet(self) -> Fleet:
        return self.driver.fleet

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Features, dict[str, Any]]:
        """Begin a new episode; ``seed`` makes it and those that follow repeatable.

        Args:
            seed: of all that is drawn.
            options: ``path`` (any path, also one that is none of the problem's roads), ``speed``
                to keep [m/s], ``start`` (arc length [m], or ``s``, ``offset``, ``heading``); what
                is not given is drawn.

        Raises:
            ConfigError: an option is unknown or its value not allowed.
        """
        chosen = _options(options)
        super().reset(seed=seed)
        if seed is not None or not self._seeded:
            fresh = int(self.np_random.integers(2**31)) if seed is None else seed
            self._own.seed(fresh)
            self._seeded = True
        road = self._choose(chosen.path)
        self.driver.reset(0, lambda drawn: self._started(chosen, drawn, road))
        if self._picture is not None:
            self._picture[2].restart()
        self._show()
        return self._fleet.inputs[0].astype(np.float32), self._info()

    def _started(self, chosen: EpisodeOptions, drawn: FleetStart, road: int | None) -> FleetStart:
        number = drawn.road if road is None else road
        chosen.check(self.driver.problem.roads[number], self.problem.corridor)
        return chosen.applied(drawn, road)

    def _choose(self, path: PathComponent | None) -> int | None:
        """Drive on this path from now on; the number of its road, None: it is to be drawn.

        Raises:
            ConfigError: it is none of the roads that the plant has.
        """
        self.driver = self._own
        if path is None:
            return None
        if path in self.problem.roads:
            return self.problem.roads.index(path)
        if not self.problem.plant.computed:
            kinds = ", ".join(road.kind for road in self.problem.roads)
            raise ConfigError(
                f"{path.kind} is not allowed; plant={self.problem.plant.kind} has the problem's "
                f"roads: {kinds}",
                ("options", "path"),
            )
        self.driver = FleetDriver(self.problem.model_copy(update={"roads": (path,)}), 1)
        self.driver.simulation.rngs = self._own.simulation.rngs
        return 0

    def step(self, action: Any) -> tuple[Features, float, bool, bool, dict[str, Any]]:
        """Drive one control period; under an action that holds for several, all of these.

        Raises:
            ConfigError: the action is not finite, or of another shape.
        """
        given = np.asarray(action, dtype=np.float64)
        (size,) = self.action_space.shape or (1,)
        if given.size != size or not np.isfinite(given).all():
            number = "one finite number" if size == 1 else f"{size} finite numbers"
            raise ConfigError(
                f"{given.tolist()} is not allowed; must be {number} in [-1, 1] [-]", ("action",)
            )
        self.driver.step(given.reshape(1, size))
        fleet = self._fleet
        reason = int(fleet.ended[0])
        failed = reason in kernel.FAILED
        truncated = reason != kernel.RUNNING and not failed
        self._show()
        features = fleet.inputs[0].astype(np.float32)
        return features, float(fleet.reward[0, 0]), failed, truncated, self._info()

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of the present state, (height, width, 3), in mode ``rgb_array``.

        Raises:
            SteersmanError: the extra ``video`` is not installed.
        """
        if self.render_mode != "rgb_array":
            return None
        return self._drawer().frame(self._rendered())

    def _show(self) -> None:
        if self.render_mode == "human":
            self._drawer().show(self._rendered(), self.metadata["render_fps"])

    def _drawer(self) -> RoadRenderer:
        """What draws the present road."""
        road = int(self._fleet.path[0])
        if self._picture is None or self._picture[:2] != (road, self.driver):
            line = road_line(self.driver.problem.roads[road])
            made = RoadRenderer(line, self.problem.corridor, self.problem.vehicle)
            if self._picture is not None:
                self._picture[2].close()
            self._picture = (road, self.driver, made)
        return self._picture[2]

    def _rendered(self) -> RenderedStep:
        info, state = self._info(), self._fleet.state[0]
        return RenderedStep(
            time=self.driver.simulation.time(0),
            **dict(zip(("x", "y", "psi"), state[[X, Y, PSI]].tolist(), strict=True)),
            wheel_angle=float(state[WHEEL]),
            speed=info["speed"],
            lateral_error=info["lateral_error"],
            heading_error=info["heading_error"],
            steer=float(state[STEER]),
            waypoints=self.driver.simulation.observation(0).preview,
        )

    def __getstate__(self) -> dict[str, Any]:
        """What a copy goes on from; windows are not copied.

        Raises:
            ConfigError: the plant is a server's, which has one car.
        """
        if not self.problem.plant.computed:
            raise ConfigError(
                f"an environment of plant={self.problem.plant.kind} cannot be copied; make another "
                "one from its problem"
            )
        return {
            "problem": self.problem,
            "render_mode": self.render_mode,
            "roads": self.driver.problem.roads,
            "snapshot": self.driver.snapshot(),
            "seeded": self._seeded,
            "random": self._np_random,
            "random_seed": self._np_random_seed,
        }

    def __setstate__(self, saved: dict[str, Any]) -> None:
        """Go on where the other one was."""
        self.__init__(saved["problem"], saved["render_mode"])  # type: ignore[misc]
        roads = saved["roads"]
        if roads != self.problem.roads:
            self._choose(roads[0])
        self.driver.restore(saved["snapshot"])
        self._seeded = saved["seeded"]
        self._np_random, self._np_random_seed = saved["random"], saved["random_seed"]

    def close(self) -> None:
        """Release the plant, if there is one, and close the window."""
        self._own.close()
        if self._picture is not None:
            self._picture[2].close()

    def _info(self) -> dict[str, Any]:
        fleet, driver = self._fleet, self.driver
        tracking = fleet.tracking[0].tolist()
        v_x, v_y = fleet.state[0, [VX, VY]].tolist()
        info = {
            "lateral_error": tracking[observe.D],
            "heading_error": tracking[observe.HEADING],
            "s": tracking[observe.S],
            "speed": math.hypot(v_x, v_y),
            "steer": float(fleet.state[0, STEER]),
            "end": end_of(int(fleet.ended[0])),
        }
        if driver.demonstrates and fleet.ended[0] == kernel.RUNNING:
            info["demo_steer"] = float(fleet.demo[0])
            info["demo_action"] = driver.demonstrated_actions()[0]
        if self.problem.corrected is not None:
            info["base_steer"] = float(fleet.base[0])
        return info


def _options(given: Mapping[str, Any] | None) -> EpisodeOptions:
    """The checked options of a reset.

    Raises:
        ConfigError: at ``options``.
    """
    try:
        return build(EpisodeOptions, given or {})
    except ConfigError as error:
        raise ConfigError(error.what, ("options", *error.where)) from None


def _fields(given: object) -> Mapping[str, Any]:
    """Fields of a problem as they were given, after a look at how.

    Raises:
        ConfigError: they are a preset's name, or dotted as on the command line.
    """
    if not isinstance(given, Mapping):
        raise ConfigError(
            f"{given!r} is neither a Problem nor a dictionary of its fields; a preset has one: "
            "sm.configure('train', 'demo').problem",
            ("problem",),
        )
    for name, value in given.items():
        if "." in str(name):
            first, _, rest = str(name).removeprefix("problem.").partition(".")
            meant = {first: {rest: value} if rest else value}
            raise ConfigError(
                f"dots are for the command line; here fields are nested: write {meant!r}",
                (str(name),),
            )
    return given
