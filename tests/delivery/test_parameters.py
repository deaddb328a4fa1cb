"""A parameter in C, changed there, does what an export with that setting does."""

from __future__ import annotations

import re
from functools import cache, reduce
from pathlib import Path as FilePath

import pytest

from steersman import tuned
from steersman.cli.exported import ToExport, setting_of
from steersman.delivery import controller_text as text
from steersman.delivery.controller import DESIGN, Translated, translated
from steersman.delivery.controller_package import check_values
from steersman.delivery.design_settings import DesignSettings, other_values, replaced
from steersman.delivery.parameter_limits import limits
from steersman.delivery.parameter_table import entries, table_text
from steersman.errors import ConfigError, DataError
from steersman.estimators.kalman import Kalman

SMALL = (
    "controller.horizon=3",
    "controller.estimate_friction=false",
    "controller.delay=0.1",
)
WORDS: dict[str, tuple[str, ...]] = {
    "tuned/bearing_pid": (),
    "tuned/lqr": (),
    "tuned/mpc": ("controller.horizon=3",),
    "tuned/mpc_delay": SMALL,
    "tuned/mpc_pid": ("controller.horizon=3",),
    "tuned/mpc_pid_scheduled": ("controller.horizon=3",),
    "tuned/nmpc": SMALL,
    "tuned/pid": (),
    "tuned/pid_feedforward": (),
    "tuned/pure_pursuit": (),
    "tuned/pure_pursuit_cm": (),
    "tuned/sliding_mode": (),
    "tuned/stanley": (),
    "tuned/stanley_cm": (),
    "joint_nmpc": (*SMALL, "speed=constant_speed"),
    "grip_speed": ("controller.inner=tuned/stanley", "speed=constant_speed"),
}


@cache
def exported(word: str) -> Translated:
    return translated(setting_of(ToExport(word, WORDS[word])))


def test_every_tuned_controller_is_there() -> None:
    assert set(tuned.names()) <= set(WORDS)


@pytest.mark.parametrize("word", WORDS)
def test_all_settings_of_the_table_changed_leave_the_program(word: str) -> None:
    made = exported(word)
    setting, controller = made.setting, made.setting.controller
    paths = [each.path for each in made.parameters if not each.path.startswith(DESIGN)]
    for path in paths:
        controller = replaced(controller, path.split("."), other_values(controller, path)[0])
    again = translated(setting._replace(controller=controller))
    was, now = entries(made), entries(again)
    assert [(each.name, each.limits) for each in was] == [(each.name, each.limits) for each in now]
    changed = {one.name for one, other in zip(was, now, strict=True) if one.value != other.value}
    assert changed == set(paths)  # the design is what it was
    sources = [re.sub(r"_defaults = \{.*?\n\};", "", text.source(each), flags=re.DOTALL)
               for each in (made, again)]  # fmt: skip
    assert sources[0] == sources[1]
    assert text.header(made) == text.header(again)


@pytest.mark.parametrize("word", tuned.names())
def test_what_a_search_may_choose_leaves_as_c(word: str) -> None:
    """All settings at the lower and at the upper ends of the search, and each switch turned."""
    setting = exported(word).setting
    controller = setting.controller
    choices = [controller, controller]
    for name, ends in controller.search.items():
        choices = [
            replaced(each, name.split("."), end)
            for each, end in zip(choices, ends[:2], strict=True)
        ]
    switches = [name for name, value in controller if isinstance(value, bool)]
    choices += [replaced(controller, [name], not getattr(controller, name)) for name in switches]
    for chosen in choices:
        table = entries(translated(setting._replace(controller=chosen)))
        found = {one.name: one.value for one in table if one.name in controller.search}
        assert found == {name: reduce(getattr, name.split("."), chosen) for name in found}


def test_what_a_design_is_made_of_is_constant() -> None:
    made = exported("tuned/mpc_delay")
    setting = made.setting
    assert {"q_lateral", "r", "r_change"} <= set(made.design_settings) <= made.program.pinned
    assert table_text(made).splitlines()[1:] == [
        "0,disturbance_time,s,>0.0,,"
        f"{setting.controller.disturbance_time!r},"  # type: ignore[attr-defined]
        "Time constant of the estimate of accelerations missing in the model."
    ]


def test_a_setting_without_a_solution_acts_on_the_design() -> None:
    setting = setting_of(ToExport("lqr"))
    design = DesignSettings(setting.controller, setting.vehicle, setting.dt)
    assert design.acts("r")
    assert not design.acts("preview_time")


def test_the_settings_of_an_estimator_have_names_and_limits_and_keep_to_them() -> None:
    made = translated(setting_of(ToExport("estimated/tuned/lqr")))
    rows = {name: each for each in entries(made) for name in [each.meaning.partition(":")[0]]}
    for name, field in Kalman.model_fields.items():
        assert (rows[name].minimum, rows[name].maximum) == limits(field)
    for name, below in (("curvature_change", 0.0), ("v_y_bias", -1.0)):
        row = rows[name]
        values = {row.name: below}
        with pytest.raises(DataError, match=rf"settings.*: {below:g} is not allowed; must be >"):
            check_values(made._replace(setting=made.setting._replace(values=values)))


def test_what_a_table_may_not_hold_is_named_by_its_row(tmp_path: FilePath) -> None:
    file = tmp_path / "changed.csv"
    file.write_text("name,value\ncontroller.q_lateral,-1\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"changed\.csv: controller\.q_lateral: -1.* not allowed"):
        setting_of(ToExport("estimated/tuned/lqr", parameters=file))
    with pytest.raises(DataError, match=r"none\.csv: cannot be read \(No such file"):
        setting_of(ToExport("estimated/tuned/lqr", parameters=tmp_path / "none.csv"))
