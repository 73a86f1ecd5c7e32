"""`house`: a generated building, rendered once into the folder format and read from there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import added
from salframe.framework.components.identity import UserFile, identity
from salframe.framework.files.hashes import digest
from salframe.navigation.world import NavigableDataset, World, floor_worlds
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.hidden_places import hide_query_place_setting
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_view import QueryView, as_query
from salframe.panoramas.rendered import RenderedDataset

if TYPE_CHECKING:
    from salframe_house.frames import HouseFrame

PLACING = "queries_per_room", "frames_per_room", "query_shift_m", "query_yaw", "lighting"
"""Settings that say which frames there are and in which light; their pixels depend on no more than the frame."""
CHANGING = "changed_fraction", "changes", "change_kinds", "query_range", "query_scale_share"
"""Settings of what happens after the building was mapped."""
MOST_ROOMS = 500
"""A building of so many is laid out, furnished and its frames are chosen in half a minute; more take far longer."""


class House(RenderedDataset["HouseFrame"], NavigableDataset):
    """A furnished building, generated and rendered from a seed: map frames by day, queries later, when some objects
    have changed."""

    name = "house"
    version = "1"

    class Config(QueryView):
        style: Literal["home", "office", "hotel"] = Field("home", description="kind of building")
        rooms: int = Field(12, ge=4, le=MOST_ROOMS, description="how many rooms, corridors counted")
        seed: int = Field(0, ge=0, description="another seed is another building")
        queries_per_room: int = Field(3, ge=0, description="queries in each room")
        frames_per_room: int | None = added(
            None, ge=1, description="at most so many map frames a room, queries as without; null: as many as it needs"
        )
        query_shift_m: float = added(
            0.7,
            ge=0,
            le=2,
            description="mean distance of the queries from their room's nearest map frame, as near to it as rooms "
            "allow; each is 0.43 to 1.57 times as far. 0: at a map frame",
        )
        query_yaw: Literal["uniform", "normal", "same"] = Field(
            "uniform",
            description="yaw of the queries: over the circle; the map frame's plus a normal angle of 16.6 deg mean "
            "absolute value; or the map frame's",
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
            None,
            description="folder of Sweet Home 3D's furniture libraries (.sh3f): many objects become models of theirs",
        )
        models_part: Literal["training", "held-out"] | None = Field(
            None, description="those that `panoseg` was trained on, or the others; null: all"
        )
        rgb: bool = Field(True, description="render colour; without it range and instances alone, 9 times faster")
        query_range: bool = Field(True, description="queries come with range; without it the map frames alone do")
        query_scale_share: float = Field(
            0.0, ge=0, description="standard deviation of the scale of a query's range, a share: one factor a panorama"
        )
        hide_query_place: bool = hide_query_place_setting()

    @property
    def provides(self) -> frozenset[str]:
        held = {"annotations", *(["rgb"] if self.config.rgb else []), *(["range"] if self.config.query_range else [])}
        return frozenset(held)

    def kept(self, frame: HouseFrame) -> frozenset[str]:
        return self.provides if frame.is_query else self.provides | {"range"}

    def list_frames(self) -> Sequence[HouseFrame]:
        from salframe_house.rendering import frames_of

        return frames_of(self.config)

    def file_stem(self, number: int, frame: HouseFrame) -> str:
        return frame.id

    def depends_on(self, frame: HouseFrame) -> str:
        return self._pixels_of_queries if frame.is_query else self._pixels_of_map

    @cached_property
    def _pixels_of_queries(self) -> str:
        return self._known_without(PLACING)

    @cached_property
    def _pixels_of_map(self) -> str:
        return self._known_without((*PLACING, *CHANGING))

    def _known_without(self, names: Sequence[str]) -> str:
        """The fingerprint, were these settings the defaults."""
        defaults = {name: field.get_default() for name, field in self.Config.model_fields.items() if name in names}
        return digest(identity(self.config.model_copy(update=defaults), describing=True))

    def render(self, frame: HouseFrame) -> Panorama:
        from salframe_house.rendering import render_frame

        return render_frame(self.config, frame)

    def list_objects(self) -> Mapping[str, Sequence[Any]]:
        from salframe_house.rendering import buildings_of, object_table

        return object_table(*buildings_of(self.config))

    def list_floors(self) -> Mapping[str, FloorMasks]:
        from salframe_house.rendering import buildings_of

        return {"floor": buildings_of(self.config)[0].floor_masks()}

    def room_types(self) -> Mapping[str, str]:
        from salframe_house.rendering import buildings_of

        return {room.id: room.kind for room in buildings_of(self.config)[0].rooms}

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        """The panorama at a pose in the changed building, that of the queries; its id names the pose, so that noise
        keyed by it stays with it."""
        from salframe_house.rendering import render_pose

        return as_query(render_pose(self.config, T_world_pano), self.config)

    def worlds(self) -> Sequence[World]:
        """The building, mapped before it changed: objects that were moved or added stop an agent where its map knows of
        nothing."""
        from salframe_house.rendering import buildings_of

        return floor_worlds(self, [buildings_of(self.config)[1].floor_masks()])
