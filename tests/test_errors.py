import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman import errors
from steersman.errors import ConfigError, SteersmanError, suggestion

NAMES = ["circle", "double_lane_change", "figure_eight", "straight"]


def test_an_error_says_where_then_what() -> None:
    assert str(ConfigError("is wrong", ("path", "radius"))) == "path.radius: is wrong"
    assert str(ConfigError("is wrong")) == "is wrong"


def test_a_config_error_survives_the_way_back_from_a_worker_process() -> None:
    error = pickle.loads(pickle.dumps(ConfigError("is wrong", ("path", "radius"))))
    assert str(error) == "path.radius: is wrong"
    assert error.where == ("path", "radius")


@pytest.mark.parametrize(
    "name", ["ConfigError", "DataError", "ControllerError", "TrainingDiverged"]
)
def test_one_except_clause_catches_every_error_meant_for_the_user(name: str) -> None:
    with pytest.raises(SteersmanError, match=r"^what it quotes$"):
        raise getattr(errors, name)("what\n it quotes\n")


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("circel", "; did you mean 'circle'?"),
        ("Figure-Eight", "; did you mean 'figure_eight'?"),
        ("q", "; allowed: circle, double_lane_change, figure_eight, straight"),
    ],
)
def test_suggestion(word: str, expected: str) -> None:
    assert suggestion(word, NAMES) == expected


def test_suggestion_among_nothing() -> None:
    assert suggestion("x", []) == "; there are none"


@given(st.sampled_from(NAMES), st.data())
def test_a_dropped_letter_is_found(name: str, data: st.DataObject) -> None:
    drop = data.draw(st.integers(0, len(name) - 1))
    assert suggestion(name[:drop] + name[drop + 1 :], NAMES) == f"; did you mean {name!r}?"
