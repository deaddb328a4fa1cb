"""A controller that answers messages: its memory for each drive, its deadline, its statistics."""

from __future__ import annotations

import time
from collections import Counter, OrderedDict
from collections.abc import Hashable
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from steersman.controllers.base import ControllerComponent, designed, timed_step, warm_up
from steersman.controllers.exchange import (
    NoQuestion,
    Question,
    answer_to,
    read_question,
    refusal,
)
from steersman.errors import SteersmanError
from steersman.types import Decision, Observation, Status
from steersman.vehicles import Vehicle

_MOST_DRIVES = 256
"""Drives that are remembered; the one that was silent longest is forgotten first."""
_MOST_MISSED = 20
"""Observations that a supervisor is told of as missing, of those lost one after the other."""
_AHEAD = 2**31
_SAME = 1e-9
# Times are counted in bins from a microsecond on, a hundred to a decade.
_FIRST, _DECADE, _BINS = 1e-6, 100, 800


class NodeStatistics(BaseModel):
    """What a node did until it ended; times from the arrival of a question to its answer."""

    model_config = ConfigDict(frozen=True)

    answers: int
    seconds: float
    """From the first question to the last."""
    median: float
    """[s], to 2 %."""
    p99: float
    """[s], to 2 %."""
    longest: float
    """[s]"""
    deadline: float
    """[s]"""
    missed: int
    """Answers later than the deadline."""
    saturated: int
    fallbacks: int
    refused: int
    """Messages that were no questions."""
    lost: int
    """Questions that never came, by their sequence."""
    stale: int
    """Questions that came after later ones, and were refused."""

    def sentence(self) -> str:
        """In words."""
        return (
            f"{self.answers} answers in {self.seconds:.1f} s; from question to answer "
            f"{1e3 * self.median:.3g} ms in half of them, {1e3 * self.p99:.3g} ms in 99 %, at most "
            f"{1e3 * self.longest:.3g} ms; deadline {1e3 * self.deadline:g} ms missed "
            f"{self.missed} times; {self.fallbacks} fallbacks, {self.saturated} saturated; "
            f"{self.refused} refused, {self.lost} lost, {self.stale} out of order"
        )


class _Drive(NamedTuple):
    """A drive that is under way."""

    state: Any
    sequence: int | None = None


class ControllerNode:
    """Answers questions of any number of drives."""

    def __init__(
        self,
        controller: ControllerComponent,
        vehicle: Vehicle,
        dt: float,
        example: Observation,
        deadline: float | None = None,
        *,
        gaps: bool = False,
    ) -> None:
        """Design the controller, and compile what it needs.

        Args:
            controller: what steers.
            vehicle: nominal parameters.
            dt: control period [s].
            example: something to try it with.
            deadline: from question to answer [s]; None: the control period.
            gaps: whether the controller is told of observations that did not come.

        Raises:
            ConfigError: the controller has no solution for the vehicle.
        """
        self._controller, self._dt, self._gaps = controller, dt, gaps or controller.gaps
        self._deadline = dt if deadline is None else deadline
        self._start = designed(controller, vehicle, dt)
        warm_up(controller, self._start, example)
        self._drives: OrderedDict[Hashable, _Drive] = OrderedDict()
        self._counts: Counter[str] = Counter()
        self._times = np.zeros(_BINS, dtype=np.int64)
        self._longest, self._begun, self._ended = 0.0, 0.0, 0.0

    def answer(self, message: bytes, sender: Hashable, arrived: float) -> bytes:
        """The answer to a message; whatever it is, there is one.

        Args:
            message: a line or a record.
            sender: whose drives it is about.
            arrived: ``time.perf_counter`` when it came [s].
        """
        try:
            question = read_question(message)
            decision = self._stepped(question, (sender, question.drive))
        except (NoQuestion, SteersmanError) as error:
            self._counts["refused"] += 1
            return refusal(str(error), message)
        now = time.perf_counter()
        took = now - arrived
        late = took > self._deadline
        self._begun, self._ended = self._begun or arrived, now
        place = int(_DECADE * np.log10(max(took, _FIRST) / _FIRST))
        self._times[min(place, _BINS - 1)] += 1
        self._longest = max(self._longest, took)
        self._counts["missed"] += late
        self._counts[decision.status.name] += 1
        return answer_to(question, decision, late=late)

    def _stepped(self, question: Question, key: Hashable) -> Decision:
        if question.dt is not None and abs(question.dt - self._dt) > _SAME:
            raise NoQuestion(
                f"dt: given {question.dt:g} s, this node was started for {self._dt:g} s"
            )
        drive = self._drives.get(key)
        if drive is None or question.sequence == 0:
            drive = _Drive(self._start)
        state = drive.state
        if question.executed is not None:
            state = self._controller.executed(state, question.executed)
        state = self._skipped(drive, question.sequence, state)
        decision, state, _ = timed_step(self._controller, state, question.seen)
        self._drives[key] = _Drive(state, question.sequence)
        self._drives.move_to_end(key)
        if len(self._drives) > _MOST_DRIVES:
            self._drives.popitem(last=False)
        return decision

    def _skipped(self, drive: _Drive, sequence: int | None, state: Any) -> Any:
        """The state after observations that did not come.

        Raises:
            NoQuestion: this one is older than the last.
        """
        if sequence is None or drive.sequence is None:
            return state
        ahead = (sequence - drive.sequence) % 2**32
        if not 0 < ahead < _AHEAD:
            self._counts["stale"] += 1
            raise NoQuestion(f"sequence: given {sequence} after {drive.sequence}")
        self._counts["lost"] += ahead - 1
        if self._gaps:
            for _ in range(min(ahead - 1, _MOST_MISSED)):
                _, state = self._controller.step(state, None)  # type: ignore[arg-type]
        return state

    def statistics(self) -> NodeStatistics:
        """So far."""
        counts = self._counts
        return NodeStatistics(
            answers=int(self._times.sum()),
            seconds=self._ended - self._begun,
            median=self._quantile(0.5),
            p99=self._quantile(0.99),
            longest=self._longest,
            deadline=self._deadline,
            missed=counts["missed"],
            saturated=counts[Status.SATURATED.name],
            fallbacks=counts[Status.FALLBACK.name],
            refused=counts["refused"],
            lost=counts["lost"],
            stale=counts["stale"],
        )

    def _quantile(self, share: float) -> float:
        total = np.cumsum(self._times)
        if total[-1] == 0:
            return 0.0
        place = int(np.searchsorted(total, share * total[-1]))
        return float(_FIRST * 10.0 ** ((place + 0.5) / _DECADE))
