"""The car's control step with its Jacobian: the plant's own kernels, called with dual numbers.

Learning by analytic gradients, optimal control on the true plant and a nonlinear MPC need the
plant's derivatives. Throttle and brake are held as given. Kinks: see :mod:`dual`.
"""

from __future__ import annotations

from typing import Any

from steersman.kernels import dual as _rules  # noqa: F401 - the chain rules
from steersman.kernels import vehicle as car
from steersman.kernels.compiled import kernel
from steersman.kernels.dual_number import rows
from steersman.kernels.vehicle import VehicleTable
from steersman.types import FloatArray

# The first columns of a state row, from x to the steering, are a Jacobian's rows and first columns.
N_MOVED = car.STEER + 1
# Its further columns: the commands.
OLD_COMMAND, NEW_COMMAND = N_MOVED, N_MOVED + 1
N_COLUMNS = N_MOVED + 2
# Directions of the dual numbers: from v_x to the steering, then the commands. The pose is not
# among them: moving and turning the plane moves and turns the step.
_FIRST = car.VX
# Rows of scratch of the dual step: the state, the command, what ``vehicle.advance`` needs.
_STATE, _COMMAND, _WORK = 0, car.N_STATE, car.N_STATE + 3
N_SCRATCH = _WORK + 3 * car.N_MOTION


@kernel
def linearise(  # noqa: PLR0917 - numba takes no keyword-only arguments
    vehicles: VehicleTable,
    n: int,
    state: FloatArray,
    pedals: tuple[float, float],
    commands: tuple[float, float],
    late: int,
    h: float,
    substeps: int,
    scratch: FloatArray,
    following: FloatArray,
    jacobian: FloatArray,
) -> None:
    """One control period of vehicle ``n``, as :func:`world.drive` makes it, and its Jacobian.

    Args:
        vehicles: the cars.
        n: which of them.
        state: (N_STATE,) before the step.
        pedals: throttle and brake commands, held.
        commands: steering commands: the one that acts for the first ``late`` substeps, and the one
            that acts from then on. Delayed whole periods, they are entries of the delay line.
        late: integration steps for which the older command acts, in [0, substeps).
        h: integration step [s].
        substeps: integration steps in the period.
        scratch: (N_SCRATCH, WIDTH).
        following: (N_STATE,) gets the state after the step, to the bit what the plant gives.
        jacobian: (N_MOVED, N_COLUMNS) gets the derivatives of the first entries of the state after
            the step by those before it, by the older and by the newer command.
    """
    scratch[:] = 0.0
    for i in range(car.N_STATE):
        scratch[_STATE + i, 0] = state[i]
    for k in range(_FIRST, N_MOVED):
        scratch[_STATE + k, 1 + k - _FIRST] = 1.0
    command = rows(scratch[_COMMAND:_WORK])
    scratch[_COMMAND + car.CMD_THROTTLE, 0] = pedals[0]
    scratch[_COMMAND + car.CMD_BRAKE, 0] = pedals[1]
    moved = rows(scratch[_STATE:_COMMAND])
    all_of = rows(scratch[_WORK:])
    m = car.N_MOTION
    work: Any = (all_of[0:m], all_of[m : 2 * m], all_of[2 * m : 3 * m])
    steer = scratch[_COMMAND + car.CMD_STEER]
    for k in range(2):
        steps = late if k == 0 else substeps - late
        steer[0], steer[1 + OLD_COMMAND - _FIRST + k] = commands[k], 1.0
        if steps > 0:
            car.advance(vehicles, n, moved, command, h, steps, work)
        steer[1 + OLD_COMMAND - _FIRST + k] = 0.0
    for i in range(car.N_STATE):
        following[i] = scratch[_STATE + i, 0]
    jacobian[:] = 0.0
    for i in range(N_MOVED):
        for k in range(_FIRST, N_COLUMNS):
            jacobian[i, k] = scratch[_STATE + i, 1 + k - _FIRST]
    for k in range(_FIRST):
        jacobian[k, k] = 1.0
    jacobian[0, 2] = state[car.Y] - following[car.Y]
    jacobian[1, 2] = following[car.X] - state[car.X]
