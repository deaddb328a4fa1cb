"""Bench, tune, train and Ctrl-C on a Ray cluster of two nodes on this machine.

Prints what came of it as JSON. A script of its own: what it starts has to be gone when it ends,
whatever happens in between.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

_NODE: dict[str, Any] = {"num_cpus": 1, "object_store_memory": 80_000_000}
RUN = {"path": {"kind": "circle", "radius": 40.0}, "duration": 3.0}


def work(out: Path, engine: str) -> dict[str, Any]:
    """Rows, tuned values, and digests of two policies."""
    from steersman.bench import suites
    from steersman.bench.entrants import entrants
    from steersman.bench.runner import bench
    from steersman.config import build
    from steersman.engine import jobs
    from steersman.learning.config import TrainConfig
    from steersman.learning.parallel import TrainingJob, train_all
    from steersman.studies import tune

    jobs._PIECE_JOBS = 1  # so that both nodes have something to do
    tune._PIECE_SIZE = 1.0
    scenarios = suites.quick().scenarios((3,))[:3]
    at_once = 2 if engine == "ray" else 1
    rows = bench(scenarios, entrants(["pid"]), out / "bench", engine=engine, jobs=at_once)
    study = build(
        tune.TuneConfig, {"controller": "pid", "suite": [RUN, RUN | {"seed": 1}], "trials": 2}
    )
    best = tune.tune(study, out / "tune", engine=engine, jobs=at_once)
    tree = json.loads((Path(__file__).parent / "tiny.json").read_text())
    configs = [build(TrainConfig, tree | {"seed": seed}) for seed in (0, 1)]
    trainings = [TrainingJob(str(c.seed), c, out / f"seed_{c.seed}") for c in configs]
    events: list[Any] = []
    failed = train_all(trainings, 2, events.append, engine=engine)
    policies = [
        hashlib.sha256(each.out.joinpath("policy.onnx").read_bytes()).hexdigest()
        for each in trainings
        if not failed
    ]
    return {
        "rows": [row.plain() for row in rows],
        "tuned": best.controller.model_dump(),
        "failed": failed,
        "policies": policies,
        "validated": sorted([e.job.name, e.steps] for e in events if e.row is not None),
    }


def interrupted(out: Path) -> dict[str, Any]:
    """Ctrl-C while one job is finished and two are running, and the same call once more."""
    from steersman.engine.jobs import Workers
    from steersman.engine.journal import Journal, LineFormat
    from steersman.engine.work import Job

    def last(seconds: float, tell: Any) -> dict[str, Any]:
        tell(os.getpid())
        time.sleep(seconds)
        return {"slept": seconds}

    lines = LineFormat("a sleep", json.loads, dict, lambda row: str(row["slept"]))
    file = out / "sleeps.jsonl"
    running: dict[str, int] = {}

    def press_when_two_sleep(key: str, process: int) -> None:
        running[key] = process
        if len(running) == 3:
            signal.raise_signal(signal.SIGINT)

    def run(seconds: tuple[float, ...], listener: Any) -> dict[str, Any]:
        jobs = [Job(str(each), each) for each in seconds]
        with Workers("ray", 2) as workers:
            return workers.run(
                last, jobs, journal=Journal(file, lines), listener=listener, piece_size=1.0
            )

    try:
        run((0.0, 600.0, 601.0), press_when_two_sleep)
    except KeyboardInterrupt:
        sleepers = [process for key, process in running.items() if key != "0.0"]
        ended = [gone(process) for process in sleepers]
    else:
        ended = []
    kept, asked = sorted(Journal(file, lines).results), list[str]()
    found = run((0.0, 0.1), lambda key, _: asked.append(key))
    return {"ended": ended, "kept": kept, "again": asked, "found": found}


def gone(process: int) -> bool:
    """Whether a process ends within seconds."""
    late = time.monotonic() + 20.0
    while Path(f"/proc/{process}").exists():
        if time.monotonic() > late:
            return False
        time.sleep(0.05)
    return True


def main(out: Path) -> None:
    """The work, on a cluster of two nodes of one core each."""
    import ray
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={**_NODE, "include_dashboard": False})
    try:
        cluster.add_node(**_NODE)
        os.environ["RAY_ADDRESS"] = cluster.address
        ray.init(log_to_driver=False, configure_logging=False)
        cluster.wait_for_nodes()
        nodes = sum(node["Alive"] for node in ray.nodes())
        found = {**work(out, "ray"), "interrupted": interrupted(out)}
        print(json.dumps({"nodes": nodes, **found}))  # noqa: T201 - it is a script
    finally:
        ray.shutdown()
        cluster.shutdown()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
