"""The places of a map with their frames and objects as JSON, and the schema of this file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from salframe.framework.files.writing import write_json
from salframe.graphs.graph import SaliencyGraph
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_yaw, transform_points
from salframe.topology.geojson import graph_of_reference

CONVENTIONS = (
    "World frame of the map: x, y, z in metres, z up, right-handed. Poses map camera coordinates to the world; the "
    "camera looks along its x axis, y is to the left, z up. Quaternions are in the order x, y, z, w. Angles are in "
    "degrees, counter-clockwise from +x."
)
"""Axes, units and quaternion order, stated in every file."""
Vector3 = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ExportedObject(_Part):
    """An object seen from a reference frame."""

    label: str
    score: float = Field(ge=0, le=1, description="score of the detector")
    frame: str = Field(description="id of the frame that shows the object; each frame lists its own objects")
    position_m: Vector3 = Field(description="centre in the world frame")
    size_m: Vector3 = Field(description="length, width and height of the upright box")
    yaw_deg: float = Field(description="azimuth of the length in the world frame, modulo 180")
    deviation_m: float | None = Field(
        description="standard deviation of the horizontal position along each axis if the object was triangulated"
    )


class ExportedFrame(_Part):
    """A reference frame."""

    id: str
    kind: Literal["scene", "transition"]
    position_m: Vector3 = Field(description="position of the camera in the world frame")
    quaternion_xyzw: Annotated[tuple[float, ...], Field(min_length=4, max_length=4)]


class ExportedPlace(_Part):
    """A place."""

    name: str
    frames: tuple[ExportedFrame, ...]
    objects: tuple[ExportedObject, ...]


class ExportedPlaces(_Part):
    """The places of a map."""

    format: Literal["salframe-places"] = "salframe-places"
    version: Literal[1] = 1
    conventions: str = CONVENTIONS
    name: str
    method: str
    places: tuple[ExportedPlace, ...]


def write_places(name: str, localization: LocalizationMap, path: Path) -> tuple[Path, ...]:
    """Write the places of a map with their frames and objects as JSON, and the JSON schema to STEM.schema.json.

    Args:
        name: Name of the map.
        localization: The localization map.
        path: The JSON file.

    Returns:
        The written files.
    """
    frames_of_place: dict[str, list[ReferenceFrame]] = {}
    for frame in localization.frames:
        frames_of_place.setdefault(frame.place, []).append(frame)
    places = ExportedPlaces(
        name=name,
        method=localization.localizer.name,
        places=tuple(_place(place, frames, localization) for place, frames in frames_of_place.items()),
    )
    schema = path.with_suffix(".schema.json")
    write_json(schema, ExportedPlaces.model_json_schema())
    write_json(path, places.model_dump(mode="json"))
    return path, schema


def _place(place: str, frames: list[ReferenceFrame], localization: LocalizationMap) -> ExportedPlace:
    from scipy.spatial.transform import Rotation

    exported = tuple(
        ExportedFrame(
            id=frame.id,
            kind=frame.kind.value,
            position_m=tuple(frame.T_world_pano[:3, 3].round(4).tolist()),
            quaternion_xyzw=tuple(Rotation.from_matrix(frame.T_world_pano[:3, :3]).as_quat().round(6).tolist()),
        )
        for frame in frames
    )
    graphs = ((frame, graph_of_reference(localization, frame.id)) for frame in frames)
    objects = tuple(one for frame, graph in graphs if graph is not None for one in _objects(frame, graph))
    return ExportedPlace(name=place, frames=exported, objects=objects)


def _objects(frame: ReferenceFrame, graph: SaliencyGraph) -> Iterator[ExportedObject]:
    position_m = transform_points(frame.T_world_pano, graph.centroid_m)
    yaw_deg = np.degrees(graph.yaw_rad + pose_yaw(frame.T_world_pano)) % 180
    for node in np.flatnonzero(np.isfinite(position_m).all(1)).tolist():
        variance_m2 = float(graph.variance_m2[node])
        yield ExportedObject(
            label=graph.labels[node],
            score=round(float(graph.scores[node]), 4),
            frame=frame.id,
            position_m=tuple(position_m[node].round(4).tolist()),
            size_m=tuple(graph.size_m[node].round(4).tolist()),
            yaw_deg=round(float(yaw_deg[node]), 2),
            deviation_m=round(variance_m2**0.5, 4) if variance_m2 else None,
        )
