"""Comparisons asked for in Python: keywords, drives, and what is refused."""

from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import steersman as sm
from steersman.bench.suites import suite as read_suite
from steersman.studies.compare.contestants import Contestant
from steersman.studies.compare.scenarios import ComparedScenarios, compare_scenarios

from ..bench.test_summary import row


def rows_of(name: str, clean: float, beyond: float) -> Contestant:
    """A contestant that drove two scenarios within grip and one beyond it, on three roads."""
    wet = {"grip_share": 1.1, "completed": False, "end": "off_track"}
    rows = (
        row(name, "a", clean, grip_share=0.5),
        row(name, "b", 2 * clean, "soft", grip_share=0.7),
        row(name, "c", beyond, "ice", **wet),
    )
    return Contestant(name, "rows", name, rows=rows)


@pytest.fixture
def three(tmp_path: FilePath) -> ComparedScenarios:
    names = [("a", "clean"), ("b", "soft"), ("c", "ice")]
    some: Any = [SimpleNamespace(name="/".join(each)) for each in names]
    return ComparedScenarios("rows", read_suite("quick", ()), (0,), tuple(some))


def test_a_comparison_counts_what_the_benchmark_counts(
    three: ComparedScenarios, tmp_path: FilePath
) -> None:
    """One drive that all lose for want of grip decides no figure of either."""
    found = [rows_of("one", 0.1, 1.5), rows_of("other", 0.05, 1.4)]
    result, _ = compare_scenarios(found, three, tmp_path)
    (pairs,) = result.comparisons
    assert (pairs.scenarios, pairs.better, set(pairs.by_path)) == (2, 2, {"a", "b"})
    for figure, group in (("rms_m", "all"), ("rms_disturbed_m", "disturbed")):
        summed = {name: one.errors(group) for name, one in result.summary.controllers.items()}
        assert pairs.figures[figure].base == pytest.approx(summed["one"].rms_m.value)
        assert pairs.figures[figure].own == pytest.approx(summed["other"].rms_m.value)
        assert pairs.figures[figure].ratio.value == pytest.approx(0.5)
    assert pairs.figures["ended_early"].base == 0.0
    assert [line for line in result.warnings if "1 scenario beyond grip" in line]
    assert result.summary.controllers["one"].beyond is not None


def driven(controller: str, path: str = "circle") -> sm.Episode:
    return sm.drive(controller, path=path, duration=4)


def test_the_line_of_a_comparison_of_drives_has_the_ratio() -> None:
    found = sm.compare("tuned/lqr", "pid", path="circle", duration=4)
    table = found.to_pandas().set_index("figure")
    ratio = table.loc["rms_lateral_error_m", "ratio.value"]
    assert str(found).endswith(f"that of lqr: pid {ratio:.3g}")
    (axes,) = found.plot("ratio_B").axes
    assert "RMS error" in [label.get_text() for label in axes.get_yticklabels()]


def test_without_a_common_path_there_is_no_figure() -> None:
    found = sm.compare(driven("pid"), driven("tuned/lqr", "figure_eight"))
    with pytest.raises(sm.ConfigError, match="plot: this result has no figure"):
        found.plot()


@pytest.mark.parametrize(
    "path",
    ["circle", {"kind": "circle"}, sm.make("path", "circle")],
    ids=["word", "fields", "made"],
)
def test_settings_as_keywords_are_those_of_the_words(path: object) -> None:
    told = sm.compare("tuned/lqr", "pid", "path=circle", "duration=3", "path.radius=40")
    asked = sm.compare("tuned/lqr", "pid", "path.radius=40", path=path, duration=3)
    assert asked.table() == told.table()


def test_an_assignment_counts_last() -> None:
    asked = sm.compare("tuned/lqr", "pid", "duration=3", path="circle", duration=5)
    assert asked.table() == sm.compare("tuned/lqr", "pid", "path=circle", "duration=3").table()


def test_drives_in_hand_are_compared() -> None:
    found = sm.compare(driven("tuned/lqr"), driven("pid"), "tuned/stanley")
    assert [one.name for one in found.contestants] == ["lqr", "pid", "stanley"]
    assert [one.sort for one in found.contestants] == ["drive", "drive", "controller"]


@pytest.mark.parametrize(
    ("given", "settings", "told"),
    [
        (("pid", 3), {}, "cannot compare an object of type int; allowed: words, .*Episode"),
        (("pid", np.zeros(3)), {}, "an object of type ndarray; allowed"),
        (("pid", "tuned/lqr"), {"pth": "circle"}, "unknown setting 'pth'; did you mean 'path'"),
        (("pid", "tuned/lqr"), {"path": object()}, "path: a value of type object is not allowed"),
    ],
)
def test_what_is_not_allowed_is_named(
    given: tuple[Any, ...], settings: dict[str, Any], told: str
) -> None:
    with pytest.raises(sm.ConfigError, match=told):
        sm.compare(*given, **settings)


def test_one_drive_is_too_few() -> None:
    with pytest.raises(sm.ConfigError, match="two are needed to compare; given one drive"):
        sm.compare(driven("pid"))
