"""Every training, table and figure of the paper on the embedded simulator; docs/reproduce.md."""

from steersman.studies.reproduce.plan import Plan, full, quick
from steersman.studies.reproduce.sections import TITLE, sections
from steersman.studies.reproduce.study import estimate, reproduce

__all__ = ["TITLE", "Plan", "estimate", "full", "quick", "reproduce", "sections"]
