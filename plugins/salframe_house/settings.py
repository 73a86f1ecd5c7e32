"""Settings of the dataset `house`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from salframe.framework.component import added
from salframe.framework.components.identity import UserFile
from salframe.panoramas.hidden_places import hide_query_place_setting
from salframe.panoramas.query_view import QueryView

MAX_ROOMS = 500
"""Maximum number of rooms of a building. Layout, furnishing and choice of frames then take half a minute."""


class HouseConfig(QueryView):
    """Settings of the building, its changes and the rendering."""

    style: Literal["home", "office", "hotel"] = Field("home", description="style of the generated building")
    rooms: int = Field(12, ge=4, le=MAX_ROOMS, description="number of rooms of the building, including corridors")
    storeys: int = added(
        1,
        ge=1,
        le=9,
        description="number of storeys, connected by stairs; each has `rooms` rooms, and the seed of the storey below "
        "plus 1",
    )
    seed: int = Field(0, ge=0, description="random seed of the building and of the changes of its objects")
    queries_per_room: int = Field(3, ge=0, description="number of queries per room")
    frames_per_room: int | None = added(
        None,
        ge=1,
        description="maximum number of reference frames per room; the queries do not depend on it; null: as many "
        "as the room needs",
    )
    frames_per_position: int = added(
        1,
        ge=1,
        le=16,
        description="number of reference frames at each of the positions that cover a room; most rooms have one "
        "position. The queries do not depend on it",
    )
    map_spacing_m: float = added(
        1.0,
        gt=0,
        le=3,
        description="distance (m) of neighbouring reference frames at a position, as far as the room allows; without "
        "effect if frames_per_position is 1",
    )
    query_shift_m: float = added(
        0.7,
        ge=0,
        le=2,
        description="mean distance (m) of the queries from the nearest reference frame of their room, as far as the "
        "rooms allow; single distances are 0.43 to 1.57 times the mean. 0: queries are at reference frames",
    )
    query_yaw: Literal["uniform", "normal", "same"] = Field(
        "uniform",
        description="yaw of the queries. uniform: uniform over the circle; same: the yaw of the nearest reference "
        "frame; normal: the yaw of the nearest reference frame plus a normally distributed angle with "
        "a mean absolute value of 16.6 deg",
    )
    query_tilt_deg: float = added(
        0.0,
        ge=0,
        le=180,
        description="tilt of the cameras of the queries in degrees, each about a random horizontal axis; 180: upside "
        "down",
    )
    query_height_m: float = added(
        1.5, ge=0.2, le=2.2, description="mean height of the cameras of the queries above the floor in metres"
    )
    changed_fraction: float = Field(
        0.1,
        ge=0,
        le=1,
        description="fraction of objects that are removed, moved or added between the reference frames and the "
        "queries (0 to 1)",
    )
    changes: Literal["uniform", "by-class"] = added(
        "uniform",
        description="objects that change. uniform: all movable objects with equal probability, and fittings only "
        "after them; "
        "by-class: movable objects more often (chairs and bins 10 times as often as wardrobes, fittings never)",
    )
    change_kinds: tuple[Literal["removed", "moved", "added"], ...] = added(
        ("removed", "moved", "added"),
        min_length=1,
        description="list of the kinds of changes, which are equally frequent",
    )
    signs: bool = added(
        False,
        description="true: rooms have a sign with their number, as a poster inside and a plate beside the door outside",
    )
    signs_unreadable: float = added(
        0.0, ge=0, le=1, description="share of the signs (0 to 1) that cannot be read when the queries are taken"
    )
    signs_wrong: float = added(
        0.0,
        ge=0,
        le=1,
        description="share of the signs (0 to 1) that have the number of another room when the queries are taken",
    )
    lighting: Literal["other", "day", "evening", "dim"] = Field(
        "other",
        description="lighting of the queries; other: evening or dim at random. Reference frames always have daylight",
    )
    height: int = Field(
        512, ge=64, multiple_of=4, description="height of the panoramas in pixels; the width is twice the height"
    )
    models: UserFile | None = Field(
        None,
        description="path of a folder of Sweet Home 3D furniture libraries (.sh3f), whose models replace many of "
        "the generated objects",
    )
    models_part: Literal["training", "held-out"] | None = Field(
        None,
        description="furniture models to use. training: those in the training data of `panoseg`; held-out: all "
        "others; null: both",
    )
    rgb: bool = Field(
        True, description="true: render colour, range and instances; false: only range and instances, 9 times faster"
    )
    query_range: bool = Field(
        True, description="true: the queries have range; false: they have colour and annotations only"
    )
    map_range: bool = added(
        True, description="true: the reference frames have range; false: they have colour and annotations only"
    )
    query_scale_share: float = Field(
        0.0,
        ge=0,
        description="standard deviation of the random factor (mean 1) that multiplies all ranges of a query; "
        "each query has its own factor",
    )
    hide_query_place: bool = hide_query_place_setting()

    @model_validator(mode="after")
    def _shares_of_signs_add_up(self) -> HouseConfig:
        if self.signs_unreadable + self.signs_wrong > 1:
            raise ValueError(
                f"signs_unreadable is {self.signs_unreadable:g} and signs_wrong is {self.signs_wrong:g}; expected a "
                "sum of at most 1"
            )
        return self

    @model_validator(mode="after")
    def _turns_about_the_vertical(self) -> HouseConfig:
        if self.query_views > 1 and self.query_motion == "turned" and self.query_tilt_deg:
            raise ValueError(
                f"query_tilt_deg is {self.query_tilt_deg:g} with query_views={self.query_views} and "
                "query_motion=turned, expected query_tilt_deg=0, query_motion=driven or query_views=1: a turned camera "
                "stays level"
            )
        return self
