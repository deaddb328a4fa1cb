"""What an exported controller costs on a Cortex-M4F stands in its card; what is absent is told."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.delivery import measuring
from steersman.delivery.controller_package import write_controller
from steersman.delivery.measuring import cortex_m4, missing, programs_of
from steersman.errors import DataError

from ..scripts import script

bench = script("benchmarks/controllers_in_c.py")
needs_processor = pytest.mark.skipif(
    bool(missing()), reason="no arm-none-eabi-gcc, no qemu-system-arm"
)


@needs_processor
@pytest.mark.parametrize("precision", ["double", "single", "mixed"])
def test_costs_stand_in_the_card(tmp_path: FilePath, precision: str) -> None:
    said: list[str] = []
    setting = bench.setting_of("tuned/stanley", precision)
    write_controller(setting, tmp_path, said.append, measure=True)
    card = json.loads((tmp_path / "stanley.json").read_text())
    costs = card["cortex_m4"]
    assert costs["other_statuses"] == 0
    assert costs["steering_e9"] <= (0 if precision == "double" else 200)
    assert 100 < costs["rom"] < 20_000
    assert 0 < costs["ram"] < costs["stack"] < 5_000
    assert 100 < costs["instructions"] < 100_000
    assert "programs_in_benchmark" not in card
    assert any(f"ROM {costs['rom']} B" in each for each in said)


def test_absent_programs_are_told(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(measuring, "EMULATOR", "no-such-emulator")
    write_controller(bench.setting_of("tuned/stanley"), tmp_path, said.append, measure=True)
    assert "cortex_m4" not in json.loads((tmp_path / "stanley.json").read_text())
    assert any("not measured on a Cortex-M4F" in s and "no-such-emulator" in s for s in said)


@needs_processor
def test_what_does_not_compile_is_told_in_a_line(tmp_path: FilePath) -> None:
    setting = bench.setting_of("tuned/stanley")
    write_controller(setting, tmp_path)
    (tmp_path / f"{setting.prefix}.c").write_text("no C\n", encoding="ascii")
    with pytest.raises(DataError, match="arm-none-eabi-gcc") as caught:
        cortex_m4(setting, tmp_path)
    assert "\n" not in str(caught.value)


def test_programs_are_counted_over_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measuring, "SUITE", "quick")
    counts: dict[str, Any] = programs_of(bench.setting_of("tuned/mpc"), sample=1)
    assert counts["drives"] == 5
    assert counts["programs"] > 100
    assert counts["unsolved"] == 0
    assert 0 <= counts["largest"] < 200
