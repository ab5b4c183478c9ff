"""Showing the page on the loopback interface until Ctrl-C."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable
from pathlib import Path

import uvicorn

from percept.core.errors import UsageError
from percept.review.app import make_app
from percept.review.run import read_run
from percept.review.store import ReviewStore

__all__ = ["DECISIONS", "serve"]

DECISIONS = "review.sqlite"
"""Name of the file in the run folder that decisions are in."""

_LOOPBACK = "127.0.0.1"


def serve(folder: Path, *, port: int = 0, on_ready: Callable[[str], None]) -> None:
    """Show the page of a run until Ctrl-C; `review.sqlite` in it is all that is written.

    Args:
        folder: Run folder of `percept map validate`.
        port: Port to listen on; 0 for any that is free.
        on_ready: Gets the address, token included, when the page can be opened.

    Raises:
        InputError: If the folder holds no finished validation, or its decisions are damaged.
        UsageError: If the port is taken, or the decisions cannot be written.
    """
    run = read_run(folder)
    with ReviewStore(folder / DECISIONS) as store, _listening(port) as listener:
        token, taken = secrets.token_urlsafe(24), listener.getsockname()[1]
        app = make_app(run, store, token, port=taken)
        config = uvicorn.Config(
            app,
            lifespan="off",
            ws="none",
            access_log=False,
            log_level="warning",
            server_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=2,
        )
        address = f"http://{_LOOPBACK}:{taken}/?token={token}"
        try:
            _Server(config, lambda: on_ready(address)).run(sockets=[listener])
        except KeyboardInterrupt:  # uvicorn ends its work, and hands the signal on
            return


class _Server(uvicorn.Server):
    """Says that it is ready once it is: it listens, and Ctrl-C ends it in order."""

    def __init__(self, config: uvicorn.Config, on_ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_ready = on_ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self._on_ready()


def _listening(port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        # A port of which old connections are still fading is free again.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((_LOOPBACK, port))
        listener.listen(128)
    except OSError as error:
        listener.close()
        raise UsageError(
            f"port {port} cannot be used ({error.strerror})",
            remedy="Give another --port, or none for any that is free",
        ) from error
    return listener
