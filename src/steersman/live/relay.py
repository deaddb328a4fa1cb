"""A demonstrator for ``controller=process``: the person at the wheel of a live page.

``python -m steersman.live.relay FOLDER`` hands each line of its input to the page's server, whose
address is a file in ``FOLDER``. While no person is there it answers ``{"steer": null}`` at once.
"""

from __future__ import annotations

import json
import sys
import time
import urllib.request
from pathlib import Path as FilePath

FILE = "address.json"
"""Where a server says how to reach it; readable by its user alone."""
# Until a server that is not there, or has no person at its wheel, is asked again [s].
_QUIET = 0.25
# A server answers at the moment of the step; one that is stopped in between does not [s].
_PATIENCE = 10.0


class Relay:
    """Asks the server for each step, unless no person was there a moment ago."""

    def __init__(self, folder: FilePath) -> None:
        """The server of the file in the folder, which may come and go."""
        self._file, self._asked_again = folder / FILE, 0.0

    def answer(self, line: str) -> float | None:
        """Steering in [-1, 1] for a line of ``controller=process``; None: no person steers."""
        if time.monotonic() < self._asked_again:
            return None
        steer = None
        try:
            place = json.loads(self._file.read_text(encoding="utf-8"))
            request = urllib.request.Request(place["url"], line.encode(), place["headers"])
            with urllib.request.urlopen(request, timeout=_PATIENCE) as found:
                steer = json.loads(found.read())["steer"]
        except (OSError, ValueError, KeyError, TypeError):
            pass
        if steer is None:
            self._asked_again = time.monotonic() + _QUIET
        return steer


def main() -> None:
    """Answer line by line, to the end of the input."""
    relay = Relay(FilePath(sys.argv[1]))
    for line in sys.stdin:
        sys.stdout.write(json.dumps({"steer": relay.answer(line)}) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
