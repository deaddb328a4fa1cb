"""Steersman trains, tunes, compares and delivers steering controllers.

This is the front door: what is not here is private and may change without notice. Every name is
imported when it is first used, so that ``import steersman`` costs next to nothing.

>>> import steersman as sm
>>> sm.drive("tuned/lqr", path="circle", duration=2).end
'duration'
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from steersman import files as files
    from steersman.api.adopting import adopt as adopt
    from steersman.api.benching import bench as bench
    from steersman.api.benching import compare as compare
    from steersman.api.driving import attempt as attempt
    from steersman.api.driving import configure as configure
    from steersman.api.driving import drive as drive
    from steersman.api.driving import make as make
    from steersman.api.learning import imitate as imitate
    from steersman.api.learning import search as search
    from steersman.api.learning import train as train
    from steersman.api.loading import load as load
    from steersman.api.studies import falsify as falsify
    from steersman.api.studies import identify as identify
    from steersman.api.studies import tune as tune
    from steersman.config import Component as Component
    from steersman.config import Of as Of
    from steersman.config import Settings as Settings
    from steersman.config import components as components
    from steersman.config import dump as dump
    from steersman.config import families as families
    from steersman.config import param as param
    from steersman.config import register as register
    from steersman.config import required as required
    from steersman.controllers.base import ControllerComponent
    from steersman.engine.jobs import Workers as Workers
    from steersman.engine.journal import Journal as Journal
    from steersman.engine.journal import LineFormat as LineFormat
    from steersman.engine.work import Job as Job
    from steersman.episode import Episode as Episode
    from steersman.errors import ConfigError as ConfigError
    from steersman.errors import ControllerError as ControllerError
    from steersman.errors import DataError as DataError
    from steersman.errors import PlantError as PlantError
    from steersman.errors import SteersmanError as SteersmanError
    from steersman.errors import TrainingDiverged as TrainingDiverged
    from steersman.errors import suggestion as suggestion
    from steersman.features.base import Feature as Feature
    from steersman.features.base import Loop as Loop
    from steersman.learning.config import TrainConfig as TrainConfig
    from steersman.learning.parallel import TrainingEvent as TrainingEvent
    from steersman.learning.parallel import TrainingJob as TrainingJob
    from steersman.learning.parallel import train_all as train_all
    from steersman.learning.rewards import Judged as Judged
    from steersman.learning.rewards import RewardTerm as RewardTerm
    from steersman.metrics.base import summarise as summarise
    from steersman.outcome import Attempt as Attempt
    from steersman.paths.base import PathComponent
    from steersman.paths.xodr.starts import lane_starts as lane_starts
    from steersman.plants.base import PlantComponent
    from steersman.plants.carla_frame import CarlaFrame as CarlaFrame
    from steersman.plants.motion import VehicleMotion as VehicleMotion
    from steersman.provenance import provenance as provenance
    from steersman.report import article as article
    from steersman.rollout import RunConfig as RunConfig
    from steersman.sensing import observations as observations
    from steersman.speed import SpeedComponent
    from steersman.stored import StoredResult as StoredResult
    from steersman.studies.demo import PAPER_CIRCLE as PAPER_CIRCLE
    from steersman.types import Command as Command
    from steersman.types import Decision as Decision
    from steersman.types import Observation as Observation
    from steersman.types import Pose as Pose
    from steersman.types import Status as Status
    from steersman.types import VehicleState as VehicleState
    from steersman.vehicles import Vehicle as Vehicle

    Controller = ControllerComponent
    Path = PathComponent
    Plant = PlantComponent
    Speed = SpeedComponent

__version__: str  # of what is installed

# The front door: the names behind each module. To add one: here, and above for type checkers.
_FRONT_DOOR = {
    "api.driving": ("drive", "attempt", "configure", "make"),
    "api.learning": ("train", "search", "imitate"),
    "api.studies": ("tune", "falsify", "identify"),
    "api.benching": ("bench", "compare"),
    "api.loading": ("load",),
    "api.adopting": ("adopt",),
    "config": (
        *("register", "param", "required", "Of", "Component", "Settings"),
        *("components", "families"),
        "dump",  # the plain data of a configuration, for records of one's own
    ),
    "rollout": ("RunConfig",),
    "outcome": ("Attempt",),
    "learning.config": ("TrainConfig",),
    "controllers.base": ("Controller",),
    "paths.base": ("Path",),
    "plants.base": ("Plant",),
    "speed": ("Speed",),
    "vehicles": ("Vehicle",),
    "features.base": ("Feature", "Loop"),  # what a network reads
    "learning.rewards": ("RewardTerm", "Judged"),  # what is rewarded
    "plants.motion": ("VehicleMotion",),  # a car in a world of one's own (carla_standin)
    "plants.carla_frame": ("CarlaFrame",),  # CARLA's axes, for a client or server of one's own
    "paths.xodr.starts": ("lane_starts",),  # where cars may be put on a map (carla_standin)
    # What a study of one's own needs (ddpg_mpc_pid): trainings side by side, which are resumed; the
    # figures of a drive; what a controller was given on it; what made the results; the paper.
    "engine.jobs": ("Workers",),
    "engine.work": ("Job",),
    "engine.journal": ("Journal", "LineFormat"),
    "stored": ("StoredResult",),
    "learning.parallel": ("train_all", "TrainingJob", "TrainingEvent"),
    "metrics.base": ("summarise",),
    "sensing": ("observations",),
    "provenance": ("provenance",),
    "studies.demo": ("PAPER_CIRCLE",),
    "types": ("Observation", "Decision", "Status", "Command", "VehicleState", "Pose"),
    "episode": ("Episode",),
    "errors": (
        *("SteersmanError", "ConfigError", "DataError"),
        *("ControllerError", "PlantError", "TrainingDiverged"),
        "suggestion",  # a plug-in's error names the nearest match in the same words
    ),
}
# Names that are shorter here than in their module.
_LONGER = {name: f"{name}Component" for name in ("Controller", "Path", "Plant", "Speed")}
# Modules that are public as a whole: files that are written whole or not; pages of sections.
_WHOLE = {"files": "files", "article": "report.article"}
_MODULES = {name: module for module, names in _FRONT_DOOR.items() for name in names}


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name == "__version__":
        from importlib.metadata import version

        return version("steersman")
    if name in _WHOLE:
        return import_module(f"steersman.{_WHOLE[name]}")
    if name not in _MODULES:
        raise AttributeError(f"module 'steersman' has no attribute {name!r}")
    module = import_module(f"steersman.{_MODULES[name]}")
    value = getattr(module, _LONGER.get(name, name))
    globals()[name] = value
    _join(value, sys.modules.get(f"steersman.{name}"))
    return value


def _join(verb: Any, package: ModuleType | None) -> None:
    """Let a verb have the modules of the package that has its name: ``steersman.bench.suite``."""
    if hasattr(package, "__path__"):
        verb.__dict__ = package.__dict__


def __dir__() -> list[str]:
    return sorted([*_MODULES, *_WHOLE, "__version__"])


def _register_environment() -> None:
    from gymnasium.envs.registration import register

    # Gymnasium's passive checker counts a first reset that was refused as done, and then fails.
    register(
        id="steersman/PathFollowing-v0",
        entry_point="steersman.learning.env:PathFollowingEnv",
        disable_env_checker=True,
    )


class _AfterGymnasium:
    """Registers the environment once Gymnasium is imported.

    Gymnasium has no entry points for that, and its import would make this one ten times slower.
    """

    @classmethod
    def find_spec(cls, name: str, path: Any = None, target: Any = None) -> Any:
        if name != "gymnasium":
            return None
        from importlib.util import find_spec

        sys.meta_path.remove(cls)
        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                _register_environment()

            spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return spec


class _FrontDoor(ModuleType):
    def __setattr__(self, name: str, value: Any) -> None:
        # Python binds the package steersman.bench here once it is imported: the verb stays.
        if not (name in _MODULES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)
        elif name in self.__dict__:
            _join(self.__dict__[name], value)


sys.modules[__name__].__class__ = _FrontDoor
if "gymnasium" in sys.modules:
    _register_environment()
else:
    sys.meta_path.insert(0, _AfterGymnasium)
