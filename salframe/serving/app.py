"""The HTTP interface of the service: its paths and their handlers."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from fastapi import FastAPI, Query, Request, Response, WebSocket
from fastapi.staticfiles import StaticFiles
from starlette.datastructures import FormData
from starlette.middleware.cors import CORSMiddleware
from starlette.responses import FileResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from salframe.framework.errors import DataError
from salframe.framework.version import __version__
from salframe.localization.answers import Localization
from salframe.panoramas.geometry import pose_2d
from salframe.serving import openapi
from salframe.serving.access import PUBLIC_FOLDER, AccessMiddleware, AccessRules
from salframe.serving.bodies import BodyLimits
from salframe.serving.limits import ServiceLimits
from salframe.serving.localizing import ServedView, describe_answer, describe_view, localize_view
from salframe.serving.metrics import METRICS_TYPE, ServiceMetrics
from salframe.serving.problems import Problem, add_problem_handlers, problem_response
from salframe.serving.routing import plan_route
from salframe.serving.schemas import (
    AnswerBody,
    BeliefBody,
    DetectionsObservation,
    DetectionsQuery,
    HealthBody,
    Motion,
    ObservationBody,
    RouteBody,
    RouteQuery,
    SessionBody,
)
from salframe.serving.served_map import MapHolder, ServedMap
from salframe.serving.sessions import Session, SessionStore
from salframe.serving.streams import stream_belief
from salframe.serving.uploads import (
    MULTIPART,
    ObservationFields,
    ServedQuery,
    UploadFields,
    content_type,
    open_upload,
    read_form,
    read_json_body,
    to_detections,
)
from salframe.serving.work import WorkPool

PAGE = Path(__file__).with_name("page")
REFRESH_S = 1.0
"""Interval in seconds at which the service checks whether the map has changed and whether sessions are idle."""
_Result = TypeVar("_Result")
_Fields = TypeVar("_Fields", bound=UploadFields)
WithObjects = Annotated[bool, Query(description="list the objects of the query and those that they were matched with")]
WithPicture = Annotated[bool, Query(description="return the image as the server placed it")]


class Service:
    """The state of the service: the map, the pool of worker threads, the sessions and the metrics."""

    def __init__(self, maps: MapHolder, limits: ServiceLimits, rules: AccessRules) -> None:
        self.maps, self.limits, self.rules = maps, limits, rules
        self.pool, self._num_uploads = WorkPool(limits), 0
        self.sessions = SessionStore(limits)
        self.metrics = ServiceMetrics(
            lambda: self.pool.num_pending, lambda: len(self.sessions), lambda: self.maps.num_reloads
        )

    async def run(self, call: Callable[[ServedMap], _Result]) -> _Result:
        """Run a call with the current map in a thread of the pool, and return its result.

        If the call fails because the files of the map changed during the call, it is repeated with the new version of
        the map.
        """
        return await self.pool.run(partial(self._with_map, call))

    def _with_map(self, call: Callable[[ServedMap], _Result]) -> _Result:
        served = self.maps.current
        try:
            return call(served)
        except DataError:
            if not self.maps.has_changed(served) or (newer := self.maps.refresh()) is served:
                raise
            return call(newer)

    @asynccontextmanager
    async def upload(self, request: Request, model: type[_Fields]) -> AsyncIterator[tuple[_Fields, FormData]]:
        """Receive a multipart body, and remove its files at the end. Raises Problem 503 if too many bodies are received
        at the same time."""
        if self._num_uploads >= self.limits.max_uploads:
            raise Problem(
                HTTPStatus.SERVICE_UNAVAILABLE,
                f"the server already receives {self._num_uploads} images, the maximum number: try again later",
                retry_after_s=1,
            )
        self._num_uploads += 1
        try:
            fields, form = await read_form(request, model)
            try:
                yield fields, form
            finally:
                await form.close()
        finally:
            self._num_uploads -= 1

    async def localize(
        self,
        read: Callable[[], ServedQuery],
        objects: bool,
        picture: bool,
        answer_view: Callable[[ServedMap, ServedView], Localization] | None = None,
    ) -> dict[str, Any]:
        """Return the answer to a query as JSON.

        Args:
            read: Function that reads the query. It is called in a thread of the pool.
            objects: As `with_objects` in `describe_answer`.
            picture: As `with_picture` in `describe_answer`.
            answer_view: Function that returns the answer to a query from its description; None: `localize_view`.
        """

        def localize(served: ServedMap) -> dict[str, Any]:
            start = time.perf_counter()
            view = describe_view(served.localization, read())
            answer = localize_view(served.localization, view) if answer_view is None else answer_view(served, view)
            seconds = time.perf_counter() - start
            return describe_answer(served, view, answer, seconds, with_objects=objects, with_picture=picture)

        content = await self.run(localize)
        self.metrics.localize_s.observe(content["seconds"])
        self.metrics.answers.labels(content["status"]).inc()
        return content

    async def watch(self) -> None:
        """Run forever: open the map again when its files change, and end idle sessions."""
        while True:
            await asyncio.sleep(REFRESH_S)
            self.sessions.expire()
            await asyncio.to_thread(self.maps.refresh)


def create_app(maps: MapHolder, limits: ServiceLimits, rules: AccessRules) -> ASGIApp:
    """Return the app of a service.

    Args:
        maps: The open map.
        limits: The limits of the service.
        rules: The access rules of the service.
    """
    service = Service(maps, limits, rules)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        watch = asyncio.create_task(service.watch())
        yield
        watch.cancel()
        with suppress(asyncio.CancelledError):
            await watch
        service.sessions.close()
        await asyncio.to_thread(service.pool.close)

    app = FastAPI(
        title="salframe",
        version=__version__,
        summary="Localizes panoramas, photographs and detections in a map",
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
        responses=openapi.PROBLEMS,
    )
    add_problem_handlers(app)
    _add_queries(app, service)
    _add_sessions(app, service)
    _add_map(app, service)
    app.mount(PUBLIC_FOLDER.rstrip("/"), StaticFiles(directory=PAGE))
    openapi.add_schemas(app, maps.current)
    layered: ASGIApp = AccessMiddleware(BodyLimits(app, limits), rules)
    if rules.origins:
        layered = CORSMiddleware(
            layered,
            allow_origins=rules.origins,
            allow_methods=["GET", "POST", "DELETE"],
            allow_headers=["Authorization", "Content-Type"],
        )
    return MetricsMiddleware(layered, service.metrics)


def _add_queries(app: FastAPI, service: Service) -> None:
    limits = service.limits

    @app.post("/localize", response_model=AnswerBody, openapi_extra=openapi.LOCALIZE)
    async def localize(request: Request, objects: WithObjects = False, picture: WithPicture = False) -> Any:
        """Localize a panorama, a photograph, or detections."""
        service.pool.check_room()
        if content_type(request) == MULTIPART:
            async with service.upload(request, UploadFields) as (fields, form):
                return await service.localize(partial(open_upload, fields, form, limits), objects, picture)
        body = await read_json_body(request, DetectionsQuery, limits)
        return await service.localize(partial(to_detections, body.detections, limits), objects, picture)

    @app.post("/route", response_model=RouteBody, openapi_extra=openapi.ROUTE)
    async def route(request: Request) -> Any:
        """Plan the shortest route from a pose, a place or a reference frame to a place or a point."""
        body = await read_json_body(request, RouteQuery, limits)
        return await service.run(partial(plan_route, start=body.start, goal=body.goal))


def _add_sessions(app: FastAPI, service: Service) -> None:
    limits, sessions = service.limits, service.sessions

    @app.post("/sessions", response_model=SessionBody, status_code=201)
    async def create_session() -> Any:
        """Create a session, which follows one robot."""
        return SessionBody(id=sessions.create(service.maps.current).id, idle_s=limits.idle_s)

    @app.post("/sessions/{session_id}/observations", response_model=ObservationBody, openapi_extra=openapi.OBSERVATION)
    async def observe(
        session_id: str, request: Request, objects: WithObjects = False, picture: WithPicture = False
    ) -> Any:
        """Add a view and the motion since the previous one. An error leaves the session as it was."""
        session = sessions.get(session_id)
        service.pool.check_room()
        if content_type(request) == MULTIPART:
            async with service.upload(request, ObservationFields) as (fields, form):
                return await apply(session, partial(open_upload, fields, form, limits), fields, objects, picture)
        body = await read_json_body(request, DetectionsObservation, limits)
        return await apply(session, partial(to_detections, body.detections, limits), body, objects, picture)

    async def apply(
        session: Session,
        read: Callable[[], ServedQuery],
        sent: ObservationFields | DetectionsObservation,
        objects: bool,
        picture: bool,
    ) -> dict[str, Any]:
        odometry = None if sent.odometry is None else _matrix(sent.odometry)
        async with session.lock:
            session.check_time(sent.t_s)
            answer = partial(session.observe, t_s=sent.t_s, odometry=odometry)
            content = await service.localize(read, objects, picture, answer)
            session.notify()
            return {"answer": content, "belief": session.belief}

    @app.get("/sessions/{session_id}", response_model=BeliefBody)
    async def belief(session_id: str) -> Any:
        """Return the belief of a session."""
        return sessions.get(session_id).belief

    @app.delete("/sessions/{session_id}", status_code=204)
    async def end_session(session_id: str) -> Response:
        """End a session."""
        sessions.end(session_id)
        return Response(status_code=204)

    @app.websocket("/sessions/{session_id}/stream")
    async def stream(socket: WebSocket, session_id: str) -> None:
        await stream_belief(socket, session_id, sessions, service.rules, limits)


def _add_map(app: FastAPI, service: Service) -> None:
    @app.get("/map", response_class=Response, responses=openapi.MAP)
    async def map(request: Request) -> Response:
        """Return places, floors, objects, nodes and edges of the map as GeoJSON, in metres of its world frame."""
        served = service.maps.current
        headers = {"ETag": f'"{served.version}"', "Cache-Control": "no-cache"}
        if request.headers.get("if-none-match") == headers["ETag"]:
            return Response(status_code=304, headers=headers)
        return Response(served.json, headers=headers, media_type="application/geo+json")

    @app.get("/health", response_model=HealthBody)
    async def health() -> Any:
        """Return whether the service runs."""
        return HealthBody(status="ok" if service.maps.failure is None else "stale", version=__version__)

    @app.get("/metrics", response_class=Response, responses=openapi.METRICS)
    async def metrics() -> Response:
        """Return the metrics in the text format of Prometheus."""
        return Response(service.metrics.text(), media_type=METRICS_TYPE)

    @app.get("/", include_in_schema=False)
    async def page() -> FileResponse:
        return FileResponse(PAGE / "index.html")

    @app.get("/api", include_in_schema=False)
    async def api_page() -> FileResponse:
        return FileResponse(PAGE / "api.html")


class MetricsMiddleware:
    """Middleware that counts requests, measures their time, and catches the exceptions of the app.

    When the app raises an exception, its handlers have usually sent a response already. If the exception reached the
    server, the server would close the connection, and later requests on this connection would fail.
    """

    def __init__(self, app: ASGIApp, metrics: ServiceMetrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        start, status, is_answered = time.perf_counter(), 500, False

        async def send_noted(message: Message) -> None:
            nonlocal status, is_answered
            if message["type"] == "http.response.start":
                status, is_answered = message["status"], True
            await send(message)

        try:
            await self._app(scope, receive, send_noted)
        except Exception as error:
            if not is_answered:
                await problem_response(error)(scope, receive, send_noted)
        finally:
            path = getattr(scope.get("route"), "path", "other")  # the template, to limit the number of labels
            self._metrics.requests.labels(path, _method(scope["method"]), str(status)).inc()
            self._metrics.request_s.labels(path).observe(time.perf_counter() - start)


def _matrix(motion: Motion) -> np.ndarray:
    """Return a motion as a matrix (4, 4): the pose after the motion, in the frame before the motion."""
    return pose_2d(motion.x_m, motion.y_m, float(np.radians(motion.yaw_deg)), motion.z_m)


def _method(name: str) -> str:
    return name if name in ("GET", "HEAD", "POST", "DELETE", "OPTIONS") else "other"
