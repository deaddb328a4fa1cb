"""Results show themselves: a line, a page, figures, tables and files."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import steersman as sm
from steersman.episode import COLUMNS, Episode, load_episode
from steersman.learning.progress import LearningResult, TrainRow
from steersman.learning.seeds import TrainedSeeds
from steersman.logs.restore import read_episode
from steersman.metrics.base import summarise
from steersman.policy_file import PolicyCard
from steersman.shown import Shown
from steersman.studies.compare.results import ScenarioCompareResult
from steersman.studies.findings import FalsifyResult
from steersman.studies.search import SearchResult
from steersman.table_file import columns_of, write_columns

RESULTS = Path(__file__).parents[1] / "results"


@pytest.fixture(scope="module")
def episode() -> Episode:
    return sm.drive("tuned/stanley", path="figure_eight", duration=3)


def training(folder: str) -> LearningResult:
    rows = tuple(
        TrainRow(steps=1e3 * k, validation_error_mm=90.0 / k, reward_mean=0.1 * k)
        for k in (1, 2, 3)
    )
    card = PolicyCard.model_construct(training={"validation": {"total": 0.03}})
    return LearningResult(Path(folder), None, rows, rows[-1], Path("policy.onnx"), card)


def falsified() -> FalsifyResult:
    rows = [
        {"stage": "one", "point": {"mass": x}, "norm": x, "failed": x > 0.5, "end": "off_track",
         "max_error_m": 0.1 + x, "seconds": 3.0}
        for x in (0.0, 0.4, 0.8)
    ]  # fmt: skip
    config = {"controller": {"kind": "pid"}, "ranges": dict.fromkeys(
        ("mass", "friction", "delay", "waypoint_noise", "speed"), 0.3)}  # fmt: skip
    return FalsifyResult(
        falsified=True, nominal_failed=False, safe_radius=0.8, tried_within=2, singles=[],
        failures=1, simulated_seconds=9.0, ends={"off_track": 1}, drives=rows, config=config,
        plant="", mildest=rows[2] | {"values": {"mass": 1.2}},
    )  # fmt: skip


def searched() -> SearchResult:
    trials = [
        {"number": k, "state": "finished", "settings": {"agent.gamma": str(g)}, "score_m": s,
         "steps": 100, "scores_m": [s]}
        for k, (g, s) in enumerate([(0.9, 0.02), (0.95, 0.01), (0.99, None)])
    ]  # fmt: skip
    return SearchResult(best=trials[1], trials=trials, seeds=[0], rungs=[], ranges={}, pressed=[])


ALL = {
    "episode": lambda: sm.drive("tuned/lqr", path="circle", duration=1),
    "tune": lambda: sm.load(RESULTS / "tune" / "lqr" / "result.json"),
    "bench": lambda: sm.load(RESULTS / "faults" / "results.json"),
    "compare": lambda: ScenarioCompareResult.read(RESULTS / "compare" / "core.json"),
    "drives": lambda: sm.compare("tuned/lqr", "pid", path="circle", duration=4),
    "falsify": falsified,
    "search": searched,
    "train": lambda: training("runs/agent"),
    "seeds": lambda: TrainedSeeds({k: training(f"runs/five/seed_{k}") for k in (0, 1)}, {}),
}


@pytest.mark.parametrize("name", ALL)
def test_every_result_shows_itself(name, tmp_path):
    result = ALL[name]()
    assert isinstance(result, Shown)
    assert repr(result) == str(result)
    assert len(repr(result)) < 300
    assert "\n" not in repr(result)
    html = result._repr_html_()
    assert html.startswith("<iframe")
    assert "http" not in html.replace("http://www.w3.org", "").replace("http-equiv", "")
    drawn = result.plot()
    assert drawn.axes
    assert all(axes.lines or axes.collections for axes in drawn.axes)
    assert result._repr_html_() == html
    frame, table = result.to_pandas(), result.table()
    assert list(frame.columns) == list(table)
    assert len(frame) == len(next(iter(table.values()))) > 0
    result.save(tmp_path / "x.csv")
    with (tmp_path / "x.csv").open() as stream:
        header, *rows = csv.reader(stream)
    assert (header, len(rows)) == (list(table), len(frame))


def test_an_episode_in_every_format(episode, tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    parquet = pytest.importorskip("pyarrow.parquet")
    for suffix in ("csv", "mat", "parquet", "mcap", "npz"):
        episode.save(str(tmp_path / f"x.{suffix}"))
    table = parquet.read_table(tmp_path / "x.parquet")
    matlab = scipy_io.loadmat(tmp_path / "x.mat")
    with (tmp_path / "x.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    for name, values in episode.columns.items():
        assert [float(row[name]) for row in rows] == values.tolist()
        assert table[name].to_pylist() == values.tolist()
        assert table.schema.field(name).metadata == {b"unit": COLUMNS[name].encode()}
        assert matlab[name][:, 0].tolist() == values.tolist()
        assert matlab["units"][0, 0][name][0] == COLUMNS[name]
        assert load_episode(tmp_path / "x.npz")[name].tolist() == values.tolist()
        assert read_episode(tmp_path / "x.mcap")[name] == pytest.approx(values, abs=1e-8)


def test_a_recording_is_loaded(episode, tmp_path):
    episode.save(tmp_path / "x.mcap")
    found = sm.load(tmp_path / "x.mcap")
    assert isinstance(found, Episode)
    assert found["lateral_error"].tolist() == episode["lateral_error"].tolist()


def test_a_gif_is_in_real_time_with_ten_pictures_a_second(episode, tmp_path):
    pytest.importorskip("pygame")
    image = pytest.importorskip("PIL.Image")
    episode.save(tmp_path / "x.gif")
    with image.open(tmp_path / "x.gif") as film:
        shown = film.n_frames * film.info["duration"] / 1e3
        assert film.info["duration"] == 100
        assert shown == pytest.approx(len(episode) * episode.dt, abs=0.1)


def test_an_unknown_column_is_answered_with_the_nearest(episode):
    with pytest.raises(sm.ConfigError, match="no column 'lateral_eror'; did you mean 'lateral_e"):
        _ = episode["lateral_eror"]


def test_figures_have_the_names_of_columns(episode):
    lines = [axes.lines[0] for axes in episode.plot("curvature", "lateral_error").axes]
    assert lines[0].get_ydata() == pytest.approx(episode["curvature"])
    assert lines[1].get_ydata() == pytest.approx(1e3 * episode["lateral_error"])
    with pytest.raises(sm.ConfigError, match="did you mean 'curvature'"):
        episode.plot("curvatur")
    assert episode.plot()._repr_png_().startswith(b"\x89PNG")


def test_the_metrics_of_an_episode(episode):
    found = summarise(episode)
    assert episode.metrics.end == found.pop("end")
    assert episode.metrics.steady == found.pop("steady")
    assert dict(episode.metrics) == found
    assert episode.metrics.rms_lateral_error_m == found["rms_lateral_error_m"]
    assert "RMS of the lateral error" in repr(episode.metrics)
    assert "steer_std" in dir(episode.metrics)
    with pytest.raises(AttributeError, match="did you mean 'steer_std'"):
        _ = episode.metrics.steer_sdt


def test_other_endings_are_refused(episode, tmp_path):
    with pytest.raises(sm.DataError, match=r"'\.xlsx' is no ending .*\.csv, \.gif, \.mat, \.mcap"):
        episode.save(tmp_path / "x.xlsx")
    assert not list(tmp_path.iterdir())


def test_a_tuning_keeps_its_trials_out_of_its_file(tmp_path):
    result = ALL["tune"]()
    result.save(tmp_path / "result.json")
    assert "history" not in json.loads((tmp_path / "result.json").read_text())
    assert result.history is not None
    assert len(result.table()["cost_m"]) == result.trials
    assert sm.load(tmp_path / "result.json").history is None


def test_missing_cells_and_words(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    rows = [{"a": 1, "b": {"c": "x"}}, {"a": None, "d": 2.0}]
    for suffix in ("csv", "mat", "parquet"):
        write_columns(tmp_path / f"x.{suffix}", columns_of(rows))
    assert (tmp_path / "x.csv").read_text() == "a,b.c,d\n1,x,\n,,2.0\n"
    found = scipy_io.loadmat(tmp_path / "x.mat", chars_as_strings=True)
    assert np.isnan(found["a"][1, 0])
    assert found["b_c"][0, 0][0] == "x"
