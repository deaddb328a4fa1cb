"""A controller for a real loop: checks another one, and replaces it by a simpler one on a fault.

docs/supervisor.md has the checks, the reasons for the thresholds, and the limits of the method.
The scheme is the simplex architecture (Sha, Using simplicity to control complexity, IEEE Software
18, 2001): a simple, proven controller takes over from a more capable, less proven one.
"""

from __future__ import annotations

import math
import time
from typing import Annotated, Any, ClassVar, NamedTuple

from steersman.config import Of, param, register
from steersman.controllers.base import ControllerComponent, Wrapper, within_limits
from steersman.controllers.candidate import Candidate, Rules, checked_step, executed
from steersman.controllers.dead_reckoning import held, moved_on, quiet, reckoned, warm_up_kernels
from steersman.controllers.supervisor_checks import (
    NOTHING_SEEN,
    LastSeen,
    Swings,
    first_sight,
    input_fault,
    no_news,
    still,
)
from steersman.types import Decision, Driver, Observation, Reason, Status
from steersman.vehicles import Vehicle

# Times [s] that differ by less are the same, but for rounding.
_SAME = 1e-9

_Controller = Annotated[ControllerComponent, Of("controller")]


class SupervisorState(NamedTuple):
    """What the supervisor carries from step to step."""

    vehicle: Vehicle
    dt: float
    candidates: tuple[Candidate, ...]
    """Inner controller, fallback and last, in the order of ``Driver``."""
    swings: Swings
    """Of the lateral acceleration under the present driver."""
    driver: Driver = Driver.INNER
    """The controller that steers."""
    reason: Reason = Reason.NONE
    """Why that is not the inner controller."""
    last: float | None = None
    """The steering executed last [normalised]; None before the first usable observation."""
    offset: float = 0.0
    """By how much the steering before the last hand-over differed from the new driver's [-]."""
    fade: float = 0.0
    """Share of it that is still added."""
    seen: LastSeen = NOTHING_SEEN


