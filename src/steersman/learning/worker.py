"""One training in a process of its own: ``python -m steersman.learning.worker``.

Reads one line of JSON from its input (what to train), writes lines of JSON to its output (what
happens), and goes away when its input ends: with the process that started it.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from pathlib import Path as FilePath
from typing import Any

from steersman.errors import SteersmanError

_FAILED = 2
_LEFT = 130


def main() -> int:
    """Train what the first line of the input says; the exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started this one decides
    # Whatever else is printed must not mix with the messages.
    channel = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    request = json.loads(sys.stdin.buffer.readline())
    threading.Thread(target=_leave_when_alone, daemon=True).start()

    def send(**message: Any) -> None:
        channel.write(json.dumps(message) + "\n")
        channel.flush()

    from steersman.learning.config import train_config
    from steersman.learning.train import train

    try:
        train(
            train_config(request["config"]),
            FilePath(request["out"]),
            lambda row: send(steps=row.steps, row=row._asdict()),
            tick=lambda steps: send(steps=steps),
            notify=lambda text: send(note=text),
            overwrite=request["overwrite"],
            resume=request["resume"],
        )
    except SteersmanError as error:
        send(error=str(error))
        return _FAILED
    return 0


def _leave_when_alone() -> None:
    # Not through sys.stdin: its lock would still be held when the interpreter ends.
    if not os.read(0, 1):
        os._exit(_LEFT)


if __name__ == "__main__":
    sys.exit(main())
