"""The live page: the report's styles and player, and a script that sends what is chosen."""

from __future__ import annotations

import json
import shlex
from typing import Any, NamedTuple

from steersman.live.form import Choices
from steersman.report import web
from steersman.report.pack import packed

HOST = "127.0.0.1"
RECORDINGS = "runs/live"
"""Folder for what is driven by hand, unless another is given."""


class LiveAddress(NamedTuple):
    """Where a page is."""

    port: int
    token: str

    @property
    def url(self) -> str:
        """What a browser opens."""
        return f"http://{HOST}:{self.port}/?token={self.token}"


def live_page(
    first: Choices,
    offered: dict[str, Any],
    address: LiveAddress,
    training: str = "",
    recordings: str = RECORDINGS,
) -> str:
    """The page as text.

    Args:
        first: what is chosen at first.
        offered: of :func:`steersman.live.form.form`, and ``axes`` of the map of failures.
        address: port, and the token that its requests carry.
        training: folder of the training that is followed; empty: none.
        recordings: folder for what is driven by hand.
    """
    script = web.script("wheel", "live")
    given = {"form": offered, "first": first.model_dump(), "token": address.token}
    given["training"] = training
    again = ["steersman", "live", "--port", str(address.port), "--token", address.token]
    again += ["--training", training] if training else []
    again += ["--out", recordings] if recordings != RECORDINGS else []
    given["again"] = shlex.join(again)
    return web.template("live.html.j2").render(
        style=web.resource("page.css") + web.resource("live.css"),
        script=script,
        policy=f"{web.policy(script)}; connect-src 'self'",
        given=packed(json.dumps(given, allow_nan=False)),
    )
