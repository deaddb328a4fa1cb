"""Finding what is to be reported in folders."""

import json

import numpy as np
import pytest

from steersman.errors import DataError
from steersman.report import load_runs
from steersman.report.runs import read_progress, read_table
from steersman.report.tables import grid


def write(file, text):
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    return file


def test_a_drive(tmp_path, drive):
    folder = tmp_path / "pid_circle"
    drive().save(folder / "episode.npz")
    write(folder / "metrics.json", json.dumps({"mean_speed_m_s": 99.0, "own": 1}))
    write(folder / "config.yaml", "controller: {kind: pid}\n")
    (run,) = load_runs([folder])
    assert run.name == "pid_circle"
    assert len(run.episode) == 200
    # What was recorded counts; what was not is computed.
    assert (run.metrics["mean_speed_m_s"], run.metrics["own"]) == (99.0, 1)
    assert run.metrics["duration_s"] == pytest.approx(10.0)
    assert run.config == {"controller": {"kind": "pid"}}


def test_a_demonstration(tmp_path, drive):
    for name in ("circle/pid", "circle/mpc", "line"):
        drive(meta={"seed": 1}).save(tmp_path / "episodes" / f"{name}.npz")
    write(tmp_path / "training" / "progress.csv", "steps,reward_mean\n10,0.5\n")
    write(tmp_path / "training" / "policy.json", '{"inputs": 30}')
    write(tmp_path / "config.yaml", "steps: 10\n")
    write(tmp_path / "table.json", '[{"a": 1}]')
    write(tmp_path / "table_monza.json", '{"title": "Monza", "rows": []}')
    np.savez(tmp_path / "training" / "evaluations.npz", timesteps=np.arange(3))
    write(tmp_path / ".hidden" / "broken.npz", "")
    runs = load_runs([tmp_path])
    found = {run.name: run for run in runs}
    assert list(found) == ["circle/mpc", "circle/pid", "line", "table", "table_monza", "training"]
    assert found["line"].config == {"seed": 1}
    assert found["training"].config == {"policy": {"inputs": 30}, "config": {"steps": 10}}
    assert found["table_monza"].table.title == "Monza"


def test_several_folders_name_theirs(tmp_path, drive):
    for folder in ("a", "b"):
        drive().save(tmp_path / folder / "episode.npz")
        drive().save(tmp_path / folder / "episodes" / "pid.npz")
    runs = load_runs([tmp_path / "a", tmp_path / "b", tmp_path / "b"])
    assert [run.name for run in runs] == ["a", "a/pid", "b", "b/pid", "b (2)", "b/pid (2)"]


def test_a_file_and_metrics_alone(tmp_path, drive):
    drive().save(tmp_path / "one.npz")
    write(tmp_path / "m" / "metrics.json", '{"mean_speed_m_s": 3.0}')
    assert load_runs([tmp_path / "one.npz"])[0].name == "one"
    (run,) = load_runs([tmp_path / "m"])
    assert (run.episode, run.metrics) == (None, {"mean_speed_m_s": 3.0})


def test_a_missing_and_an_empty_folder(tmp_path):
    with pytest.raises(DataError, match="nowhere: no such folder"):
        load_runs([tmp_path / "nowhere"])
    with pytest.raises(DataError, match="nothing to report; expected"):
        load_runs([tmp_path])


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("one.npz", "no archive", r"one\.npz: not an \.npz archive"),
        ("metrics.json", "{", r"metrics\.json: not valid JSON"),
        ("metrics.json", "[]", "holds a list, expected an object"),
        ("progress.csv", "", "expected a first line of distinct column names"),
        ("progress.csv", "a,a\n1,2\n", "expected a first line of distinct"),
        ("progress.csv", "a,b\n1,2,3\n", "row 2 has 3 cells, expected 2"),
        ("progress.csv", "a,b\n1\n1,2\n", "row 2 has 1 cells, expected 2"),
        ("progress.csv", "a,b\n1,2\n1,x\n", "row 3: b is 'x', no number"),
        ("table.json", "3", "not a table"),
        ("table.json", "[1]", "not a table"),
        ("table.json", '{"rows": [{}], "columns": 3}', "'columns' must map"),
        ("table.json", '{"rows": [{}], "decimals": {"a": -1}}', "'decimals' must map"),
        ("table.json", "\xff", "not valid JSON"),
    ],
)
def test_a_corrupt_file_is_named(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content.encode("latin-1"))
    with pytest.raises(DataError, match=message) as error:
        load_runs([tmp_path])
    assert "\n" not in str(error.value)


def test_a_corrupt_configuration_is_named(tmp_path, drive):
    drive().save(tmp_path / "episode.npz")
    write(tmp_path / "config.yaml", "a: [")
    with pytest.raises(DataError, match=r"config\.yaml"):
        load_runs([tmp_path])


def test_progress_with_empty_cells_text_and_a_cut_last_line(tmp_path):
    file = write(tmp_path / "progress.csv", "steps,error_mm,phase,later\n1,,warm,\n2,3.5,main,\n3,")
    table = read_progress(file)
    assert list(table) == ["steps", "error_mm", "later"]
    np.testing.assert_array_equal(table["steps"], [1, 2, 3])
    np.testing.assert_array_equal(table["error_mm"], [np.nan, 3.5, np.nan])
    assert np.isnan(table["later"]).all()


@pytest.mark.parametrize(
    ("data", "title", "columns"),
    [
        ([{"a": 1}, {"b": 2, "a": 3}], "table", {"a": "a", "b": "b"}),
        ({"title": "T", "columns": ["b"], "rows": [{"a": 1}]}, "T", {"b": "b"}),
        ({"columns": {"a": "A [m]"}, "rows": [{"a": 1}]}, "table", {"a": "A [m]"}),
    ],
)
def test_forms_of_tables(tmp_path, data, title, columns):
    table = read_table(write(tmp_path / "table.json", json.dumps(data)))
    assert (table.title, table.headers) == (title, columns)


def test_decimals_of_a_table(tmp_path):
    data = {"rows": [{"a": 1e-9, "b": 3}, {"a": "none", "b": 4}], "decimals": {"a": 2}}
    table = grid(read_table(write(tmp_path / "table.json", json.dumps(data))))
    assert [[cell.text for cell in row] for row in table.rows] == [["0.00", "3"], ["none", "4"]]
    assert all(cell.number for cell in [*table.headers, *table.rows[1]])
