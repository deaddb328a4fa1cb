"""What a study keeps in its folder: its configuration, and Optuna's journal to go on from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

from steersman.bench.suite import derived_seed
from steersman.config import Settings, build, dump, read_yaml, to_yaml
from steersman.errors import ConfigError, shortened
from steersman.files import write_text


def same_study(config: Settings, out: FilePath, free: Sequence[str]) -> None:
    """Keep a study's configuration in ``out``, or compare it; only ``free`` fields may differ.

    Raises:
        ConfigError: the folder holds a study of something else.
        DataError: the folder cannot be written.
    """
    file = out / "config.yaml"
    now = dump(config) or {}
    if file.exists():
        # Read as a configuration, so that fields that are new since then have their defaults.
        changed = {name: now[name] for name in free}
        before = dump(build(type(config), read_yaml(file) | changed)) or {}
        for key in now:
            if before.get(key) != now[key]:
                had, given = _few(before.get(key)), _few(now[key])
                raise ConfigError(
                    f"{out} holds a study with other settings: {key} was {had}, now {given};"
                    " give another folder"
                )
    write_text(file, to_yaml(config))


def _few(value: Any) -> str:
    """A setting in few letters."""
    return shortened(str(value))


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


def sampler(seed: int, number: int, *, constant_liar: bool = False) -> Any:
    """The sampler of a trial, which draws the same whether or not the study was interrupted."""
    from optuna.samplers import TPESampler

    own = derived_seed(seed, "trial", str(number))
    return TPESampler(seed=own, multivariate=True, constant_liar=constant_liar)
