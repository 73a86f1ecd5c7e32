"""Access rules of the service: accepted host names, accepted origins of web pages, and a token."""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from salframe.serving.problems import Problem, problem_response

SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}
"""Headers of every response. They forbid other sites to embed the page, and forbid the page to load anything from other
sites."""
PUBLIC_FOLDER = "/page/"
PUBLIC_PATHS = ("/", "/api", "/health", "/favicon.ico")
"""Paths that need no token: the static pages, and the state of the service. They contain no data of the map."""
_LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")


def is_loopback(host: str) -> bool:
    """Return whether a host name or address can only be reached from this machine."""
    if host in _LOOPBACK_NAMES:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class AccessRules:
    """Access rules of the service.

    Attributes:
        token: Token that requests must send; None: no token is needed.
        hosts: Accepted names in the header Host; empty: all names are accepted. On a loopback address, this check
            prevents other sites from reaching the service by DNS rebinding.
        origins: Origins of other sites whose pages may use the service.
    """

    token: str | None = None
    hosts: tuple[str, ...] = ()
    origins: tuple[str, ...] = ()

    @classmethod
    def of_address(cls, host: str, token: str | None, origins: Sequence[str]) -> AccessRules:
        """Return the rules of a service that listens on the address `host`. If it is a loopback address, only loopback
        names are accepted in the header Host."""
        hosts = tuple(dict.fromkeys((host, *_LOOPBACK_NAMES))) if is_loopback(host) else ()
        return cls(token, hosts, tuple(origins))

    def accepts_token(self, token: object) -> bool:
        """Return whether a token is correct, or no token is needed. The comparison takes the same time for every
        token."""
        if self.token is None:
            return True
        received = token.encode("utf-8", "surrogatepass") if isinstance(token, str) else b""
        return hmac.compare_digest(received, self.token.encode())

    def accepts_header(self, headers: Headers) -> bool:
        """Return whether the header Authorization has the correct token, or no token is needed."""
        kind, _, token = headers.get("authorization", "").partition(" ")
        return self.accepts_token(token.strip() if kind.lower() == "bearer" else None)

    def check(self, headers: Headers, path: str, *, is_websocket: bool) -> None:
        """Check the headers of a request.

        A WebSocket may send its token in its first message, because browsers cannot set its headers.

        Raises:
            Problem: 403 for a wrong host or origin, 401 for a wrong token.
        """
        host = headers.get("host", "")
        if self.hosts and _host_name(host) not in self.hosts:
            raise Problem(
                HTTPStatus.FORBIDDEN,
                f"the header Host is {host!r}, expected one of {', '.join(self.hosts)}: use the address that the "
                "server printed",
            )
        origin = headers.get("origin")
        if origin is not None and origin not in self.origins and (urlsplit(origin).netloc or None) != host:
            raise Problem(
                HTTPStatus.FORBIDDEN,
                f"the header Origin is {origin!r}, which the server does not allow: start the server with "
                f"--allow-origin {origin}",
            )
        is_public = path in PUBLIC_PATHS or path.startswith(PUBLIC_FOLDER)
        if not (is_public or is_websocket or self.accepts_header(headers)):
            raise Problem(
                HTTPStatus.UNAUTHORIZED,
                "the token is missing or wrong, expected the header `Authorization: Bearer TOKEN` with the token of "
                "the server",
                headers={"WWW-Authenticate": "Bearer"},
            )


class AccessMiddleware:
    """Middleware that applies the access rules, and adds SECURITY_HEADERS to each response."""

    def __init__(self, app: ASGIApp, rules: AccessRules) -> None:
        self._app, self._rules = app, rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        is_websocket = scope["type"] == "websocket"

        async def send_secured(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                headers = MutableHeaders(scope=message)
                headers.update(SECURITY_HEADERS)
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        try:
            self._rules.check(Headers(scope=scope), scope["path"], is_websocket=is_websocket)
        except Problem as problem:
            if is_websocket:
                await receive()
                await send({"type": "websocket.close", "code": 1008})  # closed before it is accepted: HTTP status 403
            else:
                await problem_response(problem)(scope, receive, send_secured)
            return
        await self._app(scope, receive, send if is_websocket else send_secured)


def _host_name(host: str) -> str:
    """Return the name in a header Host, without port and brackets."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
