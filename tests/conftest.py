"""Settings of all tests."""

from __future__ import annotations

import signal

from hypothesis import settings

# The first example may have to compile a kernel, and machines are noisy: no deadlines.
settings.register_profile("steersman", deadline=None)
settings.load_profile("steersman")


def pytest_configure() -> None:
    """Ctrl-C works in the commands that tests start, also where tests run in the background.

    A shell starts background jobs with SIGINT ignored, and children inherit that.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
