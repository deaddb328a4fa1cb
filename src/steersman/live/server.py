"""The server of a live page: on this machine alone, for those who have the token.

Each request needs the token; a request that a page of another origin sent is refused, and so is
one that names another host (a name that was made to point here).
"""

from __future__ import annotations

import json
import os
import secrets
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter, ValidationError

from steersman.errors import PlantError, SteersmanError, how_to_install
from steersman.files import make_folder
from steersman.live import relay
from steersman.live.demonstrating import TrainingQuestion, TrainingWheel
from steersman.live.drives import DriveCache, LiveRun
from steersman.live.failure_map import MapRequest, axes, map_cells
from steersman.live.form import chosen, form
from steersman.live.page import HOST, RECORDINGS, LiveAddress, live_page
from steersman.live.training import FollowedTraining, TrainingRequest
from steersman.live.wheel import WheelDrive, WheelInput
from steersman.rollout import RunConfig

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request

TOKEN = "x-steersman-token"
"""The header that carries the token; the page's address has it as ``token``."""
MOST_RUNS = 8
"""Runs side by side."""
MOST_BYTES = 1_000_000
"""Of a request."""
_REFUSED, _NOT_ALLOWED, _TOO_LARGE = 403, 422, 413


def new_token() -> str:
    """A random token of the page's address."""
    return secrets.token_urlsafe(18)


def live_app(
    base: RunConfig,
    address: LiveAddress,
    recordings: str = RECORDINGS,
    training: FilePath | None = None,
) -> Starlette:
    """The application.

    Args:
        base: what the page shows first.
        address: port and token.
        recordings: folder for what is driven by hand.
        training: folder of a training that the page follows.

    Raises:
        SteersmanError: the extra ``live`` is not installed.
    """
    require()
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.middleware.base import BaseHTTPMiddleware
    from starlette.responses import HTMLResponse, JSONResponse, Response
    from starlette.routing import Route

    own = f"http://{HOST}:{address.port}"

    async def guard(request: Request, call_next: Any) -> Response:
        given = request.headers.get(TOKEN) or request.query_params.get("token", "")
        host = request.headers.get("host", "")
        origin = request.headers.get("origin", own)
        if host != f"{HOST}:{address.port}" or origin != own:
            return Response("refused: another host or origin\n", _REFUSED)
        if not secrets.compare_digest(given.encode(), address.token.encode()):
            return Response("refused: the token in the address is missing or wrong\n", _REFUSED)
        if int(request.headers.get("content-length", "0") or 0) > MOST_BYTES:
            return Response("refused: too large\n", _TOO_LARGE)
        found: Response = await call_next(request)
        found.headers["Cache-Control"] = "no-store"
        found.headers["Referrer-Policy"] = "no-referrer"
        found.headers["X-Frame-Options"] = "DENY"
        return found

    def page(_: Request) -> Response:
        offered = {**form(base), "axes": axes()}
        return HTMLResponse(
            live_page(chosen(base), offered, address, str(training or ""), recordings)
        )

    def alive(_: Request) -> Response:
        return JSONResponse({"alive": True})

    answers = _answers(base, recordings, training)
    posts = [
        Route(place, partial(_answered, cls=cls, answer=answer), methods=["POST"])
        for place, (cls, answer) in answers.items()
    ]
    return Starlette(
        routes=[Route("/", page), Route("/alive", alive), *posts],
        middleware=[Middleware(BaseHTTPMiddleware, dispatch=guard)],
    )


def _answers(
    base: RunConfig, recordings: str, training: FilePath | None
) -> dict[str, tuple[Any, Callable[[Any], dict[str, Any]]]]:
    """What is asked for at each place, and the function that answers."""
    cache, wheel = DriveCache(base), WheelDrive(base, recordings)
    out: dict[str, tuple[Any, Callable[[Any], dict[str, Any]]]] = {
        "/drive": (list[LiveRun], lambda runs: cache.answer(runs[:MOST_RUNS])),
        "/map": (MapRequest, partial(map_cells, base)),
        "/wheel": (WheelInput, wheel.answer),
    }
    if training is not None:
        shown = TrainingWheel()
        out["/demonstrate"], out["/ask"] = (WheelInput, shown.answer), (TrainingQuestion, shown.ask)
        out["/training"] = TrainingRequest, FollowedTraining(training).answer
    return out


async def _answered(request: Request, cls: Any, answer: Any) -> Any:
    """The answer to a request, in a thread of its own; an error of the user is one line."""
    from starlette.concurrency import run_in_threadpool
    from starlette.responses import JSONResponse

    try:
        given = TypeAdapter(cls).validate_json(await request.body())
        return JSONResponse(await run_in_threadpool(answer, given))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        return JSONResponse({"error": f"{where}: {first['msg']}"}, _NOT_ALLOWED)
    except (SteersmanError, PlantError) as error:
        return JSONResponse({"error": str(error)}, _NOT_ALLOWED)


def require() -> None:
    """Check that the server can run.

    Raises:
        SteersmanError: the extra ``live`` is not installed.
    """
    try:
        import jinja2
        import starlette
        import uvicorn
    except ModuleNotFoundError:
        raise SteersmanError(f"the live page needs {how_to_install('live')}") from None
    _ = jinja2, starlette, uvicorn


def free_port(port: int) -> int:
    """The port, or for 0 one that is free now.

    Raises:
        SteersmanError: it is taken.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise SteersmanError(
                f"--port: {port} is taken ({error.strerror}); 0 takes a free one"
            ) from None
        return int(probe.getsockname()[1])


def serve(
    base: RunConfig, address: LiveAddress, recordings: str, training: FilePath | None = None
) -> None:
    """Serve the page until Ctrl-C."""
    app = live_app(base, address, recordings, training)
    import uvicorn

    with reachable(address, FilePath(recordings)) if training is not None else nullcontext():
        uvicorn.run(app, host=HOST, port=address.port, log_level="warning", ws="none")


@contextmanager
def reachable(address: LiveAddress, folder: FilePath) -> Iterator[None]:
    """Leave in a folder how :mod:`steersman.live.relay` reaches this server, while it runs.

    Raises:
        DataError: the folder cannot be written.
    """
    file = make_folder(folder) / relay.FILE
    place = {"url": f"http://{HOST}:{address.port}/ask", "headers": {TOKEN: address.token}}
    file.unlink(missing_ok=True)
    with os.fdopen(os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "w") as stream:
        json.dump(place, stream)  # the token is private
    try:
        yield
    finally:
        file.unlink(missing_ok=True)
