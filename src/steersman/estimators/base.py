"""What estimators and predictors share: an observation in, a better one out."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

from steersman.config import Component
from steersman.types import Observation
from steersman.vehicles import Vehicle


class EstimatorComponent(Component):
    """What stands between sensor and controller."""

    family: ClassVar[str] = "estimator"

    @abstractmethod
    def init(self, vehicle: Vehicle, dt: float) -> Any:
        """State before the first observation.

        Args:
            vehicle: nominal parameters.
            dt: control period [s].
        """

    @abstractmethod
    def estimate(self, state: Any, observation: Observation) -> tuple[Observation, Any]:
        """What a controller is to see, and the new state; ``state`` itself is not changed.

        Args:
            state: of the last step.
            observation: of this step, every number finite. A sample that got lost is the last
                observation again, with its own time.
        """

    def executed(self, state: Any, steer: float) -> Any:
        """The state after the last step, given the executed steering [normalised]."""
        return state


class PredictorComponent(EstimatorComponent):
    """An estimator that gives what will be observed when the next command acts."""

    family: ClassVar[str] = "predictor"
