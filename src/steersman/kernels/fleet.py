"""The arrays of N vehicles on their roads: what stays during a step, and what changes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import observe as obs
from steersman.kernels import reward as rew
from steersman.kernels import vehicle as car
from steersman.kernels.path import PathTable
from steersman.kernels.speed import SpeedTable
from steersman.kernels.vehicle import VehicleTable
from steersman.types import FloatArray

# Commands that the delay line can hold.
DELAY_LINE = 16


class World(NamedTuple):
    """What does not change during a step."""

    vehicles: VehicleTable
    paths: PathTable
    speed: SpeedTable
    weights: FloatArray
    """(3, waypoints) of the fit through shifted waypoints, see :func:`observe.sense`."""
    spacing: float
    """Distance between waypoints [m]."""
    h: float
    """Integration step [s]."""
    substeps: int
    dt: float
    """Control period [s]."""
    corridor: float
    """Half width of the corridor [m]."""
    lead_times: FloatArray
    """(N, K or 0) times of the speeds of the cars ahead [s], increasing."""
    lead_speeds: FloatArray
    """(N, K or 0) their speeds there [m/s], linear between."""


class Fleet(NamedTuple):
    """What changes: a row for each vehicle."""

    state: FloatArray
    tracking: FloatArray
    rows: FloatArray
    """(N, O_PREVIEW + 2 waypoints) observations."""
    late: FloatArray
    """(N, periods of latency + 1 or 0, O_PREVIEW + 2 waypoints) observations on their way, newest
    first."""
    delayed: FloatArray
    """(N, DELAY_LINE) the last steering commands, newest first."""
    delay: Any
    """(N,) int64 steering delay in substeps."""
    path: Any
    """(N,) int64 number of the path."""
    clock: FloatArray
    """(N, 5): control steps driven, speed controller's integral, time limit [s], distance driven
    along the path [m], distance at which the drive ends [m]."""
    ended: Any
    """(N,) int64 reason the drive ended with this step, or RUNNING."""
    errors: FloatArray
    """(N, N_MEASURED + 1 or 0) errors of the next measured pose and velocities, added to the state;
    the last column times v_x is added to v_x."""
    shifts: FloatArray
    """(N, waypoints or 0, 2) errors of the next waypoints in the vehicle's frame [m]."""
    levels: FloatArray
    """(N,) factor on the waypoints' errors [-]."""
    arrives: Any
    """(N,) int64 what arrives of the next observation: MEASURED, FROZEN, DROPPED or NOTHING."""
    bounds: FloatArray
    """(N, 2) the least and the largest steering command that the actuator takes [-]."""
    speed_limit: FloatArray
    """(N,) the largest speed that the controller allows in this step [m/s]; NaN: that which is
    wished."""
    wishes: FloatArray
    """(N, waypoints or 0) speeds wished at the waypoints [m/s]; NaN under a held throttle."""
    lead: FloatArray
    """(N, N_LEAD or 0) the cars ahead, see :mod:`steersman.kernels.lead`."""
    sent: FloatArray
    """(N,) steering command that the actuator got in this step [-]."""
    fine: FloatArray
    """(N, substeps or 0, 2) a_x and a_y at this step's integration steps [m/s^2]."""
    memory: FloatArray
    """(N, any) what a learner's features remember; so are the next five a learner's."""
    inputs: FloatArray
    """(N, features)."""
    demo: FloatArray
    """(N,) steering that the demonstrator proposes now."""
    base: FloatArray
    """(N,) steering of the base controller now, which the actions correct."""
    shares: FloatArray
    """(N,) share of the wished speed that the action allows in this step, in [0, 1]."""
    demo_shares: FloatArray
    """(N,) share that the demonstrator proposes now."""
    executed: FloatArray
    """(N,) steering command of this step, before the actuator's faults."""
    reward: FloatArray
    """(N, 4): reward, r_track, c_track, c_diff of this step."""
    judged: FloatArray
    """Scratch: the step of the vehicle in turn as the reward's terms see it."""
    work: FloatArray
    """Scratch of the integration."""
    command: FloatArray
    """(N, 3) steering, as it acted at the end of this step, throttle and brake."""
    measured: FloatArray
    """Scratch: the measured state."""
    place: FloatArray
    """Scratch: the tracking row of the measured state."""


def empty_fleet(
    n: int,
    waypoints: int,
    *,
    errors: int = 0,
    shifts: int = 0,
    late: int = 0,
    wishes: int = 0,
    lead: int = 0,
    fine: int = 0,
    memory: int = 0,
    features: int = 0,
) -> Fleet:
    """A fleet of ``n`` vehicles, all zero; the other numbers are the widths of its arrays."""
    return Fleet(
        state=np.zeros((n, car.N_STATE)),
        tracking=np.zeros((n, obs.N_TRACKING)),
        rows=np.zeros((n, obs.O_PREVIEW + 2 * waypoints)),
        late=np.zeros((n, late, obs.O_PREVIEW + 2 * waypoints)),
        delayed=np.zeros((n, DELAY_LINE)),
        delay=np.zeros(n, dtype=np.int64),
        path=np.zeros(n, dtype=np.int64),
        clock=np.zeros((n, 5)),
        ended=np.zeros(n, dtype=np.int64),
        errors=np.zeros((n, errors)),
        shifts=np.zeros((n, shifts, 2)),
        levels=np.ones(n),
        arrives=np.zeros(n, dtype=np.int64),
        bounds=np.tile([-1.0, 1.0], (n, 1)),
        speed_limit=np.full(n, np.nan),
        wishes=np.zeros((n, wishes)),
        lead=np.zeros((n, lead)),
        sent=np.zeros(n),
        fine=np.zeros((n, fine, 2)),
        memory=np.zeros((n, memory)),
        inputs=np.zeros((n, features)),
        demo=np.zeros(n),
        base=np.zeros(n),
        shares=np.ones(n),
        demo_shares=np.ones(n),
        executed=np.zeros(n),
        reward=np.zeros((n, 4)),
        judged=np.zeros(rew.N_JUDGED),
        work=np.zeros((3, car.N_MOTION)),
        command=np.zeros((n, 3)),
        measured=np.zeros(car.N_STATE),
        place=np.zeros(obs.N_TRACKING),
    )
