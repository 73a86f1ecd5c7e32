"""Dataset `house`: a generated building, rendered once into the folder format and read from there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from salframe.framework.components.identity import identity
from salframe.framework.files.hashes import digest
from salframe.navigation.world import NavigableDataset, World, floor_worlds
from salframe.panoramas.floors import Connection, FloorMasks
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_view import as_query
from salframe.panoramas.rendered import RenderedDataset
from salframe_house.settings import HouseConfig

if TYPE_CHECKING:
    from salframe_house.frames import HouseFrame

FRAME_SETTINGS = (
    "queries_per_room",
    "frames_per_room",
    "frames_per_position",
    "map_spacing_m",
    "map_range",
    "query_shift_m",
    "query_yaw",
    "query_tilt_deg",
    "query_height_m",
    "lighting",
)
"""Settings that determine the poses and the lighting of the frames. They have no other effect on the pixels."""
CHANGE_SETTINGS = (
    "changed_fraction",
    "changes",
    "change_kinds",
    "query_range",
    "query_scale_share",
    "signs_unreadable",
    "signs_wrong",
)
"""Settings that affect only the queries: changes of the building and the range of the queries."""
MASKS_VERSION = 2
"""Version of the floor masks. It is part of the fingerprint, so that folders and answers with older masks expire.

Raise this number if a change of the code affects the floor masks but no pixel. Rendered panoramas, descriptions and
stored results then remain valid. Raising the version of the dataset would discard them.
"""


class House(RenderedDataset["HouseFrame"], NavigableDataset):
    """A furnished building, generated and rendered from a seed.

    The reference frames show the building by day. The queries show it later, after some objects were removed, moved or
    added.
    """

    name = "house"
    version = "1"

    class Config(HouseConfig):
        """Settings of the dataset, see `HouseConfig`."""

    @cached_property
    def fingerprint(self) -> str:
        fingerprint = digest([super().fingerprint, {"masks": MASKS_VERSION}])
        if self.config.query_motion != "driven" or self.config.query_views == 1:
            return fingerprint
        return digest([fingerprint, "driven", self.config.query_views])

    @property
    def provides(self) -> frozenset[str]:
        return self._parts(self.config.query_range and self.config.map_range)

    def stored_parts(self, frame: HouseFrame) -> frozenset[str]:
        return self._parts(self.config.query_range if frame.is_query else self.config.map_range)

    def _parts(self, has_range: bool) -> frozenset[str]:
        """Return the names of the data that a panorama has ("annotations", "rgb", "range"), with or without range."""
        return frozenset({"annotations", *(["rgb"] if self.config.rgb else []), *(["range"] if has_range else [])})

    def list_frames(self) -> Sequence[HouseFrame]:
        from salframe_house.rendering import frames_of

        return frames_of(self.config)

    def list_sequences(self) -> Mapping[str, Sequence[str]]:
        from salframe_house.rendering import sequences_of

        return sequences_of(self.config)

    def file_stem(self, number: int, frame: HouseFrame) -> str:
        return frame.id

    def depends_on(self, frame: HouseFrame) -> str:
        return self._query_pixels_key if frame.is_query else self._reference_pixels_key

    @cached_property
    def _query_pixels_key(self) -> str:
        """Fingerprint of the settings that the pixels of queries depend on."""
        return self._key_without(FRAME_SETTINGS)

    @cached_property
    def _reference_pixels_key(self) -> str:
        """Fingerprint of the settings that the pixels of reference frames depend on."""
        return self._key_without((*FRAME_SETTINGS, *CHANGE_SETTINGS))

    def _key_without(self, names: Sequence[str]) -> str:
        """Return the fingerprint with these settings replaced by their defaults."""
        defaults = {name: field.get_default() for name, field in self.Config.model_fields.items() if name in names}
        return digest(identity(self.config.model_copy(update=defaults), describing=True))

    def render(self, frame: HouseFrame) -> Panorama:
        from salframe_house.rendering import render_frame

        return render_frame(self.config, frame)

    def list_objects(self) -> Mapping[str, Sequence[Any]]:
        from salframe_house.rendering import object_table

        return object_table(self.config)

    def list_floors(self) -> Mapping[str, FloorMasks]:
        from salframe_house.rendering import floors_of

        floors, _ = floors_of(self.config)
        return {"floor" if len(floors) == 1 else f"floor-{number}": floor for number, floor in enumerate(floors, 1)}

    def list_connections(self) -> Sequence[Connection]:
        from salframe_house.rendering import stairs_of

        return stairs_of(self.config)

    def room_types(self) -> Mapping[str, str]:
        from salframe_house.rendering import room_types_of

        return room_types_of(self.config)

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        """Render the panorama at a pose in the changed building, in the lighting of the queries.

        The id contains the pose, so that noise seeded by the id is reproducible.
        """
        from salframe_house.rendering import render_pose

        return as_query(render_pose(self.config, T_world_pano), self.config)

    def worlds(self) -> Sequence[World]:
        """Return the changed building as a navigation world. The map shows the building before the changes.

        Moved and added objects therefore block the agent although the map does not show them there.
        """
        from salframe_house.rendering import floors_of

        return floor_worlds(self, floors_of(self.config)[1])
