"""What every predictor has to fulfil."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steersman.contracts import Contract
from steersman.contracts.estimator import SHARED, as_rows, differences, estimates, exact_drive
from steersman.contracts.scenes import DT
from steersman.controllers.estimated import Estimated
from steersman.estimators.base import PredictorComponent
from steersman.plants.simulator import SimulatorConfig

# Delay of the drive [s], in periods, and when the predictor has to know it [periods].
_DELAY, _LATE, _KNOWN = 0.2, 4, 60


def what_is_predicted_comes_true(predictor: PredictorComponent) -> Iterator[str]:
    """The estimate under a steering delay is what is observed when the command acts."""
    driver = Estimated(estimator=None, predictor=predictor)
    observations, steers = exact_drive(
        controller=driver, plant=SimulatorConfig(dt=DT, steering_delay=_DELAY)
    )
    found = estimates(predictor, observations, steers)[_KNOWN:-_LATE]
    yield from differences(found, as_rows(observations)[_KNOWN + _LATE :])
    if np.allclose(found, as_rows(observations)[_KNOWN:-_LATE]):
        yield "predicts nothing"


check: Contract[PredictorComponent] = Contract(*SHARED, what_is_predicted_comes_true)
