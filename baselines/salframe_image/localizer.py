"""The localizer `image`: features of a classification network (the paper's row "image")."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.localizer import Description, LevelledConfig, Localizer
from salframe.localization.ranking import rank_places
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.perspective import ViewRig, turned_similarity
from salframe_image.image_network import ImageNetwork
from salframe_image.network_input import cut_views

FLAT = 1e-3
"""Minimum difference between the maximum and the minimum similarity over all headings. If the difference is smaller,
there is no pose. Smaller differences are rounding errors, because features are stored as float16."""


class ImageFeatures(Localizer):
    """Compares the views of the query with the views of the reference frames by image features.

    The feature map of each view is pooled by the generalised mean (Radenovic et al. 2019) and normalised to unit
    length. The score of a reference frame is the mean cosine similarity of its views and the views of the query, at the
    best relative heading. In a partial panorama, a view that is less than half visible counts with the similarity 0.

    The pose of the answer has the position of the best reference frame. The heading of the answer is the heading of
    this frame, rotated by the best relative heading. There is no pose if all headings fit equally well.
    """

    name = "image"
    version = "1"
    needs = frozenset({"rgb"})
    column_step: ClassVar[int | None] = None  # views of a rotated panorama show other parts of it

    class Config(LevelledConfig):
        network: slot(  # type: ignore[valid-type]
            "image-network", "efficientnet-lite0", description="image network, which computes the features of views"
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
        self._network: ImageNetwork = registry().build("image-network", self.config.network)
        size_px = self._network.size_px
        self._rig = ViewRig(self.config.views, size_px, size_px, np.deg2rad(self.config.hfov_deg))

    def describe(self, panorama: Panorama) -> Description:
        """Return `features` (V, C) float16, one unit vector per view; zeros if less than half of the pixels of the view
        are valid."""
        views, valid = cut_views(panorama, self._rig)
        unit = self._network.descriptors(views, self.config.power)
        return {"features": (unit * valid[:, None]).astype(np.float16)}

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        self._frames = list(frames)
        self._map_features = np.stack([description["features"] for description in descriptions]).astype(np.float32)

    def match(self, description: Description) -> Localization:
        features = description["features"].astype(np.float32)
        if not features.any():
            return Localization((), None, LocalizationStatus.NO_FEATURES)
        similarity = turned_similarity(features, self._map_features)
        scores = similarity.max(1)
        best = int(scores.argmax())
        if np.ptp(similarity[best]) < FLAT:
            return Localization(rank_places(self._frames, scores), None, LocalizationStatus.NO_POSE)
        pose = self._frames[best].T_world_pano @ pose_2d(0, 0, peak_rad(similarity[best]))
        return Localization(rank_places(self._frames, scores, pose), pose, LocalizationStatus.OK)


def peak_rad(values: np.ndarray) -> float:
    """Return the angle, in radians, at which a sampled periodic function has its maximum.

    The maximum is the vertex of the parabola through the largest value and its neighbours.

    Args:
        values: (V,) values at V equally spaced angles, the first at 0.
    """
    count, top = len(values), int(np.argmax(values))
    before, peak, after = values[top - 1], values[top], values[(top + 1) % count]
    offset = (before - after) / 2 / (before - 2 * peak + after) if before + after < 2 * peak else 0.0
    return float((top + offset) * 2 * np.pi / count)
