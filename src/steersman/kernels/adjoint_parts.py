"""Parts of the way back: reward, observation, place on the road. See :mod:`adjoint`."""

from __future__ import annotations

import math

from steersman.kernels import encode as enc
from steersman.kernels import observe as obs
from steersman.kernels import path as paths
from steersman.kernels import reward as rew
from steersman.kernels import vehicle as car
from steersman.kernels import world as loop
from steersman.kernels.compiled import kernel
from steersman.kernels.dual_number import WIDTH, rows
from steersman.kernels.fleet import World
from steersman.kernels.tape import COMMANDS, JUDGED, REWARD, Adjoint, Slopes, Tape

# Directions of the reward's dual numbers, as columns behind the value.
_VX, _VY, _RATE, _D, _HEADING, _KAPPA, _STEER, _PREVIOUS = range(1, WIDTH)


@kernel
def reward(
    slopes: Slopes, tape: Tape, t: int, n: int, dt: float, weight: float, adjoint: Adjoint
) -> tuple[float, float]:
    """Slopes of the reward after step ``t``; returns those at command and previous command."""
    work, state, tracking = adjoint.judged, tape.next_state[t, n], tape.next_tracking[t, n]
    work[:] = 0.0
    for i in range(car.N_STATE):
        work[i, 0] = state[i]
    place = work[car.N_STATE :]
    for i in range(obs.N_TRACKING):
        place[i, 0] = tracking[i]
    v_x, v_y = state[car.VX], state[car.VY]
    square = max(v_x * v_x + v_y * v_y, 1e-12)
    work[car.VX, _VX], work[car.VY, _VY], work[car.YAW_RATE, _RATE] = 1.0, 1.0, 1.0
    place[obs.D, _D], place[obs.HEADING, _HEADING], place[obs.KAPPA, _KAPPA] = 1.0, 1.0, 1.0
    place[obs.COURSE, _HEADING] = 1.0
    place[obs.COURSE, _VX], place[obs.COURSE, _VY] = -v_y / square, v_x / square
    given = work[COMMANDS:]
    given[0, 0], given[0, _STEER] = tape.executed[t, n], 1.0
    given[1, 0], given[1, _PREVIOUS] = tape.memory[t, n, enc.LAST_COMMAND], 1.0
    commands, judged = rows(given), rows(work[JUDGED:])
    demo = tape.demo[t, n]
    rew.describe(rows(work), rows(place), commands[0], commands[1], demo, dt, math.nan, judged)
    rew.judge(slopes.reward, judged, rows(work[REWARD:]))
    out = work[REWARD + rew.TOTAL]
    adjoint.state[n, car.VX] += weight * out[_VX]
    adjoint.state[n, car.VY] += weight * out[_VY]
    adjoint.state[n, car.YAW_RATE] += weight * out[_RATE]
    adjoint.place[obs.D] += weight * out[_D]
    adjoint.place[obs.HEADING] += weight * out[_HEADING]
    adjoint.place[obs.KAPPA] += weight * out[_KAPPA]
    return weight * out[_STEER], weight * out[_PREVIOUS]


@kernel
def sense(world: World, tape: Tape, t: int, n: int, adjoint: Adjoint) -> None:
    """From slopes at an observation that was measured after step ``t`` to state and place."""
    row, out, place = adjoint.rows[t, n], adjoint.state[n], adjoint.place
    if tape.arrives[t, n] != loop.MEASURED:
        return
    place[obs.D] += row[obs.O_D]
    place[obs.HEADING] += row[obs.O_HEADING]
    place[obs.KAPPA] += row[obs.O_KAPPA]
    out[car.VX] += row[obs.O_VX]
    out[car.VY] += row[obs.O_VY]
    out[car.YAW_RATE] += row[obs.O_RATE]
    out[car.STEER] += row[obs.O_STEER]
    state, s = tape.next_state[t, n], tape.next_tracking[t, n, obs.S]
    yaw = state[car.PSI]
    c, d = math.cos(yaw), math.sin(yaw)
    for i in range((row.shape[0] - obs.O_PREVIEW) // 2):
        by_x, by_y = row[obs.O_PREVIEW + 2 * i], row[obs.O_PREVIEW + 2 * i + 1]
        if by_x == 0.0 and by_y == 0.0:
            continue
        x, y, _, _, along, up = paths.frame(world.paths, tape.path[t, n], s + i * world.spacing)
        dx, dy = x - state[car.X], y - state[car.Y]
        out[car.X] += d * by_y - c * by_x
        out[1] -= d * by_x + c * by_y
        out[car.PSI] += by_x * (c * dy - d * dx) - by_y * (c * dx + d * dy)
        place[obs.S] += by_x * (along * c + up * d) + by_y * (up * c - along * d)


@kernel
def track(world: World, tape: Tape, t: int, n: int, adjoint: Adjoint) -> None:
    """From slopes at the place on the road after step ``t`` to the pose."""
    table, p, place, out = world.paths, tape.path[t, n], adjoint.place, adjoint.state[n]
    tracking = tape.next_tracking[t, n]
    s, kappa = tracking[obs.S], tracking[obs.KAPPA]
    sharp = 0.0
    if table.meta[p, paths.CLOSED] > 0.0 or 0.0 <= s <= table.meta[p, paths.LENGTH]:
        sharp = table.pieces[paths.locate(table, p, s), paths.SHARPNESS]
    psi = tape.next_state[t, n, car.PSI] - tracking[obs.HEADING]
    along = place[obs.S] - kappa * place[obs.HEADING] + sharp * place[obs.KAPPA]
    along /= 1.0 - kappa * tracking[obs.D]
    c, d = math.cos(psi), math.sin(psi)
    out[car.X] += along * c - place[obs.D] * d
    out[car.Y] += along * d + place[obs.D] * c
    out[car.PSI] += place[obs.HEADING]
    place[:] = 0.0
