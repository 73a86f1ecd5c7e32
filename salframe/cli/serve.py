"""The command `serve`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from salframe.cli.options import number_parser

MIN_TOKEN = 16
"""Minimum number of characters of a token."""


def serve(
    map: Annotated[Path, typer.Argument(metavar="MAP", help="Map folder that `salframe build` wrote")],
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS", help="Network address to listen on; a token is needed if other machines can reach it"
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int,
        typer.Option(
            parser=number_parser("--port", int, 0, 65535),
            metavar="PORT",
            help="Port to listen on, from 1 to 65535, or 0 for any free port",
        ),
    ] = 8360,
    token_file: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Text file with the token that requests must send, 16 characters or more"),
    ] = None,
    allow_origin: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ORIGIN",
            help="Allow requests from the web pages of a site, such as https://example.org; repeatable",
        ),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="LIMIT=VALUE",
            help="Change a limit of the server, such as max_sessions=10; see `salframe docs serve`",
        ),
    ] = None,
) -> None:
    """Serve a map over HTTP.

    Opens the map, then the port, and prints the address. Open this address in a browser, or send HTTP requests from a
    program. The page `/api` describes the requests. Requests must send a token if --token-file is set, or if --host is
    not a loopback address such as 127.0.0.1. If a token is needed and --token-file is not set, the server creates a
    token and prints it. After SIGTERM, the server finishes the requests in
    progress and exits.
    """
    import secrets
    from importlib.util import find_spec

    from salframe.cli.output import tell
    from salframe.framework.config import merge, parse_override
    from salframe.framework.errors import RequirementMissing
    from salframe.framework.overrides import nest
    from salframe.framework.validation import validate

    if missing := [
        name
        for name in ("fastapi", "uvicorn", "python_multipart", "websockets", "prometheus_client")
        if find_spec(name) is None
    ]:
        verb = "is" if len(missing) == 1 else "are"
        raise RequirementMissing(
            f"salframe serve needs {' and '.join(missing)}, which {verb} not installed: pip install 'salframe[serve]'"
        )
    from salframe.serving.access import is_loopback
    from salframe.serving.limits import ServiceLimits
    from salframe.serving.run import serve_map

    changed: dict[str, Any] = {}
    for text in overrides or ():
        changed = merge(changed, nest(*parse_override(text)))
    limits = validate(ServiceLimits, changed, "--set:")
    token = _read_token(token_file) if token_file is not None else None
    is_created = token is None and not is_loopback(host)
    if is_created:
        token = secrets.token_urlsafe(24)

    def tell_url(url: str) -> None:
        if is_created:
            tell(f"token: {token}")
        tell(f"serving {map} at {url}")

    serve_map(map, host, port, token=token, origins=allow_origin or (), limits=limits, tell_url=tell_url)


def _read_token(path: Path) -> str:
    """Return the token in a file.

    Raises:
        ConfigError: The file cannot be read, or its token is too short or has characters that a header cannot contain.
    """
    from salframe.framework.errors import ConfigError
    from salframe.framework.files.reading import read_text

    token = read_text(path, "a file with a token").strip()
    if len(token) < MIN_TOKEN or not (token.isascii() and token.isprintable()) or " " in token:
        raise ConfigError(
            f"the token in {path} has {len(token)} characters, expected one line with at least {MIN_TOKEN} ASCII "
            "characters and no spaces: create one with `openssl rand -hex 16`"
        )
    return token
