"""A Ray cluster computes what this machine computes, to the bit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.bench import suites
from steersman.bench.entrants import entrants
from steersman.bench.results import BenchRow
from steersman.bench.runner import bench

SCRIPT = FilePath(__file__).with_name("ray_cluster.py")
# Nodes have the loopback's address, whatever the machine's own; workers run at our priority.
SETTINGS = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_worker_niceness": "0",
}
# It takes a quarter of a minute; on a machine that is busy otherwise many times that.
LONGEST = 400.0


def untimed(rows: list[BenchRow]) -> list[dict[str, Any]]:
    other = ("control_time", "computing_time", "deadline_misses", "commit")
    return [{k: v for k, v in row.plain().items() if not k.startswith(other)} for row in rows]


@pytest.mark.skipif(find_spec("ray") is None, reason="needs the extra ray")
def test_two_nodes_drive_what_one_process_drives(tmp_path: FilePath) -> None:
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(tmp_path / "there")],
        env={**os.environ, **SETTINGS},
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=True,
    )
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["nodes"] == 2
    here = bench(suites.quick().scenarios((3,))[:3], entrants(["pid"]), tmp_path / "here", jobs=1)
    assert untimed([BenchRow.model_validate(row) for row in found["rows"]]) == untimed(here)
