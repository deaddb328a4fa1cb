"""Drive three scenarios on a Ray cluster of two nodes on this machine; prints the rows as JSON.

A script of its own: what it starts has to be gone when it ends, whatever happens in between.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

_NODE: dict[str, Any] = {"num_cpus": 1, "object_store_memory": 80_000_000}


def main(out: str) -> None:
    """Two nodes of one core each, then the benchmark as anybody calls it."""
    import ray
    from ray.cluster_utils import Cluster

    from steersman.bench import runner, suites
    from steersman.bench.entrants import entrants

    runner._CHUNK_RUNS = 1  # so that both nodes have something to do
    cluster = Cluster(initialize_head=True, head_node_args={**_NODE, "include_dashboard": False})
    try:
        cluster.add_node(**_NODE)
        ray.init(address=cluster.address, log_to_driver=False)
        cluster.wait_for_nodes()
        scenarios = suites.quick().scenarios((3,))[:3]
        rows = runner.bench(scenarios, entrants(["pid"]), Path(out), engine="ray")
        alive = sum(node["Alive"] for node in ray.nodes())
        print(json.dumps({"nodes": alive, "rows": [row.plain() for row in rows]}))  # noqa: T201 - it is a script
    finally:
        ray.shutdown()
        cluster.shutdown()


if __name__ == "__main__":
    main(sys.argv[1])
