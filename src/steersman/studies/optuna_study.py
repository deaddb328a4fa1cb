"""Optuna's study in a file, from which an interrupted one goes on."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

from steersman.bench.suite import derived_seed


def open_study(journal: FilePath, name: str) -> Any:
    """The study that a file keeps, made if need be; this process must be alone in its folder."""
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    # Optuna's own lock stays behind if it is killed while it writes, and would be waited for.
    journal.with_name(f"{journal.name}.lock").unlink(missing_ok=True)
    return optuna.create_study(
        study_name=name,
        storage=JournalStorage(JournalFileBackend(str(journal))),
        load_if_exists=True,
    )


def trial_states() -> Any:
    """Optuna's states of a trial."""
    from optuna.trial import TrialState

    return TrialState


def close_unfinished(study: Any) -> None:
    """Close the trials that an interruption left unfinished."""
    for trial in study.get_trials(deepcopy=False, states=[trial_states().RUNNING]):
        study.tell(trial.number, state=trial_states().FAIL)


def sampler(seed: int, number: int, *, constant_liar: bool = False) -> Any:
    """The sampler of a trial, which draws the same whether or not the study was interrupted."""
    from optuna.samplers import TPESampler

    own = derived_seed(seed, "trial", str(number))
    return TPESampler(seed=own, multivariate=True, constant_liar=constant_liar)
