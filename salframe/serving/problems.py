"""Error responses as RFC 9457 problem details. Each error is one sentence, and contains no folders of the server."""

from __future__ import annotations

import logging
import re
import traceback
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse

from salframe.framework.errors import (
    ConfigError,
    DataError,
    InputMissing,
    NoRoute,
    SalframeError,
    UnknownName,
    one_line,
    shorten,
)

MEDIA_TYPE = "application/problem+json"
MAX_DETAIL = 600
"""Maximum number of characters of the detail (the error message) of a problem."""
_FOLDERS = re.compile(r"(?<![\w/.:])(?:~|\.{1,2})?/(?:[^\s/'\",;:()]+/)+|(?<!\w)[A-Za-z]:\\(?:[^\s\\'\",;:()]+\\)+")
"""Pattern of the folders in an absolute or relative path, before the name of the file."""
_DETAILS = {
    HTTPStatus.NOT_FOUND: "there is no such path: the page /api lists the paths of the service",
    HTTPStatus.METHOD_NOT_ALLOWED: "the path does not support this method: the page /api lists the methods",
}
"""Details of errors that FastAPI raises."""
_log = logging.getLogger("salframe.serving")


class Problem(Exception):
    """An error of one request.

    Attributes:
        status: HTTP status.
        detail: One sentence: what is wrong, the value received, and what was expected.
        retry_after_s: Time in seconds after which the client may try again; None: trying again does not help.
        headers: Additional headers of the response, including Retry-After.
    """

    def __init__(
        self,
        status: HTTPStatus,
        detail: str,
        *,
        retry_after_s: int | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.status, self.detail, self.retry_after_s = status, detail, retry_after_s
        self.headers = dict(headers or {})
        if retry_after_s is not None:
            self.headers["Retry-After"] = str(retry_after_s)


def problem_of(error: BaseException) -> Problem:
    """Convert an exception to a problem.

    The client receives the message of each SalframeError. All exceptions but errors in the input are written to the
    log. For an exception that is not a SalframeError, the client receives the status 500 without the message.
    """
    if isinstance(error, Problem):
        return error
    if isinstance(error, HTTPException):
        status = HTTPStatus(error.status_code)
        return Problem(status, _DETAILS.get(status, str(error.detail)), headers=error.headers)
    if isinstance(error, RequestValidationError):
        return Problem(HTTPStatus.UNPROCESSABLE_ENTITY, _invalid_parameters(error))
    if isinstance(error, NoRoute):
        return Problem(HTTPStatus.CONFLICT, str(error))
    if isinstance(error, DataError | InputMissing | ConfigError | UnknownName):
        return Problem(HTTPStatus.UNPROCESSABLE_ENTITY, str(error))
    if isinstance(error, MemoryError):
        detail = "the server is out of memory for this request: send a smaller image, or try again later"
        return Problem(HTTPStatus.SERVICE_UNAVAILABLE, detail, retry_after_s=10)
    if isinstance(error, ClientDisconnect):
        return Problem(HTTPStatus.BAD_REQUEST, "the client closed the connection before the end of the body")
    _log.error("%s", "".join(traceback.format_exception(error)).rstrip())
    if isinstance(error, SalframeError):
        return Problem(HTTPStatus.INTERNAL_SERVER_ERROR, str(error))
    return Problem(HTTPStatus.INTERNAL_SERVER_ERROR, "the server failed on this request: its log has the details")


def problem_json(problem: Problem) -> dict[str, Any]:
    """Return a problem as JSON, with the members of RFC 9457, section 3.1."""
    return {
        "type": "about:blank",
        "title": problem.status.phrase,
        "status": int(problem.status),
        "detail": hide_folders(problem.detail),
    }


def hide_folders(text: str) -> str:
    """Return a message as one line of limited length. Paths are shortened to the names of their files."""
    return shorten(_FOLDERS.sub("", one_line(text)), MAX_DETAIL)


def problem_response(error: BaseException) -> JSONResponse:
    """Return the HTTP response for an exception."""
    problem = problem_of(error)
    return JSONResponse(
        problem_json(problem), status_code=problem.status, headers=problem.headers, media_type=MEDIA_TYPE
    )


def add_problem_handlers(app: FastAPI) -> None:
    """Let an app answer every exception with a problem."""

    async def handle(request: Request, error: Exception) -> JSONResponse:
        return problem_response(error)

    for kind in (Problem, HTTPException, RequestValidationError, SalframeError, MemoryError, Exception):
        app.add_exception_handler(kind, handle)


def _invalid_parameters(error: RequestValidationError) -> str:
    """Describe the first invalid parameter in one sentence."""
    first = error.errors()[0]
    name = ".".join(str(part) for part in first["loc"][1:]) or str(first["loc"][0])
    return f"{name} is {shorten(repr(first.get('input')))}: {first['msg']}"