@register("controller", "supervisor")
class Supervisor(Wrapper):
    """Checks a controller, its inputs and commands, and hands over to fallbacks on a fault."""

    clock: ClassVar[Any] = staticmethod(time.perf_counter)
    """A clock [s]; read only where there is a deadline."""
    gaps = True

    inner: _Controller = param("mpc_delay", "-", "The controller that is supervised.")
    fallback: _Controller = param(
        "tuned/mpc_pid", "-", "Steers while the inner controller is not trusted."
    )
    last: _Controller = param("tuned/pid_feedforward", "-", "Steers if the fallback fails too.")
    deadline: float | None = param(
        None, "s", "Longest computing time of a step, of each controller; null: not checked.", gt=0
    )
    rate: float | None = param(
        None, "1/s", "Largest rate of the command; null: the vehicle's faster one.", gt=0
    )
    corridor: float = param(
        1.2, "m", "Lateral error, also as predicted, at which the fallback takes over.", gt=0
    )
    foresight: float = param(
        0.5, "s", "Time over which that error is predicted with its present rate.", ge=0
    )
    stale_time: float = param(
        0.3, "s", "How long the observation may stay the same to the bit while moving.", ge=0
    )
    bridge_time: float = param(
        0.3, "s", "Longest gap in usable observations without a hand-over.", ge=0
    )
    reckon_time: float = param(
        1.5, "s", "Longest gap bridged by dead reckoning; after it the steering is held.", ge=0
    )
    hasty_time: float = param(
        0.3,
        "s",
        "How long commands may change faster than `rate`; they are limited anyway.",
        ge=0,
    )
    swing: float = param(
        3.0,
        "m/s^2",
        "Least swing of the lateral acceleration (less the road's) that is counted.",
        gt=0,
    )
    swings: int = param(6, "-", "So many swings in `swing_window` are an oscillation.", ge=2)
    swing_window: float = param(5.0, "s", "Time in which swings are counted.", gt=0)
    swing_error: float = param(
        0.5, "m", "An oscillating controller that stays closer than this to the path is kept.", ge=0
    )
    recover_time: float = param(
        2.0, "s", "Time without fault after which a controller steers again.", ge=0
    )
    blend_time: float = param(
        0.5, "s", "Time over which the difference at a hand-over fades.", ge=0
    )

    def init(self, vehicle: Vehicle, dt: float) -> SupervisorState:
        """State before the first step; all three controllers are made ready."""
        warm_up_kernels(vehicle, dt)
        states = [controller.init(vehicle, dt) for controller in self._controllers()]
        candidates = tuple(Candidate(s, s) for s in states)
        return SupervisorState(vehicle, dt, candidates, still(self.swings))

    def step(self, state: SupervisorState, observation: Any) -> tuple[Decision, SupervisorState]:
        """Decide the steering for the next control period.

        Finite, within [-1, 1], and no farther from the last one than the rate allows, whatever is
        observed (None if nothing came) and whatever the controllers do.

        Raises:
            ConfigError: at the first step, a controller does not fit into this loop.
        """
        fault = input_fault(observation)
        if fault is Reason.NONE:
            fault = no_news(state.seen, observation)
        if fault is Reason.NONE:
            return self._steered(state._replace(seen=first_sight(observation)), observation, fault)
        if state.last is None:  # no usable observation yet
            return Decision(_present(observation), Status.FALLBACK, Driver.HOLD, fault), state
        seen, age, motion, road = state.seen
        road = quiet(seen) if road is None else road
        last = seen._replace(preview=road)
        age, motion = age + state.dt, moved_on(state.vehicle, last, motion, state.last, state.dt)
        state = state._replace(seen=LastSeen(seen, age, motion, road))
        if fault is Reason.STALE and age <= self.stale_time + _SAME:
            return self._steered(state, observation, Reason.NONE)
        now = None
        if age <= self.reckon_time + _SAME:
            now = reckoned(last, motion, last.time + age)
        return self._steered(state, now, fault)

    def executed(self, state: SupervisorState, steer: float) -> SupervisorState:
        """The next change counts from the executed command; all three controllers get it."""
        if state.last is None or steer == state.last:
            return state
        return self._executed(state, steer)

    def _controllers(self) -> tuple[ControllerComponent, ...]:
        return self.inner, self.fallback, self.last

    def _steered(
        self, state: SupervisorState, o: Observation | None, gap: Reason
    ) -> tuple[Decision, SupervisorState]:
        """One step; ``o`` is observed or, if there is a ``gap``, reckoned; None without either."""
        last = state.last
        if last is None:
            assert o is not None
            last = within_limits(o.steer)
        rules = self._rules(state)
        if o is not None:
            surplus = o.v_x * (o.yaw_rate - o.v_x * o.curvature)  # beyond that of the road
            swings = state.swings.after(surplus, self.swing, state.dt)
            state = state._replace(swings=swings)
        candidates = self._checked(state, o, last, rules, gap)
        driver = _choose(state.driver, candidates, self.recover_time)
        after = state._replace(candidates=candidates, driver=driver)
        after = after._replace(reason=_reason(state, after))
        if driver is Driver.HOLD:
            wanted, status = held(state.vehicle, o, last, state.dt), Status.FALLBACK
        else:
            wanted = [one.steer or 0.0 for one in candidates][driver]
            status = [one.status for one in candidates][driver]
            if driver != state.driver:
                after = after._replace(swings=still(self.swings), offset=last - wanted, fade=1.0)
            wanted, after = self._blended(after, wanted)
        steer = _limited(wanted, last, rules.step)
        if driver is not Driver.INNER:
            status = Status.FALLBACK
        elif steer != wanted and status is Status.SOLVED:
            status = Status.SATURATED
        reason = gap if driver is Driver.INNER else after.reason
        # Whatever steers, the last limit of the supervised controller holds.
        limit = candidates[Driver.INNER].speed_limit
        return Decision(steer, status, driver, reason, limit), self._executed(after, steer)

    def _checked(
        self,
        state: SupervisorState,
        o: Observation | None,
        last: float,
        rules: Rules,
        gap: Reason,
    ) -> tuple[Candidate, ...]:
        """All three after one step, checked by their commands and by the car's motion."""
        if o is None:
            return tuple(one.failed(gap) for one in state.candidates)
        first = state.last is None
        inner, *others = (
            checked_step(controller, candidate, o, last, rules, self.clock, first=first)
            for controller, candidate in zip(self._controllers(), state.candidates, strict=True)
        )
        if gap and state.seen.age > self.bridge_time + _SAME:
            # Its state may rest on dead reckoning: it restarts at the next observation.
            inner = inner.failed(gap, restart=True)
        return self._watched(state, (inner, *others), o)

    def _watched(
        self, state: SupervisorState, candidates: tuple[Candidate, ...], o: Observation
    ) -> tuple[Candidate, ...]:
        """The candidates, checked by the car's motion."""
        inner, fallback, last = candidates
        drift = o.v_x * math.sin(o.heading_error) + o.v_y * math.cos(o.heading_error)
        off, soon = abs(o.lateral_error), abs(o.lateral_error + self.foresight * drift)
        swinging = state.swings.ages[-1] < self.swing_window and off > self.swing_error
        if state.driver == Driver.INNER:
            if swinging and not inner.fault:
                inner = inner.failed(Reason.OSCILLATION)
            limit = self.corridor
        else:  # it is trusted again only when the car is well inside
            limit = 0.5 * self.corridor
        if max(off, soon) > limit and not inner.fault:
            inner = inner.failed(Reason.CORRIDOR)
        if state.driver == Driver.FALLBACK and swinging and not fallback.fault:
            fallback = fallback.failed(Reason.OSCILLATION)
        return inner, fallback, last

    def _blended(self, state: SupervisorState, wanted: float) -> tuple[float, SupervisorState]:
        """The driver's command plus what is left of the difference at the hand-over."""
        fade = 0.0
        if self.blend_time > 0.0:
            fade = max(state.fade - state.dt / self.blend_time, 0.0)
        steer = wanted + fade * state.offset if fade > 0.0 else wanted
        return steer, state._replace(fade=fade)

    def _executed(self, state: SupervisorState, steer: float) -> SupervisorState:
        pairs = zip(self._controllers(), state.candidates, strict=True)
        candidates = tuple(executed(*pair, steer) for pair in pairs)
        return state._replace(candidates=candidates, last=steer)

    def _rules(self, state: SupervisorState) -> Rules:
        vehicle, rate = state.vehicle, self.rate
        if rate is None:
            rate = max(vehicle.steer_rate_up, vehicle.steer_rate_down)
        return Rules(state.dt, rate * state.dt, self.hasty_time, self.deadline)


