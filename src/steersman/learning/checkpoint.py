"""Checkpoints: all that a training needs to go on as if it had never stopped."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from steersman.config import build, dump, read_yaml, to_yaml
from steersman.errors import ConfigError, DataError
from steersman.files import make_folder, replacing, write_text
from steersman.learning import running, snapshot
from steersman.learning.imitation.config import LearningConfig
from steersman.learning.rewards import FunctionTerm
from steersman.learning.snapshot import Tree
from steersman.seed_folders import refuse_seeds

FOLDER = "resume"
_FORMAT = 3
_KEPT = 2
_POLICY = ("policy.onnx", "policy.json")
# What other commands leave: none of them is mixed with a training.
_OTHERS = (
    *("episode.npz", "rows.jsonl", "results.json", "compare.json", "search.json", "drives.jsonl"),
    *("falsify.json", "study.jsonl", "tuned.yaml"),
)
# Where a policy goes whose training was cut before its first checkpoint and begins again.
_BEFORE = "before"
_WRITTEN = ("checkpoints", "data", FOLDER, "tensorboard")
_FILES = (
    *("config.yaml", "progress.csv", *_POLICY),
    *(running.DRIVE, running.STATE, running.REQUEST),
)
Notify = Callable[[str], None]


class Begun(NamedTuple):
    """A folder in which a training may begin or go on."""

    finished: bool
    saved: dict[str, Any] | None
    """The checkpoint to go on from."""


def begin(
    config: LearningConfig, out: FilePath, notify: Notify, *, overwrite: bool, resume: bool
) -> Begun:
    """Make the folder ready, with the configuration in it, or find what it holds already.

    Raises:
        DataError: ``out`` holds a training already, or cannot be written.
        ConfigError: the training to be resumed has another configuration.
    """
    check_folder(config, out, overwrite=overwrite, resume=resume)
    saved = None
    if resume and is_finished(config, out):
        notify(f"{out}: finished already")
        return Begun(True, None)
    if resume:
        saved = load(out, notify)
        if saved is None:
            notify(f"nothing to resume in {out}: beginning{_set_aside(out)}")
    if saved is None:
        clear(make_folder(out))
        write_text(out / "config.yaml", to_yaml(config))
    sweep(out)
    return Begun(False, saved)


def _set_aside(out: FilePath) -> str:
    """Move a policy that no checkpoint stands behind out of the way; the words that say so."""
    aside = out / _BEFORE
    found = [file for name in _POLICY if (file := out / name).exists()]
    for file in found:
        make_folder(aside)
        file.replace(aside / file.name)
    return f"; the policy that was there is in {aside}" if found else ""


def save(out: FilePath, steps: int, tree: Tree) -> None:
    """Write the checkpoint after ``steps`` environment steps; the one before stays, too.

    Raises:
        DataError: it cannot be written.
    """
    with replacing(out / FOLDER / f"step_{steps:09d}.npz") as stream:
        snapshot.write({"format": _FORMAT, "random": _random_state(), **tree}, stream)
    for file in _found(out)[_KEPT:]:
        file.unlink(missing_ok=True)


def save_weights(out: FilePath, steps: int, weights: Mapping[str, Any]) -> None:
    """Write weights and moments after ``steps`` environment steps, which stay.

    Raises:
        DataError: they cannot be written.
    """
    with replacing(out / "checkpoints" / f"step_{steps:09d}.npz") as stream:
        np.savez(stream, **weights)


def load(out: FilePath, notify: Notify | None = None) -> dict[str, Any] | None:
    """The newest checkpoint that is whole; None if there is none at all.

    Args:
        out: the training's folder.
        notify: called with a sentence for every damaged checkpoint that was passed over.

    Raises:
        DataError: there are checkpoints, but none can be read.
    """
    faults = []
    for file in _found(out):
        try:
            with file.open("rb") as stream:
                tree = snapshot.read(stream)
            if tree.get("format") != _FORMAT:
                raise DataError(f"format {tree.get('format')!r} is not known")
        except (OSError, DataError) as error:
            faults.append(f"{file}: not a whole checkpoint ({error})")
            continue
        if notify is not None:
            for fault in faults:
                notify(f"{fault}; going on from {file.name}")
        return tree
    if faults:
        raise DataError(f"{faults[0]}; --overwrite trains anew")
    return None


def exists(out: FilePath) -> bool:
    """Whether there is a checkpoint, whole or not, from which ``resume`` would go on."""
    return bool(_found(out))


def _found(out: FilePath) -> list[FilePath]:
    """Checkpoint files, newest first."""
    return sorted((out / FOLDER).glob("step_*.npz"), reverse=True)


def _random_state() -> dict[str, Any]:
    """The process-wide generators from which SB3 draws."""
    import torch

    return {
        "numpy": np.random.get_state(legacy=False),  # noqa: NPY002 - SB3's generator
        "torch": torch.get_rng_state().numpy(),
    }


def restore_random(tree: Tree) -> None:
    """Set the process-wide generators to where a checkpoint found them."""
    import torch

    np.random.set_state(tree["random"]["numpy"])  # noqa: NPY002 - SB3's generator
    torch.set_rng_state(torch.from_numpy(tree["random"]["torch"]))


def check_folder(config: LearningConfig, out: FilePath, *, overwrite: bool, resume: bool) -> None:
    """Whether this training may go to ``out``; nothing is written.

    Raises:
        DataError: it holds a training, and neither ``overwrite`` nor ``resume`` is set; or it is
            the folder of something else.
        ConfigError: that training has another configuration.
    """
    if overwrite and resume:
        raise ConfigError("--overwrite and --resume contradict each other; give one of them")
    refuse_seeds(out)
    kept = out / "config.yaml"
    if resume and kept.exists():
        _check_same(config, kept)
        return
    if not overwrite and ((out / "progress.csv").exists() or _found(out)):
        raise DataError(
            f"{out}: holds a training already; give another folder, --resume or --overwrite"
        )
    _refuse_others(out, kept)
    if resume and (strangers := _strangers(out)):
        raise DataError(
            f"{out}: holds no training to resume, but {strangers[0]}; give the training's folder,"
            " or a new one to begin"
        )


def _refuse_others(out: FilePath, kept: FilePath) -> None:
    """Refuse the folder of another command.

    Raises:
        DataError: ``out`` holds what another command has written.
    """
    found = next((name for name in _OTHERS if (out / name).exists()), None)
    if found is None and kept.is_file() and "problem" not in read_yaml(kept):
        found = "the configuration"
    if found is not None:
        raise DataError(f"{out}: holds {found} of another command; give another folder")


def _strangers(out: FilePath) -> list[str]:
    """What lies in a folder and is no training's."""
    ours = {*_FILES, *_WRITTEN, _BEFORE, "traceback.txt"}
    found = sorted(out.iterdir()) if out.is_dir() else []
    return [f.name for f in found if f.name not in ours and not f.name.startswith(".")]


