"""What a failed run is charged: never less than it would have had by driving on well."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.bench.drive import charged_mean, charged_quantile, charged_rms, driven_share
from steersman.controllers.pid import Pid, PidGains
from steersman.paths.analytic import Circle, Straight
from steersman.rollout import RunConfig, run
from steersman.speed import ConstantSpeed

CORRIDOR = 1.5
errors = st.lists(st.floats(-1.4, 1.4), min_size=1, max_size=50).map(np.array)
shares = st.floats(0.01, 1.0)


@given(errors, shares)
def test_a_charge_is_what_driving_on_at_the_corridor_would_have_cost(
    driven: np.ndarray, share: float
) -> None:
    """The driven errors and the corridor's edge, weighted by their shares of the plan."""
    weight = np.concatenate([np.full(driven.size, share / driven.size), [1.0 - share]])
    size = np.append(np.abs(driven), CORRIDOR)
    assert charged_mean(driven, share, CORRIDOR) == pytest.approx(float(weight @ size))
    rms = float(np.sqrt(weight @ size**2))
    assert charged_rms(driven, share, CORRIDOR) == pytest.approx(rms)
    assert charged_quantile(driven, share, CORRIDOR, 0.95) <= CORRIDOR


@given(errors, shares, shares)
def test_failing_earlier_never_costs_less(driven: np.ndarray, one: float, two: float) -> None:
    early, late = sorted((one, two))
    for charge in (charged_mean, charged_rms):
        assert charge(driven, early, CORRIDOR) >= charge(driven, late, CORRIDOR) - 1e-12
    assert charged_quantile(driven, early, CORRIDOR, 0.95) >= (
        charged_quantile(driven, late, CORRIDOR, 0.95) - 1e-12
    )


def test_a_completed_run_is_charged_nothing() -> None:
    driven = np.array([0.1, -0.2, 0.3])
    assert charged_rms(driven, 1.0, CORRIDOR) == pytest.approx(np.sqrt(np.mean(driven**2)))
    assert charged_quantile(driven, 1.0, CORRIDOR, 0.5) == pytest.approx(0.2)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_error_that_is_no_number_counts_as_the_corridor(bad: float) -> None:
    assert charged_rms(np.array([bad]), 1.0, CORRIDOR) == CORRIDOR
    assert charged_rms(np.array([]), 0.5, CORRIDOR) == CORRIDOR


def test_the_share_is_that_of_the_plan() -> None:
    idle = Pid(gains=PidGains(k_p=0.0, k_i=0.0, k_d=0.0))
    speed = ConstantSpeed(speed=10.0)
    # Straight on where the road turns: out of the corridor after about sqrt(2 R c) metres.
    off = RunConfig(controller=idle, path=Circle(radius=200.0), speed=speed, duration=20.0)
    episode = run(off)
    assert not episode.completed
    assert driven_share(off, episode) == pytest.approx(len(episode) * 0.05 / 20.0)
    lap = off.model_copy(update={"duration": None, "laps": 1.0})
    assert driven_share(lap, run(lap)) == pytest.approx(episode.distance / lap.path.length)
    done = RunConfig(controller=idle, path=Straight(distance=30.0), speed=speed)
    assert driven_share(done, run(done)) == 1.0
