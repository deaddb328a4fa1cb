"""Finished parts of a plan as one study."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

import steersman as sm
from ddpg_mpc_pid.plan import FULL_METHOD, METHODS
from ddpg_mpc_pid.results import CircleResult, LearningCurves, SeedDrives, StudyResult
from ddpg_mpc_pid.savings import compared
from ddpg_mpc_pid.study import CURVE_DIGITS, RESULTS, plain, write_results

# What parts of a plan differ in.
_OWN = frozenset(
    {"methods", "seeds", "ablation_seeds", "training_methods", "trainings", "digest", "parts"}
)


def join(folders: Sequence[FilePath], root: FilePath) -> StudyResult:
    """Write and return what several parts of a plan found, each of other methods, as one study.

    Learning is compared anew over all methods. The drives with the full method's agents and the
    computing times are those of the part that trained it (the first, if none did).

    Args:
        folders: of finished parts.
        root: folder for the study: empty, or with parts that were joined there before.

    Raises:
        ConfigError: no part, one that is given twice, a method in two of them, or different plans.
        DataError: a part is no finished study, or ``root`` holds something else.
    """
    if not folders:
        raise sm.ConfigError("--join: give folders with commas between them")
    for k, folder in enumerate(folders):
        if folder.resolve() in [other.resolve() for other in folders[:k]]:
            raise sm.ConfigError(f"--join: {folder} is given twice")
    _check_folder(root)
    results = joined({str(folder): _read(folder) for folder in folders})
    write_results(results, root)
    return results


def _read(folder: FilePath) -> StudyResult:
    """What a part found."""
    file = folder / RESULTS
    if not file.is_file():
        what = f"no {RESULTS} in it" if folder.is_dir() else "no such folder"
        raise sm.DataError(f"--join: {folder}: {what}; give folders that steersman reproduce wrote")
    try:
        return StudyResult.read(file)
    except sm.DataError as error:
        raise sm.DataError(
            f"--join: {folder}: not a study of steersman reproduce ({error})"
        ) from None


def _check_folder(root: FilePath) -> None:
    """Whether nothing but parts that were joined before would be written over."""
    if not root.is_dir() or not any(root.iterdir()):
        return
    try:
        mine = "parts" in StudyResult.read(root / RESULTS).plan
    except sm.DataError:
        mine = False
    if not mine:
        raise sm.DataError(f"--out {root}: holds something else; give a new or empty folder")


def joined(parts: Mapping[str, StudyResult]) -> StudyResult:
    """Parts of a plan, by the name that a message has for each, as one study.

    Raises:
        ConfigError: a method is in two parts, or their tests differ.
    """
    _check(parts)
    found = list(parts.values())
    every = {name: method for part in found for name, method in part.learning.methods.items()}
    methods = {name: every[name] for name in METHODS if name in every}
    main = next((part for part in found if FULL_METHOD in part.plan["methods"]), found[0])
    steps = max(part.learning.steps for part in found)
    learning = compared(methods, steps, main.plan["repetitions"])
    seconds: Counter[str] = Counter()
    for part in found:
        seconds.update(part.seconds)
    return main.model_copy(
        update={
            "commit": sm.provenance()["commit"],
            "versions": _versions(found),
            "made_by": sorted({commit for part in found for commit in part.made_by}),
            "seconds": {stage: round(spent, 2) for stage, spent in seconds.items()},
            "plan": _plan(main, found),
            "learning": LearningCurves(**plain(learning, CURVE_DIGITS)),
            "circle": _circle(found),
        }
    )


def _check(parts: Mapping[str, StudyResult]) -> None:
    """Whether the parts are of one plan, and no method is in two of them."""
    plans = {where: _tests(part) for where, part in parts.items()}
    first, tests = next(iter(plans.items()))
    for where, own in plans.items():
        differ = [name for name in tests | own if tests.get(name) != own.get(name)]
        if differ:
            raise sm.ConfigError(
                f"--join: {where} is of another plan than {first}: {', '.join(differ)} "
                f"{'differs' if len(differ) == 1 else 'differ'}"
            )
    owner: dict[str, str] = {}
    for where, part in parts.items():
        for method in part.plan["methods"]:
            if owner.setdefault(method, where) != where:
                raise sm.ConfigError(f"--join: {owner[method]} and {where} both train {method!r}")


def _tests(part: StudyResult) -> dict[str, Any]:
    """What parts of one plan have in common."""
    return {name: value for name, value in part.plan.items() if name not in _OWN}


def _versions(found: Sequence[StudyResult]) -> dict[str, str]:
    """Versions of the libraries; all of them where parts differ."""
    names = dict.fromkeys(name for part in found for name in part.versions)
    return {
        name: ", ".join(dict.fromkeys(p.versions[name] for p in found if name in p.versions))
        for name in names
    }


def _plan(main: StudyResult, found: Sequence[StudyResult]) -> dict[str, Any]:
    """The plan of all parts, and which commits made which methods."""
    plans = [part.plan for part in found]
    training_methods = {k: v for plan in plans for k, v in plan["training_methods"].items()}
    return {
        **main.plan,
        "methods": [name for name in METHODS if name in training_methods],
        "seeds": max(plan["seeds"] for plan in plans),
        "ablation_seeds": max(plan["ablation_seeds"] for plan in plans),
        "training_methods": training_methods,
        "trainings": [name for plan in plans for name in plan["trainings"]],
        "digest": None,
        "parts": [one for part in found for one in part.plan.get("parts", [_origin(part)])],
    }


def _origin(part: StudyResult) -> dict[str, Any]:
    plan = part.plan
    return {"methods": plan["methods"], "made_by": part.made_by, "digest": plan["digest"]}


def _circle(found: Sequence[StudyResult]) -> CircleResult:
    """The paper's table with the drivers of all parts: methods in their order, then the others."""
    order = [method.label for method in METHODS.values()]
    tests = []
    for same in zip(*(part.circle.tests for part in found), strict=True):
        drivers: dict[str, SeedDrives] = {}
        for test in same:
            drivers |= test.drivers
        names = [*(n for n in order if n in drivers), *(n for n in drivers if n not in order)]
        chosen = {name: drivers[name] for name in names}
        tests.append(same[0].model_copy(update={"drivers": chosen}))
    return CircleResult(tests=tests)
