"""The settings of the data set `house`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from salframe.framework.component import added
from salframe.framework.components.identity import UserFile
from salframe.panoramas.hidden_places import hide_query_place_setting
from salframe.panoramas.query_view import QueryView

MAX_ROOMS = 500
"""Maximum number of rooms of a building: so many take half a minute to lay out, furnish and choose frames of."""


class HouseConfig(QueryView):
    """What is built, how it changes, and how it is rendered."""

    style: Literal["home", "office", "hotel"] = Field("home", description="kind of building")
    rooms: int = Field(12, ge=4, le=MAX_ROOMS, description="how many rooms, corridors counted")
    seed: int = Field(0, ge=0, description="another seed is another building")
    queries_per_room: int = Field(3, ge=0, description="queries in each room")
    frames_per_room: int | None = added(
        None, ge=1, description="at most so many reference frames a room, queries as without; null: as many as it needs"
    )
    query_shift_m: float = added(
        0.7,
        ge=0,
        le=2,
        description="mean distance of the queries from their room's nearest reference frame, as near to it as rooms "
        "allow; each is 0.43 to 1.57 times as far. 0: at a reference frame",
    )
    query_yaw: Literal["uniform", "normal", "same"] = Field(
        "uniform",
        description="yaw of the queries: over the circle; the reference frame's plus a normal angle of 16.6 deg mean "
        "absolute value; or the reference frame's",
    )
    changed_fraction: float = Field(
        0.1, ge=0, le=1, description="share of the objects removed, moved or added before the queries"
    )
    changes: Literal["uniform", "by-class"] = added(
        "uniform",
        description="which objects change: any alike, fittings last; or what people move more often, chairs and "
        "bins ten times as often as wardrobes, and what is built in never",
    )
    change_kinds: tuple[Literal["removed", "moved", "added"], ...] = added(
        ("removed", "moved", "added"), min_length=1, description="how objects change, in equal parts"
    )
    lighting: Literal["other", "day", "evening", "dim"] = Field(
        "other", description="of the queries: other than the map's day, which is evening or dim, or one for all"
    )
    height: int = Field(512, ge=64, multiple_of=4, description="pixels of a panorama, whose width is twice as much")
    models: UserFile | None = Field(
        None, description="folder of Sweet Home 3D's furniture libraries (.sh3f): many objects become models of theirs"
    )
    models_part: Literal["training", "held-out"] | None = Field(
        None, description="those that `panoseg` was trained on, or the others; null: all"
    )
    rgb: bool = Field(True, description="render colour; without it range and instances alone, 9 times faster")
    query_range: bool = Field(True, description="queries come with range; without it the reference frames alone do")
    query_scale_share: float = Field(
        0.0, ge=0, description="standard deviation of the scale of a query's range, a share: one factor a panorama"
    )
    hide_query_place: bool = hide_query_place_setting()
