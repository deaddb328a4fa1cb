"""A Ray cluster computes what local processes compute, to the bit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.engine import jobs
from steersman.studies import tune

from .ray_cluster import work

SCRIPT = FilePath(__file__).with_name("ray_cluster.py")
# Nodes have the loopback's address, whatever the machine's own; workers run at our priority.
SETTINGS = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_worker_niceness": "0",
}
# It takes a quarter of a minute; on a machine that is busy otherwise many times that.
LONGEST = 400.0


def found(out: FilePath) -> dict[str, Any]:
    """What the script prints."""
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(out)],
        env={**os.environ, **SETTINGS},
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return comparable(json.loads(done.stdout.splitlines()[-1]))


def comparable(result: dict[str, Any]) -> dict[str, Any]:
    """The same without times and the commit of a busy work tree."""
    other = ("control_time", "computing_time", "deadline_misses", "commit")
    rows = result["rows"]
    result["rows"] = [{k: v for k, v in r.items() if not k.startswith(other)} for r in rows]
    return result


@pytest.mark.skipif(find_spec("ray") is None, reason="needs the extra ray")
def test_two_nodes_bench_tune_train_and_end_as_this_machine_does(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = found(tmp_path / "there")
    assert there.pop("nodes") == 2
    assert there["failed"] == {}
    assert len(set(there["policies"])) == 2
    assert there["validated"] == [["0", 500], ["0", 600], ["1", 500], ["1", 600]]
    assert there.pop("interrupted") == {
        "ended": [True, True],
        "kept": ["0.0"],
        "again": ["0.1"],
        "found": {"0.0": {"slept": 0.0}, "0.1": {"slept": 0.1}},
    }
    monkeypatch.setattr(jobs, "_PIECE_JOBS", jobs._PIECE_JOBS)  # what the work sets
    monkeypatch.setattr(tune, "_PIECE_SIZE", tune._PIECE_SIZE)
    assert comparable(work(tmp_path / "here", "local")) == there
