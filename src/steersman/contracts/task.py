"""What every task has to fulfil."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steersman.contracts import Contract
from steersman.contracts import reward as term_contract
from steersman.contracts.reward import steps, values
from steersman.kernels import reward as kernel
from steersman.learning.task import TaskComponent


def its_terms_keep_their_contract(task: TaskComponent) -> Iterator[str]:
    """Each term of the sum."""
    for term in task.sum_of():
        for found in term_contract.it_is_what_it_declares(term):
            yield f"{term.kind}: {found}"


def the_reward_is_the_sum_of_its_terms(task: TaskComponent) -> Iterator[str]:
    """R = c_track r_track - c_diff r_diff + the other terms, with the kernel's coefficients."""
    terms, table, given = task.sum_of(), task.table(), steps()
    out = np.empty((len(given), 4))
    for step, row in zip(given, out, strict=True):
        kernel.judge(table, step, row)
    parts = np.array([values(term, given) for term in terms])
    first = 1 if task.demonstration == "none" else 2
    expected = out[:, kernel.C_TRACK] * parts[0] + parts[first:].sum(axis=0)
    if first > 1:
        expected += out[:, kernel.C_DIFF] * parts[1]
    if not np.allclose(out[:, kernel.TOTAL], expected):
        yield "the reward is not the sum of its terms"


check: Contract[TaskComponent] = Contract(
    its_terms_keep_their_contract, the_reward_is_the_sum_of_its_terms
)
