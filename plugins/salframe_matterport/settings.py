"""Settings of the dataset `matterport-annotations`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from salframe.framework.component import added, match_only
from salframe.panoramas.hidden_places import hide_query_place_setting
from salframe.panoramas.query_view import QueryView


class AnnotationsConfig(QueryView):
    """Settings of `MatterportAnnotations`."""

    root: Path | None = Field(
        None,
        description="path of the folder that contains connectivity/, reverie/BBox/ and vp2room_label.json; "
        "required (--data-dir sets it)",
    )
    scans: Literal["all"] | tuple[str, ...] = Field(
        "all",
        description="list of the ids of the buildings to use, such as [17DRP5sb8fy]; all: all buildings in the folder",
    )
    range_noise: float = Field(
        0.05,
        ge=0,
        lt=1,
        description="standard deviation of the error of the range of an object at a viewpoint, divided by the "
        "range (0.05: 5 %); 0: no error",
    )
    query_range: bool = added(
        True,
        description="true: the objects of queries have ranges; false: they only have directions and apparent "
        "sizes (solid angles)",
    )
    min_visible: int = Field(
        3,
        ge=1,
        description="minimum number of visible objects of a query. Viewpoints with fewer objects are not used "
        "as queries",
    )
    seed: int = Field(
        0,
        description="random seed of the range errors, the yaws of queries, the walks of queries (see `query_motion`), "
        "and the selection by `map_share`. Objects that cannot be triangulated have a random range, which also depends "
        "on this seed",
    )
    leave_out: int = match_only(
        1,
        ge=1,
        description="number of viewpoints that are removed from the map of a query: first the viewpoint of the "
        "query itself, then the nearest ones in the same region. A region has no queries if it has at most this "
        "number of viewpoints",
    )
    query_triangulates: bool = match_only(
        True,
        description="whether the viewpoint of a query, which is not in its map (see `leave_out`), is still used to "
        "triangulate the ranges of the objects in this map. true: all viewpoints of the building are used; false: "
        "only the viewpoints in the map are used",
    )
    one_map: bool = match_only(
        False,
        description="true: a map contains all buildings together, 1 km apart along x; false: a map contains one "
        "building. In both cases there are several maps, because the map of a query must not contain its viewpoint "
        "(see `leave_out`). To get a single map of all buildings, set one_map=true and `map_share`. If the dataset "
        "has a single building, true and false give the same maps",
    )
    map_share: float | None = added(
        None,
        match_only=True,
        gt=0,
        lt=1,
        description="share (0 to 1) of the viewpoints of each building that form one map, chosen at random. All "
        "other viewpoints are queries in this map. Requires leave_out=1; null: each query has its own map of all "
        "other viewpoints",
    )
    hide_query_place: bool = hide_query_place_setting()

    @model_validator(mode="after")
    def _one_way_to_leave_out(self) -> AnnotationsConfig:
        if self.map_share is not None and self.leave_out > 1:
            raise ValueError(
                f"received leave_out={self.leave_out} with map_share={self.map_share}, expected leave_out=1 or "
                "map_share=null"
            )
        return self
