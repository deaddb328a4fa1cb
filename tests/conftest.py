"""Settings of all tests."""

from __future__ import annotations

from hypothesis import settings

# The first example may have to compile a kernel, and machines are noisy: no deadlines.
settings.register_profile("steersman", deadline=None)
settings.load_profile("steersman")
