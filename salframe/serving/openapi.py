"""The OpenAPI description of bodies that the service reads itself, with examples."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from salframe.serving.problems import MEDIA_TYPE
from salframe.serving.schemas import DetectionsObservation, DetectionsQuery, ProblemBody, RouteQuery
from salframe.serving.uploads import FILES, JSON, MULTIPART, ObservationFields, UploadFields

_SCHEMAS = "#/components/schemas/"
_MODELS: tuple[type[BaseModel], ...] = (
    *(DetectionsQuery, DetectionsObservation, RouteQuery, UploadFields, ObservationFields, ProblemBody),
)
DETECTIONS = [
    {"label": "bed", "centroid_m": [1.6, 0.9, -1.2], "size_m": [2.0, 1.5, 0.6], "yaw_deg": 90},
    {"label": "desk", "centroid_m": [-1.2, 1.4, -1.0], "size_m": [1.4, 0.7, 0.8]},
    {"label": "lamp", "score": 0.8, "centroid_m": [-1.2, 1.5, -0.4], "size_m": [0.3, 0.3, 0.5]},
]
"""Detections of the examples."""


def _reference(model: type[BaseModel]) -> dict[str, str]:
    return {"$ref": f"{_SCHEMAS}{model.__name__}"}


def _body(fields: type[BaseModel] | None, content: type[BaseModel], example: Any) -> dict[str, Any]:
    """Return the description of a body: JSON, or an image with text fields."""
    kinds: dict[str, Any] = {JSON: {"schema": _reference(content), "example": example}}
    if fields is not None:
        files = {name: {"type": "string", "format": "binary"} for name in FILES}
        kinds[MULTIPART] = {"schema": {"allOf": [_reference(fields), {"type": "object", "properties": files}]}}
    return {"requestBody": {"required": True, "content": kinds}}


LOCALIZE = _body(UploadFields, DetectionsQuery, {"detections": DETECTIONS})
OBSERVATION = _body(
    ObservationFields,
    DetectionsObservation,
    {"detections": DETECTIONS, "t_s": 1.0, "odometry": {"x_m": 0.5, "yaw_deg": 10}},
)
ROUTE = _body(None, RouteQuery, {"start": {"place": "bedroom"}, "goal": {"place": "kitchen"}})
PROBLEMS: dict[int | str, dict[str, Any]] = {
    "default": {"description": "An error in one sentence", "content": {MEDIA_TYPE: {"schema": _reference(ProblemBody)}}}
}
MAP: dict[int | str, dict[str, Any]] = {200: {"content": {"application/geo+json": {"schema": {"type": "object"}}}}}
METRICS: dict[int | str, dict[str, Any]] = {200: {"content": {"text/plain": {"schema": {"type": "string"}}}}}


def add_schemas(app: FastAPI) -> None:
    """Add the schemas of bodies that the service reads itself to the OpenAPI description of an app."""
    generate = app.openapi

    def describe() -> dict[str, Any]:
        if app.openapi_schema is None:
            schema = generate()
            _, definitions = models_json_schema(
                [(model, "validation") for model in _MODELS], ref_template=_SCHEMAS + "{model}"
            )
            schema["components"]["schemas"] |= definitions["$defs"]
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = describe  # type: ignore[method-assign]
