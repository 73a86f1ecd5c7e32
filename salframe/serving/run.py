"""Run the service: open the map, open the port, and finish all requests before the end."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from salframe.framework.errors import ConfigError
from salframe.serving.access import AccessRules
from salframe.serving.app import create_app
from salframe.serving.limits import ServiceLimits
from salframe.serving.served_map import MapHolder
from salframe.serving.streams import MAX_MESSAGE_BYTES

MAX_HEADER_BYTES = 1 << 14
"""Maximum size of the headers of a request, in bytes."""
MAX_WAITING_CONNECTIONS = 1024
"""Maximum number of connections that wait to be accepted (the backlog of the socket)."""


def serve_map(
    folder: Path,
    host: str,
    port: int,
    *,
    token: str | None = None,
    origins: Sequence[str] = (),
    limits: ServiceLimits | None = None,
    tell_url: Callable[[str], object],
) -> None:
    """Serve a map until SIGTERM or an interrupt. Requests in progress are finished first.

    Args:
        folder: The map folder.
        host: Address to listen on.
        port: Port to listen on; 0: a free port.
        token: Token that requests must send; None: no token is needed.
        origins: Origins of other sites whose pages may use the service.
        limits: The limits of the service; None: the default limits.
        tell_url: Called with the URL of the service after the port was opened.

    Raises:
        DataError: The folder contains no map that can localize.
        ConfigError: The address cannot be used.
    """
    limits = limits or ServiceLimits()
    maps = MapHolder(folder)
    with listen(host, port) as listener:
        server = make_server(maps, limits, AccessRules.of_address(host, token, origins))
        tell_url(_url(host, listener.getsockname()[1]))
        try:
            server.run(sockets=[listener])
        except KeyboardInterrupt:  # uvicorn raises the signal again after it has finished all requests
            return


def make_server(maps: MapHolder, limits: ServiceLimits, rules: AccessRules) -> uvicorn.Server:
    """Return a server of a map. Start it with `run(sockets=...)`. It runs until its attribute `should_exit` is True."""
    config = uvicorn.Config(
        create_app(maps, limits, rules),
        http=_timed_protocol(limits.headers_s),
        ws_max_size=MAX_MESSAGE_BYTES,
        log_config=None,
        access_log=False,
        lifespan="on",
        server_header=False,
        proxy_headers=False,
        limit_concurrency=limits.max_connections,
        h11_max_incomplete_event_size=MAX_HEADER_BYTES,
        timeout_graceful_shutdown=limits.drain_s,
    )
    return uvicorn.Server(config)


def listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens on an address.

    Raises:
        ConfigError: The address cannot be used.
    """
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        # Nagle's algorithm would delay answers by 40 ms. asyncio disables it only for sockets with this protocol.
        listener = socket.socket(family, kind, socket.IPPROTO_TCP)
        try:
            if os.name == "posix":
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
            listener.listen(MAX_WAITING_CONNECTIONS)
        except BaseException:
            listener.close()
            raise
        return listener
    except (OSError, OverflowError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(
            f"cannot listen on {host} port {port}: {reason}, expected an address of this machine and a free port"
        ) from None


def _url(host: str, port: int) -> str:
    name = f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}"


def _timed_protocol(headers_s: float) -> type[H11Protocol]:
    """Return a protocol class that closes a connection if the headers of a request do not arrive in time."""

    class TimedProtocol(H11Protocol):
        _timer: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            self._update_timer()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            self._update_timer()

        def connection_lost(self, exc: Exception | None) -> None:
            self._stop_timer()
            super().connection_lost(exc)

        def _update_timer(self) -> None:
            is_waiting = self.cycle is None or (self.cycle.response_complete and self.timeout_keep_alive_task is None)
            if not is_waiting or self.transport.is_closing():
                self._stop_timer()
            elif self._timer is None:
                self._timer = self.loop.call_later(headers_s, self.timeout_keep_alive_handler)

        def _stop_timer(self) -> None:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None

    return TimedProtocol
