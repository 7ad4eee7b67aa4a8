"""An HTTP server that closes connections which send no request, and ends with its process."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from atw_mcp.transports.ending import ending_in_order
from atw_mcp.transports.limits import HTTP_LIMITS, HttpLimits


class TimedProtocol(H11Protocol):
    """HTTP/1.1 of uvicorn, with a time limit for the headers of a request, which uvicorn lacks."""

    header_seconds = HTTP_LIMITS.header_seconds
    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Expect a request."""
        super().connection_made(transport)
        self._time_headers()

    def data_received(self, data: bytes) -> None:
        """Read on; the time of a request's headers runs from their first byte to their last."""
        super().data_received(data)
        self._time_headers()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(exc)

    def _time_headers(self) -> None:
        waiting = self.cycle is None or self.cycle.response_complete
        if not waiting and self._timer is not None:
            self._timer.cancel()
            self._timer = None
        elif waiting and self._timer is None:
            self._timer = self.loop.call_later(self.header_seconds, self._give_up)

    def _give_up(self) -> None:
        self._timer = None
        if self.cycle is None or self.cycle.response_complete:
            self.transport.close()


class WebServer(uvicorn.Server):
    """uvicorn without signal handlers of its own, ending streams that are still open without a log entry each."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals to `ending_in_order`."""
        yield

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End; uvicorn reports every stream that it cancels here as an error with a traceback."""
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        await super().shutdown(sockets)


def web_server(app: ASGIApp, limits: HttpLimits = HTTP_LIMITS) -> WebServer:
    """Return a server of an ASGI application with every limit set, to be run on a socket."""
    protocol = type("Protocol", (TimedProtocol,), {"header_seconds": limits.header_seconds})
    return WebServer(
        uvicorn.Config(
            app,
            http=protocol,
            ws="none",
            lifespan="on",
            log_level="warning",
            access_log=False,
            server_header=False,
            proxy_headers=False,  # nothing here reads the address of a client
            limit_concurrency=limits.connections,
            timeout_keep_alive=limits.keep_alive_seconds,
            timeout_graceful_shutdown=limits.graceful_seconds,
            h11_max_incomplete_event_size=limits.header_bytes,
        )
    )


def serve_web(
    app: ASGIApp, listening: socket.socket, last_resort: Callable[[], None], limits: HttpLimits = HTTP_LIMITS
) -> int:
    """Serve until a signal ends the process; returns the exit code. last_resort: as of `Ending`."""
    server = web_server(app, limits)

    def stop() -> None:
        server.should_exit = True

    with ending_in_order(stop, limits.shutdown_seconds) as ending:
        ending.last_resort = last_resort
        server.run(sockets=[listening])
    return ending.exit_code
