"""The same tuning with several seeds of its search: the median of them is what is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path as FilePath

from steersman.files import make_folder, write_text
from steersman.seed_folders import seed_folder
from steersman.stored import SourcedResult, StoredResult
from steersman.studies.trials import TuneResult
from steersman.studies.tune import TuneConfig, tune


class SeedCost(StoredResult):
    """What the search with one seed found."""

    seed: int
    cost_m: float


class SeedsResult(SourcedResult):
    """The content of ``seeds.json``."""

    median: int
    """The seed whose controller is kept: half of the others cost less, half more."""
    seeds: list[SeedCost]
    """In the order of their cost."""


def tune_seeds(
    config: TuneConfig,
    seeds: Sequence[int],
    out: FilePath,
    progress: Callable[[int, float], None] | None = None,
    *,
    engine: str | None = None,
    jobs: int | None = None,
) -> TuneResult:
    """Tune with each seed into ``seed_N`` of the folder; the result is that of the median seed.

    Writes ``tuned.yaml``, the median's controller, and ``seeds.json``. Of an even number of seeds
    the better one of the two in the middle is the median.

    Args:
        config: the tuning; its own seed is replaced.
        seeds: seeds of the search.
        out: folder of the studies; the same call goes on where an interrupted one stopped.
        progress: called after each trial with the trials of all seeds that are done, and the least
            cost of the present one [m].
        engine: of :class:`steersman.engine.jobs.Workers`.
        jobs: drives at a time; None: one for each core.

    Raises:
        ConfigError: the controller declares nothing to tune, or ``out`` holds another study.
        DataError: the folder cannot be written.
    """
    make_folder(out)
    found: dict[int, TuneResult] = {}
    for count, seed in enumerate(seeds):

        def tell(done: int, cost: float, before: int = count * config.trials) -> None:
            if progress is not None:
                progress(before + done, cost)

        own = config.model_copy(update={"seed": seed})
        found[seed] = tune(own, seed_folder(out, seed), tell, engine=engine, jobs=jobs)
    order = sorted(found, key=lambda seed: found[seed].cost_m)
    median = order[(len(order) - 1) // 2]
    costs = ", ".join(f"{seed}: {1e3 * found[seed].cost_m:.4g}" for seed in order)
    kept = (seed_folder(out, median) / "tuned.yaml").read_text(encoding="utf-8")
    write_text(
        out / "tuned.yaml", f"# The median of {len(order)} seeds, costs [mm] {costs}\n{kept}"
    )
    SeedsResult(
        median=median,
        seeds=[SeedCost(seed=seed, cost_m=found[seed].cost_m) for seed in order],
        versions=found[median].versions,
        commit=found[median].commit,
    ).write(out / "seeds.json")
    return found[median]
