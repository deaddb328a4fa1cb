"""What a comparison finds: the content of ``compare.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any, ClassVar, Literal, TypeAlias

from pydantic import Field

from steersman.bench.along import AlongComparison
from steersman.bench.pairs import Contrast, PairedComparison
from steersman.bench.results import Summary
from steersman.policy_file import locate, read_policy
from steersman.seed_folders import seeds_in
from steersman.stored import ShownResult, SourcedResult, StoredResult, optional
from steersman.studies.compare.contestants import Contestant
from steersman.studies.compare.replicates import ReplicatedComparison
from steersman.table_file import Columns, columns_of

FORMAT = 1
_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


class TrainingRecord(StoredResult):
    """What the card of a policy says of its training."""

    steps: float | None
    simulated_seconds: float | None
    validation_mean_error: float | None
    validation_rms_error: float | None
    validation_failures: float | None
    validation_steer_activity: float | None


class ContestantRecord(StoredResult):
    """One side of a comparison."""

    letter: str
    name: str
    sort: str
    source: str
    learned: bool
    controller: dict[str, Any] | None = optional()
    """Its configuration, if it was driven now."""
    training: TrainingRecord | None = optional()
    trainings: dict[str, TrainingRecord] | None = optional()
    """By seed, of a folder of trainings with several."""


class CompareResult(ShownResult, SourcedResult):
    """What every comparison has; the first contestant is what the others are compared with.

    Its table has a row for each figure of each comparison.
    """

    shown_by: ClassVar[str] = "steersman.report.comparison:shown_comparison"
    rms: ClassVar[str]
    """Name of the RMS error among the figures."""

    format: int = FORMAT
    sort: str
    contestants: list[ContestantRecord]
    warnings: list[str] = Field([])

    def contrasts(self) -> list[tuple[str, Mapping[str, Contrast]]]:
        """Each contestant but the first, with the figures that set it against the first."""
        raise NotImplementedError

    def line(self) -> str:
        """The contestants, and their RMS errors over that of the first."""
        found = []
        for name, figures in self.contrasts():
            ratio = figures[self.rms].ratio.value if self.rms in figures else None
            found.append(f"{name} {'unknown' if ratio is None else f'{ratio:.3g}'}")
        base = self.contestants[0].name
        return f"{type(self).__name__}: RMS error over that of {base}: {', '.join(found)}"

    def table(self) -> Columns:
        """In SI units; ``base`` is the first contestant, ``own`` the other."""
        base = self.contestants[0].name
        return columns_of(
            {"base_name": base, "own_name": name, "figure": figure, **one.plain()}
            for name, figures in self.contrasts()
            for figure, one in figures.items()
        )


class ScenarioCompareResult(CompareResult):
    """Controllers compared over the same scenarios."""

    rms: ClassVar[str] = "rms_m"

    sort: Literal["scenarios"] = "scenarios"
    scenarios: str
    """Where the scenarios come from."""
    seeds: list[int]
    summary: Summary
    comparisons: list[PairedComparison]
    replicates: ReplicatedComparison | None = optional()
    """Over all seeds, if a contestant has several; ``comparisons`` and ``summary`` show the seed
    of median error."""

    def contrasts(self) -> list[tuple[str, Mapping[str, Contrast]]]:
        """By name of :data:`steersman.bench.pairs.FIGURES`."""
        return [(one.name, one.figures) for one in self.comparisons]


class FieldDifference(StoredResult):
    """A setting in which two drives differ; None where one has no such setting."""

    field: str
    base: Any
    own: Any


class DriveComparison(StoredResult):
    """A drive against the first."""

    name: str
    differ: list[FieldDifference]
    same_path: bool
    along: AlongComparison | None
    """None where there is nothing to compare along the path."""


class DriveCompareResult(CompareResult):
    """Drives compared place by place along their path."""

    rms: ClassVar[str] = "rms_lateral_error_m"

    sort: Literal["drives"] = "drives"
    metrics: dict[str, dict[str, Any]]
    """Of each drive by name, of :func:`steersman.metrics.base.summarise`."""
    comparisons: list[DriveComparison]

    def contrasts(self) -> list[tuple[str, Mapping[str, Contrast]]]:
        """By name of :data:`steersman.bench.along.ALONG`."""
        return [(one.name, one.along.figures if one.along else {}) for one in self.comparisons]


AnyComparison: TypeAlias = ScenarioCompareResult | DriveCompareResult


def records(found: Sequence[Contestant]) -> list[ContestantRecord]:
    """The contestants with their letters.

    Raises:
        DataError: a policy or its card is missing or malformed.
    """
    return [_record(one, letter) for one, letter in zip(found, _LETTERS, strict=False)]


def _record(one: Contestant, letter: str) -> ContestantRecord:
    training, several = None, None
    if one.sort == "seeds" and one.folder is not None:
        policies = {
            str(seed): place / "policy.onnx" for seed, place in seeds_in(one.folder).items()
        }
        if all(file.is_file() for file in policies.values()):
            several = {seed: training_record(file) for seed, file in policies.items()}
    if one.sort == "training" and one.folder is not None:
        training = training_record(one.folder / "policy.onnx")
    return ContestantRecord(
        letter=letter,
        name=one.name,
        sort=one.sort,
        source=one.source,
        learned=one.learned,
        controller=None if one.entrant is None else one.entrant.shown,
        training=training,
        trainings=several,
    )


def training_record(policy: FilePath) -> TrainingRecord:
    """What the card of a policy says of its training: steps, simulated seconds, validation.

    Raises:
        DataError: the file or its card is missing or malformed.
    """
    card = read_policy(locate(str(policy)))[1].training
    flat = {**card, **{f"validation_{k}": v for k, v in card.get("validation", {}).items()}}
    return TrainingRecord(**{name: flat.get(name) for name in TrainingRecord.model_fields})
