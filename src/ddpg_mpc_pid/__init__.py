"""Every training, table and figure of the paper on the embedded simulator; docs/reproduce.md.

A package of its own: it uses ``import steersman`` and none of its modules.
"""

from ddpg_mpc_pid.parts import join
from ddpg_mpc_pid.plan import Plan, full, only, published, quick
from ddpg_mpc_pid.results import StudyResult
from ddpg_mpc_pid.sections import sections, write_page
from ddpg_mpc_pid.study import estimate, reproduce

__all__ = [
    "Plan",
    "StudyResult",
    "estimate",
    "full",
    "join",
    "only",
    "published",
    "quick",
    "reproduce",
    "sections",
    "write_page",
]
