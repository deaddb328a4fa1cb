"""The live page: the report's styles and player, and a script that sends what is chosen."""

from __future__ import annotations

import json
from typing import Any

from steersman.live.form import Choices
from steersman.report import web
from steersman.report.pack import packed


def live_page(first: Choices, offered: dict[str, Any], port: int, token: str) -> str:
    """The page as text.

    Args:
        first: what is chosen at first.
        offered: of :func:`steersman.live.form.form`.
        port: of the server.
        token: that its requests carry.
    """
    script = web.script("live")
    given = {"form": offered, "first": first.model_dump(), "token": token}
    given["again"] = f"steersman live --port {port} --token {token}"
    return web.template("live.html.j2").render(
        style=web.resource("page.css") + web.resource("live.css"),
        script=script,
        policy=f"{web.policy(script)}; connect-src 'self'",
        given=packed(json.dumps(given, allow_nan=False)),
    )