def _choose(before: Driver, candidates: tuple[Candidate, ...], recover_time: float) -> Driver:
    """The best controller without fault; a better one than the driver needs ``recover_time`` first.

    While no controller steers, the fallbacks are taken at once.
    """
    for driver in (Driver.INNER, Driver.FALLBACK, Driver.LAST):
        one = candidates[driver]
        trusted = one.healthy >= recover_time - _SAME
        at_once = driver >= before or (before == Driver.HOLD and driver != Driver.INNER)
        if not one.fault and (trusted or at_once):
            return driver
    return Driver.HOLD


def _reason(before: SupervisorState, after: SupervisorState) -> Reason:
    """Why the inner controller does not steer: the fault of the one that steered until now."""
    if after.driver is Driver.INNER:
        return Reason.NONE
    if before.driver in {after.driver, Driver.HOLD}:
        return Reason(before.reason)  # a checkpoint keeps numbers
    return [one.fault for one in after.candidates][before.driver] or Reason(before.reason)


def _limited(wanted: float, last: float, step: float) -> float:
    """``wanted``, or ``last`` if that is not finite, within [-1, 1] and ``step`` from ``last``."""
    wanted = wanted if math.isfinite(wanted) else last
    return within_limits(min(max(wanted, last - step), last + step))


def _present(observation: Any) -> float:
    """The measured steering; 0 if there is none."""
    if not isinstance(observation, Observation):
        return 0.0
    steer: Any = observation.steer  # of another package's sensor it may be anything
    return within_limits(steer) if isinstance(steer, float) and math.isfinite(steer) else 0.0
