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
    """Settings of the generated building, its changes between map and queries, and the rendering of panoramas."""

    style: Literal["home", "office", "hotel"] = Field(
        "home", description="type of the building, with its rooms and furniture: a home, an office building, or a hotel"
    )
    rooms: int = Field(12, ge=4, le=MAX_ROOMS, description="number of rooms of each storey, including corridors")
    storeys: int = added(
        1,
        ge=1,
        le=9,
        description="number of storeys, connected by stairs. Each storey has `rooms` rooms. The seeds of the storeys "
        "are `seed`, `seed` + 1 and so on, from the bottom to the top",
    )
    seed: int = Field(0, ge=0, description="random seed of the building and of the changes of its objects")
    queries_per_room: int = Field(3, ge=0, description="number of queries in each room")
    frames_per_room: int | None = added(
        None,
        ge=1,
        description="maximum number of camera positions in each room. Each position has one reference frame, or a "
        "group (see `frames_per_position`). The queries do not depend on this setting; null: as many positions as are "
        "needed so that every point of the floor is at most 3 m from one of them",
    )
    frames_per_position: int = added(
        1,
        ge=1,
        le=16,
        description="maximum number of reference frames in a group. Each camera position in a room has a group: the "
        "first frame is at the position, and the others stand around it, see `map_spacing_m`. The queries do not "
        "depend on this setting",
    )
    map_spacing_m: float = added(
        1.0,
        gt=0,
        le=3,
        description="distance (m) between neighbouring reference frames of a group (see `frames_per_position`), if the "
        "room is large enough. Only used if frames_per_position is over 1",
    )
    query_shift_m: float = added(
        0.7,
        ge=0,
        le=2,
        description="mean distance (m) between a query and the nearest reference frame of its room, if the rooms are "
        "large enough. The distance of a single query is 0.43 to 1.57 times the mean; 0: queries are at the positions "
        "of reference frames",
    )
    query_yaw: Literal["uniform", "normal", "same"] = Field(
        "uniform",
        description="yaw of the queries. uniform: random over the full circle; normal: yaw of the nearest reference "
        "frame plus a random angle, normally distributed with a mean absolute value of 16.6 deg; same: yaw of the "
        "nearest reference frame",
    )
    query_tilt_deg: float = added(
        0.0,
        ge=0,
        le=180,
        description="tilt (degrees) of the camera of each query, about a random horizontal axis; 0: level; 180: "
        "upside down",
    )
    query_height_m: float = added(
        1.5,
        ge=0.2,
        le=2.2,
        description="mean height (m) of the cameras of queries above the floor. The height of a single query differs "
        "from the mean by up to 3 cm",
    )
    changed_fraction: float = Field(
        0.1,
        ge=0,
        le=1,
        description="share (0 to 1) of the objects that change after the reference frames were rendered. The queries "
        "show the changed objects, see `changes` and `change_kinds`",
    )
    changes: Literal["uniform", "by-class"] = added(
        "uniform",
        description="how the objects that change are chosen, see `changed_fraction`. uniform: at random. "
        "Fittings such as toilets and lamps only change if there are not enough other objects; by-class: objects that "
        "people often move are chosen more often, for example chairs and bins 10 times as often as wardrobes, and "
        "fittings never change",
    )
    change_kinds: tuple[Literal["removed", "moved", "added"], ...] = added(
        ("removed", "moved", "added"),
        min_length=1,
        description="list of the kinds of changes of objects, which are equally frequent. removed: an object "
        "disappears; moved: an object gets another position in its room; added: a new object appears",
    )
    signs: bool = added(
        False,
        description="true: each room has two signs with its number, a poster inside and a plate beside the door "
        "outside; false: no signs",
    )
    signs_unreadable: float = added(
        0.0,
        ge=0,
        le=1,
        description="probability (0 to 1) that a sign is unreadable in the queries. Only used if signs=true",
    )
    signs_wrong: float = added(
        0.0,
        ge=0,
        le=1,
        description="probability (0 to 1) that a sign shows the number of another room in the queries. Only used "
        "if signs=true",
    )
    lighting: Literal["other", "day", "evening", "dim"] = Field(
        "other",
        description="lighting of the queries; reference frames always have daylight. other: evening or dim, at "
        "random; day: daylight; evening: all lamps are on and it is dark outside; dim: few lamps are on, and the "
        "image is dark and noisy",
    )
    height: int = Field(
        512, ge=64, multiple_of=4, description="height of a panorama in pixels; its width is twice the height"
    )
    models: UserFile | None = Field(
        None,
        description="path of a folder with furniture libraries of Sweet Home 3D (.sh3f files), whose models replace "
        "many of the generated objects; null: all objects are generated",
    )
    models_part: Literal["training", "held-out"] | None = Field(
        None,
        description="furniture models in the folder `models` that are used. training: those in the training data of "
        "the detector `panoseg`; held-out: all others; null: all models",
    )
    rgb: bool = Field(
        True,
        description="true: panoramas have colour; false: panoramas have no colour, and rendering is 9 times faster",
    )
    query_range: bool = Field(True, description="true: queries have range images; false: queries have no range images")
    map_range: bool = added(
        True, description="true: reference frames have range images; false: reference frames have no range images"
    )
    query_scale_share: float = Field(
        0.0,
        ge=0,
        description="standard deviation of the scale error of the range images of queries (0.1: 10 %). A query has "
        "one scale error for all its pixels; 0: no error",
    )
    hide_query_place: bool = hide_query_place_setting()

    @model_validator(mode="after")
    def _signs_are_unique(self) -> HouseConfig:
        if self.signs and self.storeys > 1:
            raise ValueError(
                f"received signs=true with storeys={self.storeys}, expected storeys=1 or signs=false: the numbers on "
                "the signs would repeat on each storey"
            )
        return self

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
                f"query_tilt_deg is {self.query_tilt_deg:g}, but the camera stays level with "
                f"query_views={self.query_views} and query_motion=turned: set query_tilt_deg=0, query_motion=driven "
                "or query_views=1"
            )
        return self
