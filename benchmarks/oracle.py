r"""The oracle's costs of a suite's scenarios, as the package has them.

    python benchmarks/oracle.py --suite standard --sample 4 --out src/steersman/data/oracle.json

Scenarios that the file knows are not optimised again, so it goes on where it stopped, and takes
others in. Those that no longer exist go with ``--anew``.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from steersman.bench.entrants import entrant
from steersman.bench.oracle import OracleCosts, oracle, short
from steersman.bench.suites import suite
from steersman.errors import DataError
from steersman.provenance import provenance

# Seconds between two times that the file is written.
_OFTEN = 20.0


def main() -> None:
    """Optimise what is missing."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--suite", default="standard")
    parser.add_argument("--sample", type=int, help="so many scenarios of each disturbance")
    parser.add_argument("--anew", action="store_true", help="begin with nothing")
    parser.add_argument("--start", default="tuned/lqr", help="controller of the first drives")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    start = entrant(given.start).controller
    try:
        costs = {} if given.anew else dict(OracleCosts.read(given.out).costs)
    except DataError:
        costs = {}
    chosen = suite(given.suite).model_copy(update={"sample": given.sample})
    scenarios = {short(each): each for each in chosen.scenarios()}
    written = time.monotonic()
    for count, (key, each) in enumerate(scenarios.items(), start=1):
        if key not in costs:
            costs[key] = oracle(each, start)
            print(count, len(scenarios), each.name, costs[key], file=sys.stderr, flush=True)  # noqa: T201
        if count == len(scenarios) or time.monotonic() - written > _OFTEN:
            kept = OracleCosts(start=given.start, costs=costs, **provenance())
            kept.write(given.out)
            written = time.monotonic()


if __name__ == "__main__":
    main()
