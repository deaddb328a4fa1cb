"""docs/metrics.md has every metric of a drive, with the declared unit."""

from __future__ import annotations

import re

from steersman.bench.disturbance import Disturbance
from steersman.metrics.base import metrics

from .pages import ROOT

ROW = re.compile(r"^\| (`[^|]*`) \|.*\| ([^|]*) \|$", re.MULTILINE)
PAGE = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
SIGNS = {"yes/no": "-", "steps": "-", "times": "-"}


def written() -> dict[str, str]:
    """Units by name, from the page's tables."""
    return {
        name: unit.replace("²", "^2").replace("³", "^3")
        for names, unit in ROW.findall(PAGE)
        for name in re.findall(r"`([^`]*)`", names)
    }


def test_the_page_has_every_metric_with_its_unit() -> None:
    units = {name: SIGNS.get(unit, unit) for name, unit in written().items()}
    timed = {name: "us" for name in metrics() if name.startswith("control_time_us")}
    assert all(
        f"`{name.removeprefix('control_time_us')}`" in PAGE for name in timed if "p50" not in name
    )
    ours = {n: m.unit for n, m in metrics().items() if m.__module__.startswith("steersman.")}
    assert {**units, **timed} == {**ours, "end": "text"}


def test_the_benchmark_page_has_every_field_of_a_disturbance() -> None:
    page = (ROOT / "docs" / "bench.md").read_text(encoding="utf-8")
    for name, field in Disturbance.model_fields.items():
        unit = field.json_schema_extra["unit"].removesuffix("-")  # type: ignore[index,union-attr]
        assert f"| `{name}` | {unit} | {field.description} |" in page
