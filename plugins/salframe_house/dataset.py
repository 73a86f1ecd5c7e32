"""`house`: a generated building, rendered once into the folder format and read from there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.framework.cache import cache_home
from salframe.framework.config import ComponentConfig
from salframe.framework.identity import digest, identity
from salframe.navigation.world import NavigableDataset, World, floor_worlds
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.folder_format import MANIFEST
from salframe.panoramas.panorama import Panorama


class House(FolderDataset, NavigableDataset):
    """A furnished building, generated and rendered from a seed: map frames by day, queries later, when some objects
    have changed."""

    name = "house"
    version = "1"

    class Config(ComponentConfig):
        style: Literal["home", "office", "hotel"] = Field("home", description="kind of building")
        rooms: int = Field(12, ge=4, description="how many rooms, corridors counted")
        seed: int = Field(0, ge=0, description="another seed is another building")
        queries_per_room: int = Field(3, ge=0, description="queries in each room")
        query_yaw: Literal["uniform", "normal"] = Field(
            "uniform",
            description="yaw of the queries: over the circle, or that of the map frame plus 16.6 deg mean absolute value",
        )
        changed_fraction: float = Field(
            0.1, ge=0, le=1, description="share of the objects removed, moved or added before the queries"
        )
        lighting: Literal["other", "day", "evening", "dim"] = Field(
            "other", description="of the queries: other than the map's day, which is evening or dim, or one for all"
        )
        height: int = Field(512, ge=64, multiple_of=4, description="pixels of a panorama, whose width is twice as much")
        models: Path | None = Field(
            None,
            description="folder of Sweet Home 3D's furniture libraries (.sh3f): many objects become models of theirs",
        )
        models_part: Literal["training", "held-out"] | None = Field(
            None, description="those that `panoseg` was trained on, or the others; null: all"
        )
        rgb: bool = Field(True, description="render colour; without it range and instances alone, 9 times faster")

    @cached_property
    def root(self) -> Path:
        """Where the rendered frames are kept."""
        return cache_home() / "house" / self.fingerprint[:16]

    @property
    def provides(self) -> frozenset[str]:
        return frozenset({"range", "annotations"} | ({"rgb"} if self.config.rgb else set()))

    @cached_property
    def fingerprint(self) -> str:
        """Of the settings and this version: they determine every pixel."""
        return digest(identity(self.config))

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Render the frames that are not there yet. Raises SalframeError where a rendering process dies."""
        if not (self.root / MANIFEST).exists():
            from salframe_house.rendering import render_building

            render_building(self.root, self.config, progress)

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        """The panorama at a pose in the changed building, that of the queries; its id names the pose, so that noise
        keyed by it stays with it."""
        from salframe_house.rendering import render_panorama

        return render_panorama(self.config, T_world_pano)

    def worlds(self) -> Sequence[World]:
        """The building, mapped before it changed: objects that were moved or added stop an agent where its map knows of
        nothing."""
        from salframe_house.rendering import changed_floor

        return floor_worlds(self, [changed_floor(self.config)])