def _check_same(config: LearningConfig, file: FilePath) -> None:
    try:
        kept = build(type(config), _with_functions(read_yaml(file), config))
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    found = first_difference(dump(config), dump(kept))
    if found is not None:
        where, given, had = found
        raise ConfigError(
            f"{given!r} is given, but {file} has {had!r}; a training resumes as it began", where
        )


def _with_functions(tree: dict[str, Any], config: LearningConfig) -> dict[str, Any]:
    """A kept configuration with the Python functions that it names, taken from ``config``.

    Raises:
        ConfigError: it names one that ``config`` has not.
    """
    terms = [term for term in config.problem.task.terms if isinstance(term, FunctionTerm)]
    ours = {term.model_dump()["function"]: term.function for term in terms}
    for term in tree.get("problem", {}).get("task", {}).get("terms", ()):
        if term.get("kind") == "function":
            name = term["function"]
            if name not in ours:
                raise ConfigError(
                    f"its reward has the Python function {name}; go on from Python with the same "
                    "one: sm.train(..., reward=FUNCTION, resume=True)"
                )
            term["function"] = ours[name]
    return tree


def first_difference(
    a: Any, b: Any, where: tuple[str, ...] = ()
) -> tuple[tuple[str, ...], Any, Any] | None:
    """Where two trees of plain data first differ, and what they hold there.

    >>> first_difference({"a": 1, "b": {"c": [1, 2]}}, {"a": 1, "b": {"c": [1, 3]}})
    (('b', 'c', '1'), 2, 3)
    """
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        pairs = [(key, a.get(key), b.get(key)) for key in {**a, **b}]
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        pairs = [(str(i), *pair) for i, pair in enumerate(zip(a, b, strict=True))]
    else:
        return None if a == b else (where, a, b)
    found = (first_difference(x, y, (*where, key)) for key, x, y in pairs)
    return next((f for f in found if f is not None), None)


def is_finished(config: LearningConfig, out: FilePath) -> bool:
    """Whether the training in ``out`` came to its end."""
    last = max((out / "checkpoints").glob("step_*.npz"), default=None)
    if last is None or not (out / "policy.onnx").exists():
        return False
    digits = last.stem.removeprefix("step_")
    return digits.isdecimal() and int(digits) >= config.steps


def finish(out: FilePath) -> None:
    """Remove what only resuming needs: the replay buffer is large."""
    shutil.rmtree(out / FOLDER, ignore_errors=True)


def clear(out: FilePath) -> None:
    """Remove an earlier training."""
    for name in _WRITTEN:
        shutil.rmtree(out / name, ignore_errors=True)
    for name in _FILES:
        (out / name).unlink(missing_ok=True)
    sweep(out)


def sweep(out: FilePath) -> None:
    """Remove half-written files of a process that was killed."""
    for name in _FILES:
        for file in out.glob(f".{name}.*"):
            file.unlink(missing_ok=True)
    for folder in ("checkpoints", FOLDER):
        for file in (out / folder).glob(".step_*"):
            file.unlink(missing_ok=True)
