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

SCRIPT = FilePath(__file__).with_name("ray_cluster.py")
# Nodes have the loopback's address, whatever the machine's own; workers run at our priority.
SETTINGS = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_worker_niceness": "0",
}
# It takes a quarter of a minute; on a machine that is busy otherwise many times that.
LONGEST = 400.0


def found(engine: str, out: FilePath) -> dict[str, Any]:
    """What the script prints, without times and the commit of a busy work tree."""
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(out), engine],
        env={**os.environ, **SETTINGS},
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    other = ("control_time", "computing_time", "deadline_misses", "commit")
    rows = result["rows"]
    result["rows"] = [{k: v for k, v in r.items() if not k.startswith(other)} for r in rows]
    return result


@pytest.mark.skipif(find_spec("ray") is None, reason="needs the extra ray")
def test_two_nodes_bench_tune_train_and_end_as_this_machine_does(tmp_path: FilePath) -> None:
    there = found("ray", tmp_path / "there")
    assert there.pop("nodes") == 2
    assert there["failed"] == {}
    assert len(set(there["policies"])) == 2
    assert there["validated"] == [["0", 500], ["0", 600], ["1", 500], ["1", 600]]
    assert there["interrupted"] == {
        "ended": [True, True],
        "kept": ["0.0"],
        "again": ["0.1"],
        "found": {"0.0": {"slept": 0.0}, "0.1": {"slept": 0.1}},
    }
    assert there == found("local", tmp_path / "here")
