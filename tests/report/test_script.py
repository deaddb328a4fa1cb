"""Parts of the pages' script against what they stand for, in a browser."""

import math

import numpy as np
import pytest

from steersman.report.pack import Blob
from steersman.report.web import resource


def test_the_script_decodes_what_was_packed(browser):
    rng = np.random.default_rng(3)
    blob, columns = Blob(), []
    for values, step in (
        (rng.normal(0.0, 1e3, 500), 1e-3),
        (np.array([1e9, -1e9, np.nan, 0.0]), 1.0),
        (np.cumsum(rng.integers(-3, 4, 300)), 1.0),
    ):
        columns.append((values, blob.add(values, step)))
    page = browser.new_page()
    code = f"""(letters) => {{ document.body.innerHTML = '<p id="x"></p>';
      document.getElementById("x").textContent = letters;
      {resource("unpack.js")}
      return unpacked("x").then((bytes) => {[entry for _, entry in columns]}.map(
        (entry) => [...new Columns(bytes).read(entry)].map((v) => Number.isNaN(v) ? null : v)));
    }}"""
    got = page.evaluate(code, blob.packed())
    page.close()
    for found, (values, entry) in zip(got, columns, strict=True):
        assert [v is None for v in found] == np.isnan(values).tolist()
        known = np.array([math.nan if v is None else v for v in found])
        assert known == pytest.approx(values, abs=0.501 * entry["q"], nan_ok=True)


def test_front_wheels_turn_about_one_point(browser):
    page = browser.new_page()
    car = {"lf": 1.2, "lr": 1.8, "track": 1.6, "ackermann": True}
    for angle in (0.5, -0.3, 0.01):
        code = f"([car, angle]) => {{ {resource('car.js')} return frontWheels(car, angle); }}"
        left, right = page.evaluate(code, [car, angle])
        assert 1 / math.tan(right) - 1 / math.tan(left) == pytest.approx(1.6 / 3.0)
        assert 1 / math.tan(right) + 1 / math.tan(left) == pytest.approx(2 / math.tan(angle))
        parallel = page.evaluate(code, [{**car, "ackermann": False}, angle])
        assert parallel == [angle, angle]
    page.close()
