"""Limits on the size of request bodies and on the time in which they must arrive."""

from __future__ import annotations

import asyncio
import time
from http import HTTPStatus

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from salframe.serving.limits import ServiceLimits
from salframe.serving.problems import Problem, problem_response


class BodyLimits:
    """Middleware that rejects request bodies that are too large, compressed, or sent too slowly."""

    def __init__(self, app: ASGIApp, limits: ServiceLimits) -> None:
        self._app, self._limits = app, limits

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        try:
            self._check_headers(Headers(scope=scope))
        except Problem as problem:
            await problem_response(problem)(scope, receive, send)
            return
        await self._app(scope, self._limited(receive), send)

    def _check_headers(self, headers: Headers) -> None:
        encoding = headers.get("content-encoding", "identity")
        if encoding.lower() != "identity":
            raise Problem(
                HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
                f"the header Content-Encoding is {encoding!r}, expected a request body without compression",
            )
        length = headers.get("content-length", "0")
        if length.isdecimal() and int(length[:20]) > self._limits.max_body_bytes:
            raise self._too_large(length)

    def _too_large(self, received: object) -> Problem:
        return Problem(
            HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
            f"the request body has {received} bytes, expected at most {self._limits.max_body_bytes}: reduce the images",
        )

    def _limited(self, receive: Receive) -> Receive:
        end_s, num_bytes, is_complete = time.monotonic() + self._limits.body_s, 0, False

        async def receive_limited() -> Message:
            nonlocal num_bytes, is_complete
            if is_complete:
                return await receive()
            try:
                message = await asyncio.wait_for(receive(), max(0.0, end_s - time.monotonic()))
            except TimeoutError:
                is_complete = True
                raise Problem(
                    HTTPStatus.REQUEST_TIMEOUT,
                    f"the request body did not arrive within the time limit of {self._limits.body_s:g} s: send smaller "
                    "images",
                    headers={"Connection": "close"},
                ) from None
            num_bytes += len(message.get("body", b""))
            is_complete = not message.get("more_body", False)
            if num_bytes > self._limits.max_body_bytes:
                is_complete = True
                raise self._too_large(f"more than {self._limits.max_body_bytes}")
            return message

        return receive_limited
