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
        description="number of storeys, connected by stairs. Each storey has `rooms` rooms. Its seed is the seed of "
        "the storey below plus 1",
    )
    seed: int = Field(0, ge=0, description="random seed of the building and of the changes of its objects")
    queries_per_room: int = Field(3, ge=0, description="number of queries in each room")
    frames_per_room: int | None = added(
        None,
        ge=1,
        description="maximum number of reference frames in each room; null: no maximum. Every point of the floor is "
        "then at most 3 m from a reference frame. The queries do not depend on this setting",
    )
    frames_per_position: int = added(
        1,
        ge=1,
        le=16,
        description="maximum number of reference frames around each position. One or more positions cover a room. The "
        "queries do not depend on this setting",
    )
    map_spacing_m: float = added(
        1.0,
        gt=0,
        le=3,
        description="distance (m) between the reference frames around one position, as far as the room allows; only "
        "used if frames_per_position is over 1",
    )
    query_shift_m: float = added(
        0.7,
        ge=0,
        le=2,
        description="mean distance (m) between a query and the nearest reference frame of its room, as far as the "
        "rooms allow. Single distances are 0.43 to 1.57 times the mean; 0: queries are at the positions of reference "
        "frames",
    )
    query_yaw: Literal["uniform", "normal", "same"] = Field(
        "uniform",
        description="yaw of the queries. uniform: random over the full circle; normal: yaw of the nearest reference "
        "frame plus a normally distributed angle with a mean absolute value of 16.6 deg; same: yaw of the nearest "
        "reference frame",
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
        description="mean height (m) of the cameras of queries above the floor. Single heights differ from the mean "
        "by up to 3 cm",
    )
    changed_fraction: float = Field(
        0.1,
        ge=0,
        le=1,
        description="share of the objects (0 to 1) that are removed, moved or added between the map and the queries",
    )
    changes: Literal["uniform", "by-class"] = added(
        "uniform",
        description="objects that change between the map and the queries. uniform: all objects with equal "
        "probability, except for fittings such as toilets and lamps. Fittings only change if too few other objects "
        "can; by-class: objects that people often move change more often, such as chairs and bins 10 times as often "
        "as wardrobes. Fittings never change",
    )
    change_kinds: tuple[Literal["removed", "moved", "added"], ...] = added(
        ("removed", "moved", "added"),
        min_length=1,
        description="list of the kinds of changes, all equally frequent. removed: an object disappears; moved: an "
        "object has another position in its room; added: a new object appears",
    )
    signs: bool = added(
        False,
        description="true: each room has signs with its number, a poster inside and a plate beside the door outside; "
        "false: no signs",
    )
    signs_unreadable: float = added(
        0.0, ge=0, le=1, description="probability (0 to 1) that a sign is unreadable in the queries"
    )
    signs_wrong: float = added(
        0.0, ge=0, le=1, description="probability (0 to 1) that a sign shows the number of another room in the queries"
    )
    lighting: Literal["other", "day", "evening", "dim"] = Field(
        "other",
        description="lighting of the queries. Reference frames always have daylight. other: evening or dim at random; "
        "day: daylight; evening: all lamps are on and it is dark outside; dim: few lamps are on, and the image is "
        "dark and noisy",
    )
    height: int = Field(
        512, ge=64, multiple_of=4, description="height of a panorama in pixels; its width is twice the height"
    )
    models: UserFile | None = Field(
        None,
        description="path of a folder with Sweet Home 3D furniture libraries (.sh3f), whose models replace many of "
        "the generated objects; null: all objects are generated",
    )
    models_part: Literal["training", "held-out"] | None = Field(
        None,
        description="part of the furniture models in `models` to use. training: those in the training data of the "
        "detector `panoseg`; held-out: all others; null: all models",
    )
    rgb: bool = Field(
        True,
        description="true: panoramas have colour; false: panoramas have no colour, and rendering is 9 times faster",
    )
    query_range: bool = Field(True, description="true: queries have range; false: queries have no range")
    map_range: bool = added(
        True, description="true: reference frames have range; false: reference frames have no range"
    )
    query_scale_share: float = Field(
        0.0,
        ge=0,
        description="standard deviation of a random factor (mean 1) for each query, which multiplies its ranges; 0: "
        "ranges have no scale error",
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
