r"""The benchmark made anew by one command: tune every classical controller, then drive every suite.

    python benchmarks/yardstick.py --out runs/yardstick --tracks ../shared/data/racetracks \
        --maps ../shared/data/opendrive --tum ../shared/data/tum_control

Each controller of the package is tuned with three seeds of the search on the suite ``tuning``. All
have the same budget: ``--trials``, and as many again while the median seed is more than ``--apart``
worse than the best, ``--most`` times at most: until then the search decides, not the controller.
All its seeds and the policies of the package then drive ``standard``,
``standard_1`` and the foreign worlds. Everything goes through the engine (``--jobs``,
``--engine``), and the same command goes on where an interrupted one stopped. With ``--keep`` what
belongs into the repository is copied there: gains of the median seed, records, pages.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import steersman as sm
from steersman import policies, tuned
from steersman.provenance import provenance
from steersman.studies.trials import TuningTrials
from steersman.studies.tune_seeds import SeedsResult

ROOT = Path(__file__).resolve().parents[1]
SUITES = ("standard", "standard_1", "foreign")
FOLDERS = ("tracks", "maps", "tum", "logs")
# What of a study and of a benchmark is kept; rows, journals and plots are made again.
OF_SEED = ("result.json", "pareto.json", "pareto.svg")
OF_BENCH = ("results.json", "suite.yaml", "report.html")


def tune(names: Sequence[str], given: argparse.Namespace) -> dict[str, Path]:
    """The folder of each controller's studies, one for each seed."""
    out = {}
    for name in names:
        short = name.removeprefix("tuned/")
        out[short] = given.out / "tune" / short
        for times in range(1, given.most + 1):
            sm.tune(
                name,
                trials=times * given.trials,
                seeds=given.seeds,
                out=out[short],
                progress=partial(tried, short),
                notify=say,
                engine=given.engine,
                jobs=given.jobs,
            )
            costs = sorted(seed.cost_m for seed in seeds_of(out[short]).seeds)
            if costs[len(costs) // 2] <= (1.0 + given.apart) * costs[0]:
                break
    return out


def seeds_of(folder: Path) -> SeedsResult:
    """The costs of a controller's seeds."""
    return SeedsResult.read(folder / "seeds.json")


def tried(name: str, done: float, cost: float) -> None:
    """A finished trial."""
    say(f"{name}: trial {done:.0f}, {1e3 * cost:.4g} mm")


def bench(folders: dict[str, Path], given: argparse.Namespace) -> None:
    """Every suite, driven by all seeds of every controller and by the other words."""
    words = [*(f"{name}={folder}" for name, folder in folders.items()), *given.others]
    for suite in given.suites:
        places = {name: getattr(given, name) for name in FOLDERS} if suite == "foreign" else {}
        sm.bench(
            *words,
            suite=[suite] if given.sample is None else [suite, f"sample={given.sample}"],
            out=given.out / suite,
            notify=say,
            engine=given.engine,
            jobs=given.jobs,
            **places,
        )


def keep(folders: dict[str, Path], given: argparse.Namespace) -> None:
    """Copy into the repository what belongs there."""
    results = ROOT / "results"
    for name, folder in folders.items():
        into = results / "tune" / name
        median = seeds_of(folder).median
        copy((folder / file for file in ("tuned.yaml", "seeds.json")), into)
        copy((folder / f"seed_{median}" / file for file in OF_SEED), into)
        text = (folder / "tuned.yaml").read_text(encoding="utf-8")
        trials = len(TuningTrials.read(folder / f"seed_{median}" / "pareto.json").trials)
        command = f"steersman tune tuned/{name} seeds={given.seeds} --trials {trials}"
        head = f"# At commit {provenance()['commit']}, from the gains of before: {command}\n"
        (ROOT / "src/steersman/tuned" / f"{name}.yaml").write_text(head + text, encoding="utf-8")
    names = {"standard": "bench", "foreign": "foreign"}
    for suite in given.suites:
        kept = (given.out / suite / file for file in OF_BENCH)
        copy(kept, results / names.get(suite, f"bench/{suite}"))


def copy(files: Iterable[Path], into: Path) -> None:
    """Copy files into a folder, which is made."""
    into.mkdir(parents=True, exist_ok=True)
    for file in files:
        shutil.copy(file, into / file.name)


def say(text: str) -> None:
    """A line on stderr."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201


def main(words: Sequence[str] | None = None) -> None:
    """Parse the command line and do it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--controllers", nargs="*", default=tuned.names(), help="tuned/NAME")
    parser.add_argument("--others", nargs="*", default=policies.names(), help="not tuned, driven")
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--apart", type=float, default=0.1, help="share of the cost")
    parser.add_argument("--most", type=int, default=4, help="times --trials")
    parser.add_argument("--seeds", default="0..2", help="of the search")
    parser.add_argument("--suites", nargs="*", default=SUITES)
    for name in FOLDERS:
        parser.add_argument(f"--{name}", type=Path, help="folder for the suite foreign")
    parser.add_argument("--sample", type=int, help="so many scenarios of each disturbance")
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--engine")
    parser.add_argument("--keep", action="store_true", help="copy into results/ and src/")
    given = parser.parse_args(words)
    folders = tune(given.controllers, given)
    bench(folders, given)
    if given.keep:
        keep(folders, given)


if __name__ == "__main__":
    main()
