"""A controller of which the input comes from an estimator and a predictor."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from steersman.config import Of, param, register
from steersman.controllers.base import ControllerComponent, Wrapper, present
from steersman.controllers.plausible import usable
from steersman.estimators.base import EstimatorComponent, PredictorComponent
from steersman.types import Decision, Observation
from steersman.vehicles import Vehicle


class EstimatedState(NamedTuple):
    """The states of estimators and controller."""

    chain: tuple[Any, ...]
    controller: Any


@register("controller", "estimated")
class Estimated(Wrapper):
    """Hands a controller the estimated state of car and road in place of the measured one.

    Every command that is executed goes back to estimator and predictor.
    """

    estimator: Annotated[EstimatorComponent | None, Of("estimator", optional=True)] = param(
        "kalman", "-", "State estimator; null: none."
    )
    predictor: Annotated[PredictorComponent | None, Of("predictor", optional=True)] = param(
        None, "-", "Predictor behind it, for delays; null: none."
    )
    controller: Annotated[ControllerComponent, Of("controller")] = param(
        "tuned/lqr", "-", "The controller that steers."
    )

    def init(self, vehicle: Vehicle, dt: float) -> EstimatedState:
        """State before the first step."""
        return self._begun(vehicle, dt, self.controller.init(vehicle, dt))

    def redesign(self, vehicle: Vehicle, dt: float) -> EstimatedState:
        """The same, with the controller's own redesign."""
        return self._begun(vehicle, dt, self.controller.redesign(vehicle, dt))

    def _begun(self, vehicle: Vehicle, dt: float, inner: Any) -> EstimatedState:
        return EstimatedState(tuple(one.init(vehicle, dt) for one in self._chain()), inner)

    def step(
        self, state: EstimatedState, observation: Observation
    ) -> tuple[Decision, EstimatedState]:
        """The controller's decision on what was estimated.

        An observation that no controller can use gets the present steering, marked as a fallback,
        and leaves the state alone.
        """
        seen = usable(observation)
        if seen is None:
            limit = self.controller.speed_limit(state.controller)
            return present(observation)._replace(speed_limit=limit), state
        chain: tuple[Any, ...] = ()
        for one, before in zip(self._chain(), state.chain, strict=True):
            seen, after = one.estimate(before, seen)
            seen = seen._replace(wished=observation.wished)
            chain = (*chain, after)
        decision, inner = self.controller.step(state.controller, seen)
        return decision, self._told(EstimatedState(chain, inner), decision.steer)

    def executed(self, state: EstimatedState, steer: float) -> EstimatedState:
        """The executed command goes to estimator, predictor and controller."""
        after = self.controller.executed(state.controller, steer)
        return self._told(state._replace(controller=after), steer)

    def _told(self, state: EstimatedState, steer: float) -> EstimatedState:
        pairs = zip(self._chain(), state.chain, strict=True)
        return state._replace(chain=tuple(one.executed(before, steer) for one, before in pairs))

    def _chain(self) -> tuple[EstimatorComponent, ...]:
        return tuple(one for one in (self.estimator, self.predictor) if one is not None)


def in_front(
    controller: ControllerComponent,
    estimator: EstimatorComponent | None,
    predictor: PredictorComponent | None,
) -> ControllerComponent:
    """The controller with these in front of it; itself without either."""
    if estimator is None and predictor is None:
        return controller
    return Estimated(estimator=estimator, predictor=predictor, controller=controller)
