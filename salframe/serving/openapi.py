"""OpenAPI schemas and examples of the request bodies that the service parses itself, without FastAPI."""

from __future__ import annotations

from typing import Any

import numpy as np
from fastapi import FastAPI
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from salframe.graphs.packing import GRAPH_ARRAYS, graph_from_arrays
from salframe.serving.problems import MEDIA_TYPE
from salframe.serving.schemas import DetectionsObservation, DetectionsQuery, ProblemBody, RouteQuery
from salframe.serving.served_map import ServedMap
from salframe.serving.uploads import FILES, JSON, MULTIPART, ObservationFields, UploadFields
from salframe.topology.geojson import find_places

_SCHEMAS = "#/components/schemas/"
_MODELS: tuple[type[BaseModel], ...] = (
    *(DetectionsQuery, DetectionsObservation, RouteQuery, UploadFields, ObservationFields, ProblemBody),
)
MAX_EXAMPLE_OBJECTS = 5
_DETECTIONS = [
    {"label": "bed", "centroid_m": [1.6, 0.9, -1.2], "size_m": [2.0, 1.5, 0.6], "yaw_deg": 90.0},
    {"label": "lamp", "score": 0.8, "centroid_m": [-1.2, 1.5, -0.4], "size_m": [0.3, 0.3, 0.5]},
]
"""Detections in the examples, if the map has no objects."""


def _reference(model: type[BaseModel]) -> dict[str, str]:
    return {"$ref": f"{_SCHEMAS}{model.__name__}"}


def _body(fields: type[BaseModel] | None, content: type[BaseModel]) -> dict[str, Any]:
    """Return the OpenAPI description of a request body.

    Args:
        fields: Model of the text fields of a multipart body with images; None: no multipart body is accepted.
        content: Model of a JSON body.
    """
    kinds: dict[str, Any] = {JSON: {"schema": _reference(content)}}
    if fields is not None:
        files = {name: {"type": "string", "format": "binary"} for name in FILES}
        kinds[MULTIPART] = {"schema": {"allOf": [_reference(fields), {"type": "object", "properties": files}]}}
    return {"requestBody": {"required": True, "content": kinds}}


LOCALIZE, OBSERVATION = _body(UploadFields, DetectionsQuery), _body(ObservationFields, DetectionsObservation)
ROUTE = _body(None, RouteQuery)
PROBLEMS: dict[int | str, dict[str, Any]] = {
    "default": {"description": "An error in one sentence", "content": {MEDIA_TYPE: {"schema": _reference(ProblemBody)}}}
}
MAP: dict[int | str, dict[str, Any]] = {200: {"content": {"application/geo+json": {"schema": {"type": "object"}}}}}
METRICS: dict[int | str, dict[str, Any]] = {200: {"content": {"text/plain": {"schema": {"type": "string"}}}}}


def add_schemas(app: FastAPI, served: ServedMap) -> None:
    """Add the schemas of request bodies that the service parses itself to the OpenAPI description of an app. Add
    examples from the map."""
    generate = app.openapi

    def describe() -> dict[str, Any]:
        if app.openapi_schema is None:
            schema = generate()
            _, definitions = models_json_schema(
                [(model, "validation") for model in _MODELS], ref_template=_SCHEMAS + "{model}"
            )
            schema["components"]["schemas"] |= definitions["$defs"]
            for path, example in _examples(served).items():
                schema["paths"][path]["post"]["requestBody"]["content"][JSON]["example"] = example
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = describe  # type: ignore[method-assign]


def _examples(served: ServedMap) -> dict[str, Any]:
    """Return an example of the JSON body for each path: objects of the first place of the map, and a route from the
    first place to the last place."""
    detections, first = _DETECTIONS, find_places(served.localization)
    names = list(first) or ["bedroom"]
    if first:
        _, description = served.localization.reference(first[names[0]].id)
        if description.keys() >= GRAPH_ARRAYS:
            graph = graph_from_arrays(description)
            detections = [
                {
                    "label": graph.labels[i],
                    "score": round(float(graph.scores[i]), 2),
                    "centroid_m": graph.centroid_m[i].round(2).tolist(),
                    "size_m": graph.size_m[i].round(2).tolist(),
                    "yaw_deg": round(float(np.degrees(graph.yaw_rad[i])), 1),
                }
                for i in range(min(MAX_EXAMPLE_OBJECTS, len(graph)))
            ]
    return {
        "/localize": {"detections": detections},
        "/sessions/{session_id}/observations": {
            "detections": detections,
            "t_s": 1.0,
            "odometry": {"x_m": 0.5, "yaw_deg": 10.0},
        },
        "/route": {"start": {"place": names[0]}, "goal": {"place": names[-1]}},
    }
