"""Agents and networks are trained."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, overload

from steersman.api.driving import Folder
from steersman.api.resuming import resumed
from steersman.commands import Notify, Word, configuration
from steersman.errors import ConfigError
from steersman.ranges import seed_list, split_seeds

if TYPE_CHECKING:
    from steersman.learning.imitation.imitate import ImitationResult
    from steersman.learning.parallel import TrainingEvent
    from steersman.learning.progress import ImitationRow, TrainResult, TrainRow
    from steersman.learning.rewards import Judged
    from steersman.learning.seeds import TrainedSeeds
    from steersman.studies.search import SearchResult

_ONE = "one training; call sm.train for each seed, with seed=0, out='runs/x/seed_0' and so on"


@overload
def train(*words: Word, out: Folder, seeds: None = None, **settings: Any) -> TrainResult: ...
@overload
def train(
    *words: Word, out: Folder, seeds: Sequence[int] | str, **settings: Any
) -> TrainedSeeds: ...
def train(  # noqa: PLR0913 - of one training, or of several
    *words: Word,
    out: Folder,
    seeds: Sequence[int] | str | None = None,
    reward: Callable[[Judged], float] | None = None,
    overwrite: bool = False,
    resume: bool = False,
    progress: Callable[[TrainRow], None] | None = None,
    tick: Callable[[int], None] | None = None,
    listener: Callable[[TrainingEvent], None] | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> TrainResult | TrainedSeeds:
    """Train an agent while a controller demonstrates; ``result.policy`` is the policy's file.

    ``sm.train("demo", "agent.gamma=0.9", steps=100_000, out="runs/agent")``;
    ``sm.train("demo", seeds=[0, 1, 2], out="runs/three").best``

    Args:
        words: a preset or a YAML file, assignments, components, or a ``TrainConfig``.
        out: folder for policy, record, checkpoints and logs; with ``seeds``, of ``seed_0`` etc.
        seeds: seeds of several trainings, a list or ``"0..4"``, each in a process of its own; then
            the result has them in ``trainings``, and a failure in ``failed`` stops no other one.
        reward: a further term of the reward as a Python function of each judged step; for one
            training.
        overwrite: whether an earlier training in ``out`` is replaced.
        resume: go on from the last checkpoint in ``out``; without a preset, a file or a
            configuration, that of ``out`` is taken, and its seeds.
        progress: called at every validation with the new row of ``progress.csv``.
        tick: called about twice a second with the environment steps done.
        listener: called with what happens in each of several trainings, instead of ``progress``
            and ``tick``.
        engine: of several trainings: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: trainings at a time; None: one for each core.
        notify: called with a sentence where something is to be said.
        settings: fields of a training (``steersman show train``).

    Raises:
        ConfigError: a word or a value is unknown or not allowed; of several trainings only what
            concerns all of them is raised.
        DataError: a file is missing or malformed, or ``out`` holds a training already, or another
            command's results.
        TrainingDiverged: losses or values are no longer finite or plausible.
    """
    from steersman.learning.seeds import train_seeds
    from steersman.learning.train import train as run

    named, rest = split_seeds(words)
    numbers = named if seeds is None else seed_list(seeds)
    if resume and not overwrite:
        rest, numbers = resumed(FilePath(out), rest, numbers, notify)
    many = {"listener": listener, "engine": engine, "jobs": jobs}
    one = {"reward": reward, "progress": progress, "tick": tick}
    for name, value in (many if numbers is None else one).items():
        if value is not None:
            what = "several trainings (seeds=...)" if numbers is None else _ONE
            raise ConfigError(f"goes with {what}", (name,))
    chosen = configuration("train", rest, settings, notify)
    if numbers is not None:

        def tell(event: TrainingEvent) -> None:
            if event.note is not None and notify is not None:
                notify(event.note)

        return train_seeds(
            chosen,
            numbers,
            FilePath(out),
            listener or tell,
            engine=engine,
            jobs=jobs,
            overwrite=overwrite,
            resume=resume,
        )
    if reward is not None:
        chosen = chosen.rewarded(reward)
    return run(
        chosen,
        FilePath(out),
        progress,
        tick=tick,
        notify=notify,
        overwrite=overwrite,
        resume=resume,
    )


def search(
    *words: Word,
    out: Folder,
    trials: int = 20,
    progress: Callable[[int, str, float], None] | None = None,
    engine: str | None = None,
    jobs: int | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> SearchResult:
    """Search the hyper-parameters of a training; ``best.yaml`` in ``out`` is the best one.

    ``sm.search("demo", "agent.gamma=0.9..0.99", "seeds=0..2", trials=20, out="runs/search")``. The
    same call goes on where an interrupted one stopped.

    Args:
        words: those of :func:`train`; a setting that is searched is ``"key=LOW..HIGH"``,
            ``"key=LOW..HIGH:log"`` or ``"key=A|B"``, without any the agent's own are;
            ``"seeds=0..2"`` trains each trial with each of them, two by default.
        out: folder for ``search.json``, ``best.yaml`` and the trainings.
        trials: trials in all.
        progress: called at every validation with the trial, a few words, and the best score [m].
        engine: ``local`` or ``ray``; None: ``ray`` if ``RAY_ADDRESS`` is set.
        jobs: trainings at a time; None: one for each core.
        notify: called with a sentence where something is to be said.
        settings: fields of a training (``steersman show train``).

    Returns:
        What is written to ``search.json``.

    Raises:
        ConfigError: a word or a value is wrong, or ``out`` holds another search.
        DataError: a file is missing or malformed.
        TrainingDiverged: all trials diverged.
    """
    from steersman.api.driving import workers_for
    from steersman.config import build
    from steersman.files import out_folder
    from steersman.ranges import is_range, split_seeds
    from steersman.studies.search import search as run
    from steersman.studies.search_space import SearchConfig

    texts = [word for word in words if isinstance(word, str)]
    seeds, _ = split_seeds(texts)
    found = [text.partition("=") for text in texts if "=" in text]
    ranges = {n.strip(): v for n, _, v in found if n.strip() != "seeds" and is_range(v)}
    plain = [w for w in words if not (isinstance(w, str) and _key(w) in {*ranges, "seeds"})]
    training = configuration("train", plain, settings, notify)
    more = {} if seeds is None else {"seeds": seeds}
    chosen = build(SearchConfig, {"training": training, "ranges": ranges, "trials": trials, **more})
    engine, jobs = workers_for(training.problem.plant, engine, jobs)
    return run(chosen, out_folder(str(out)), progress, engine=engine, jobs=jobs)


def _key(word: str) -> str:
    return word.partition("=")[0].strip() if "=" in word else ""


def imitate(
    *words: Word,
    out: Folder,
    overwrite: bool = False,
    resume: bool = False,
    progress: Callable[[ImitationRow], None] | None = None,
    tick: Callable[[float], None] | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> ImitationResult:
    """Fit a network to a controller's actions; ``result.policy`` is the policy's file.

    ``sm.imitate("precision", "problem.demonstration.controller=mpc_delay", out="runs/dagger")``

    Args:
        words: a training's preset or a YAML file, assignments, or an ``ImitationConfig``.
        out: folder for policy, record and logs.
        overwrite: whether an earlier training in ``out`` is replaced.
        resume: go on from the last round in ``out``, likewise.
        progress: called after every round with the new row of ``progress.csv``.
        tick: called now and then with the rounds done.
        notify: called with a sentence where something is to be said.
        settings: fields of an imitation (``steersman show imitate``).

    Raises:
        ConfigError: a word or a value is unknown or not allowed.
        DataError: a file is missing or malformed, or ``out`` holds a training already, or another
            command's results.
        TrainingDiverged: the loss is no longer finite.
    """
    from steersman.learning.imitation.imitate import imitate as run

    rest = list(words)
    if resume and not overwrite:
        rest, _ = resumed(FilePath(out), words, None)
    chosen = configuration("imitate", rest, settings, notify)
    return run(
        chosen,
        FilePath(out),
        progress,
        tick=tick,
        notify=notify,
        overwrite=overwrite,
        resume=resume,
    )
