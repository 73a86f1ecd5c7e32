"""The evidence `appearance`: similarity of the views of query and place, by the descriptors of an image network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.framework.files.columns import Columns
from salframe.localization.evidence_model import EvidenceColumn, EvidenceModel, PlaceFrames, PlaceHypotheses
from salframe.localization.localizer import Description
from salframe.panoramas.geometry import pose_yaw
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.perspective import ViewRig, turned_similarity
from salframe_image.image_network import ImageNetwork
from salframe_image.network_input import cut_visible_views

VIEWS, SHARE = "appearance", "appearance_seen"
"""Keys in a description: of the descriptors of the views, and of the share of valid pixels of each view."""
PACKED_VIEWS = "appearance_int8"
"""Key of the descriptors in a packed description."""
MIN_SHARE = 0.02
"""Minimum share of valid pixels of a view. With fewer, the grey that fills invalid pixels dominates the descriptor."""
MAX_DISTANCE_M = 2.5
"""Maximum distance of a view of a query from its last view, in metres. Farther views may show another place."""


class AppearanceEvidence(EvidenceModel):
    """Similarity of the colour images of query and place, in the column `appearance`.

    Perspective views are cut from each panorama. The descriptor of a view is the feature map of an image network,
    pooled by the generalised mean (Radenovic et al. 2019) and normalised to unit length. The similarity of query and
    panorama is the mean cosine similarity of their views, at the best relative heading. The value of a place is the
    similarity of its most similar panorama.

    In a partial panorama, only the visible part counts. A place whose panoramas have no colour gets the mean value of
    the other places. With the default settings, a map stores 15 kB for each panorama.
    """

    name = "appearance"
    version = "1"
    columns = (
        EvidenceColumn(
            "appearance",
            "mean cosine between the descriptors (of an image network) of the query's views and of the "
            "views of the most similar panorama in the candidate place",
            weight=78.0,
        ),
    )
    arrays = (VIEWS, SHARE)
    uses = frozenset({"rgb"})
    column_step: ClassVar[int | None] = None  # views of a rotated panorama show other parts of it

    class Config(ComponentConfig):
        network: slot(  # type: ignore[valid-type]
            "image-network", "efficientnet-lite0", description="image network, which computes the descriptors of views"
        )
        views: int = Field(
            12,
            ge=3,
            le=72,
            description="number of horizontal perspective views that are cut from the panorama, evenly spaced in "
            "azimuth",
        )
        hfov_deg: float = Field(
            120.0,
            gt=0,
            lt=150,
            description="horizontal and vertical field of view (degrees) of each perspective view, which is square",
        )
        power: float = Field(
            3.0,
            ge=1,
            description="exponent of the generalised mean that pools the feature map of a view to one descriptor. 1: "
            "arithmetic mean; large values approach the maximum",
        )

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._network: ImageNetwork = registry().build(ImageNetwork.role, self.config.network)
        size_px = self._network.size_px
        self._rig = ViewRig(self.config.views, size_px, size_px, np.deg2rad(self.config.hfov_deg))

    def describe(self, panorama: Panorama, description: Description) -> Description:
        """Return the arrays of the V views of a panorama; {} if it has no colour or no visible view.

        The arrays are `appearance_seen` (V,) float32, the share of valid pixels of each view (0 if it is below
        MIN_SHARE), and `appearance` (V, C) float16, the descriptor of each view multiplied by this share.
        """
        if panorama.rgb is None:
            return {}
        views, share = cut_visible_views(panorama, self._rig)
        share = np.where(share >= MIN_SHARE, share, 0).astype(np.float32)
        if not share.any():
            return {}
        visible = np.flatnonzero(share)
        unit = self._network.descriptors(views[visible], self.config.power)
        weighted = np.zeros((len(share), unit.shape[1]), np.float16)
        weighted[visible] = unit * share[visible, None]
        return {VIEWS: weighted, SHARE: share}

    def join(self, descriptions: Sequence[Description], T_last_view: np.ndarray) -> Description:
        """Return the sums of both arrays over the views of a query that are near its last view.

        Each view of the query is rotated to the heading of the last view, by a whole number of perspective views.
        """
        step_rad = 2 * np.pi / self.config.views
        parts = [
            (description, round(pose_yaw(T) / step_rad))
            for description, T in zip(descriptions, T_last_view, strict=True)
            if VIEWS in description and np.linalg.norm(T[:3, 3]) <= MAX_DISTANCE_M
        ]
        if not parts:
            return {}
        return {
            name: np.sum([np.roll(part[name].astype(np.float32), turn, 0) for part, turn in parts], 0)
            for name in self.arrays
        }

    def pack(self, description: Description) -> Description:
        """Return the descriptors as `appearance_int8` (V, C) without their lengths, and `appearance_seen`."""
        if VIEWS not in description:
            return {}
        return {PACKED_VIEWS: _quantise(description[VIEWS]), SHARE: description[SHARE]}

    def unpack(self, packed: Description) -> Description:
        if PACKED_VIEWS not in packed:
            return {}
        weighted = _unit(packed[PACKED_VIEWS]) * packed[SHARE][:, None]
        return {VIEWS: weighted.astype(np.float16), SHARE: packed[SHARE]}

    def index(self, descriptions: Sequence[Description], places: PlaceFrames, T_world_pano: np.ndarray) -> None:
        has_views = np.array([VIEWS in description for description in descriptions], bool)
        rows = [_quantise(description[VIEWS]) for description in descriptions if VIEWS in description]
        self._store(np.stack(rows) if rows else np.zeros((0, self.config.views, 1), np.int8), has_views, places)

    def open_index(self, packed: Columns, places: PlaceFrames, T_world_pano: np.ndarray) -> None:
        column = packed.columns.get(PACKED_VIEWS)
        if column is None:
            self.index([{}] * len(packed), places, T_world_pano)
            return
        has_views = np.diff(column.start) > 0
        self._store(column.values.reshape(has_views.sum(), self.config.views, -1), has_views, places)

    def _store(self, vectors: np.ndarray, has_views: np.ndarray, places: PlaceFrames) -> None:
        """Store the descriptors and the places of the map.

        Args:
            vectors: (F, V, C) int8 descriptors of the F frames with colour.
            has_views: (S,) bool, whether each of the S reference frames has colour.
            places: The places of the map.
        """
        self._vectors, self._places = vectors, places
        self._row = np.where(has_views, np.cumsum(has_views) - 1, -1)

    def score(self, description: Description, hypotheses: PlaceHypotheses) -> Mapping[str, np.ndarray]:
        frames = self._places.frame[np.isin(self._places.place, hypotheses.place)]
        frames = frames[self._row[frames] >= 0]
        if VIEWS not in description or not len(frames):
            return {"appearance": np.zeros(len(hypotheses))}
        weighted = description[VIEWS].astype(np.float32)
        reference = _unit(self._vectors[self._row[frames]])
        similarity = np.full(len(self._row), -np.inf)
        similarity[frames] = turned_similarity(weighted, reference).max(1) * len(weighted) / description[SHARE].sum()
        of_place = self._places.max_of_frames(similarity)[hypotheses.place]
        is_known = np.isfinite(of_place)
        return {"appearance": np.where(is_known, of_place, of_place[is_known].mean())}


def _quantise(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (V, C) as int8. Each is scaled so that its maximum absolute component is 127; zeros stay 0."""
    max_component = np.abs(vectors.astype(np.float32)).max(1, keepdims=True)
    return np.rint(vectors * (127 / np.maximum(max_component, 1e-9))).astype(np.int8)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (..., C) as float32 of unit length; zero vectors are unchanged."""
    converted = vectors.astype(np.float32)
    return converted / np.maximum(np.linalg.norm(converted, axis=-1, keepdims=True), 1e-9)  # type: ignore[no-any-return]
