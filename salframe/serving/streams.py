"""WebSockets that stream the belief (estimated pose and status) of a session."""

from __future__ import annotations

import asyncio
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from salframe.framework.files.bounded import parse_json
from salframe.serving.access import AccessRules
from salframe.serving.limits import ServiceLimits
from salframe.serving.problems import Problem
from salframe.serving.sessions import Session, SessionStore

MAX_MESSAGE_BYTES = 4096
"""Maximum size of a message from a client, in bytes."""
TOKEN_S = 5.0
"""Maximum time in which a client must send the token, in seconds."""
POLICY, TRY_AGAIN, GOING_AWAY = 1008, 1013, 1001
"""Close codes of RFC 6455, section 7.4, and of the IANA registry."""


async def stream_belief(
    socket: WebSocket, session_id: str, sessions: SessionStore, rules: AccessRules, limits: ServiceLimits
) -> None:
    """Send the belief of a session as JSON, once at the start and after each observation.

    If a client cannot set the header Authorization, it sends the token in its first message: {"token": "..."}.

    Args:
        socket: The WebSocket.
        session_id: Id of the session.
        sessions: The sessions of the service.
        rules: The access rules of the service.
        limits: The limits of the service.
    """
    await socket.accept()
    try:
        if not (rules.accepts_header(socket.headers) or await _sends_token(socket, rules)):
            await socket.close(POLICY, 'the token is missing or wrong, expected the first message {"token": "TOKEN"}')
            return
        try:
            session = sessions.get(session_id)
        except Problem as problem:
            await socket.close(POLICY, problem.detail.partition(":")[0])
            return
        if len(session.listeners) >= limits.max_listeners:
            await socket.close(
                TRY_AGAIN, f"the session has {len(session.listeners)} open WebSockets, the maximum number: close one"
            )
            return
        await _send_beliefs(socket, session)
    except WebSocketDisconnect:
        return


async def _sends_token(socket: WebSocket, rules: AccessRules) -> bool:
    try:
        message = parse_json((await asyncio.wait_for(socket.receive_text(), TOKEN_S)).encode())
    except (TimeoutError, ValueError, KeyError, RecursionError):  # KeyError: the message is binary
        return False
    return isinstance(message, dict) and rules.accepts_token(message.get("token"))


async def _send_beliefs(socket: WebSocket, session: Session) -> None:
    """Send beliefs until the session or the connection ends."""
    latest: asyncio.Queue[dict[str, Any] | None] = asyncio.Queue(maxsize=1)
    session.listeners.add(latest)
    closed = asyncio.create_task(_wait_until_closed(socket))
    try:
        await socket.send_json(session.belief)
        while True:
            next_belief = asyncio.create_task(latest.get())
            done, _ = await asyncio.wait({next_belief, closed}, return_when=asyncio.FIRST_COMPLETED)
            if next_belief not in done:
                next_belief.cancel()
                return
            belief = next_belief.result()
            if belief is None:
                await socket.close(GOING_AWAY, "the session has ended")
                return
            await socket.send_json(belief)
    finally:
        session.listeners.discard(latest)
        closed.cancel()


async def _wait_until_closed(socket: WebSocket) -> None:
    """Read and ignore messages until the client closes the connection."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass
