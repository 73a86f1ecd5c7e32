"""The localizer `verified-places`: another method ranks the places, and keypoint matches re-rank the first ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.localizer import Description, Localizer
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.view import OdometryNoise
from salframe_keypoints.localizer import Keypoints

MAX_FRAMES = 3
"""Maximum number of reference frames of a place to match. They are the frames nearest to the frame that the ranking
names."""
_RANKING, _KEYPOINTS = "ranking_", "keypoints_"
"""Prefixes of keys in a description: arrays of the localizer that ranks the places, and arrays of the keypoints."""


class VerifiedPlaces(Localizer):
    """Ranks places by another localizer, and re-ranks the first ones by keypoint matches.

    Another localizer, the setting `ranking`, ranks the places. The first ones (setting `places`) are then compared with
    the query by keypoints, as in the localizer `keypoints`. At most three reference frames of each place are compared.
    The new score of a place is

        s + weight * ln(1 + n / min_inliers)

    - s: score of the place in the first ranking
    - n: number of inliers in the best reference frame of the place
    - `weight` and `min_inliers`: settings

    The answer is the first place of the new order. Its pose is computed from keypoints. If this pose has too few
    inliers, the pose by `ranking` is used instead, but only if the first place is the same in both orders. Otherwise,
    the answer has no pose. If a query has several views, the keypoints are those of its last view.
    """

    name = "verified-places"
    version = "1"
    column_step: ClassVar[int | None] = None  # views of a rotated panorama are sampled at other pixels
    uses_floors = True

    class Config(ComponentConfig):
        ranking: slot("localizer", "saliency-places", description="localizer that ranks the places")  # type: ignore[valid-type]
        features: slot("feature-matcher", "sift", description="feature matcher for the keypoints")  # type: ignore[valid-type]
        places: int = match_only(
            5, ge=1, description="number of places that are re-ranked, the first ones by `ranking`"
        )
        min_inliers: int = match_only(
            20,
            ge=4,
            description="minimum number of inliers of a pose: matched keypoints that agree with the pose. If there are "
            "fewer, the pose is rejected",
        )
        weight: float = match_only(
            7.8,
            ge=0,
            description="weight of the keypoints in the new score: the factor of ln(1 + n / min_inliers), where n is "
            "the number of inliers",
        )

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._ranking: Localizer = registry().build(Localizer.role, self.config.ranking)
        self._keypoints = Keypoints(Keypoints.Config.model_validate({"features": self.config.features}))
        self.range_model, self.level = self._ranking.range_model, self._ranking.level
        self.odometry = self._ranking.odometry

    @property
    def needs(self) -> frozenset[str]:
        return self._ranking.needs | self._keypoints.needs

    @property
    def uses(self) -> frozenset[str]:  # type: ignore[override]
        """Parts of a panorama that the ranking or the keypoints read if they are present."""
        return self._ranking.uses | self._keypoints.uses

    def describe(self, panorama: Panorama) -> Description:
        return _combine(self._ranking.describe(panorama), self._keypoints.describe(panorama))

    def join(
        self, descriptions: Sequence[Description], T_last_view: np.ndarray, odometry: OdometryNoise
    ) -> Description | None:
        ranked, keypoints = zip(*map(_split, descriptions), strict=True)
        joined = self._ranking.join(ranked, T_last_view, odometry)
        return None if joined is None else _combine(joined, keypoints[-1])

    def pack(self, description: Description) -> Description:
        ranked, keypoints = _split(description)
        return _combine(self._ranking.pack(ranked), self._keypoints.pack(keypoints))

    def unpack(self, packed: Description) -> Description:
        ranked, keypoints = _split(packed)
        return _combine(self._ranking.unpack(ranked), self._keypoints.unpack(keypoints))

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        ranked, keypoints = zip(*map(_split, descriptions), strict=True)
        self._ranking.floors = self.floors
        self._ranking.index(ranked, frames)
        self._keypoints.index(keypoints, frames)
        self._frames = list(frames)
        self._number = {frame.id: number for number, frame in enumerate(frames)}
        self._frames_of: dict[str, list[int]] = {}
        for number, frame in enumerate(frames):
            if frame.kind is FrameKind.SCENE:
                self._frames_of.setdefault(frame.place, []).append(number)

    def match(self, description: Description) -> Localization:
        ranked, keypoints = _split(description)
        answer = self._ranking.match(ranked)
        if not answer.status.names_a_place:
            return answer
        config = self.config
        places, poses = [], []
        for place in answer.places[: config.places]:
            frames = self._nearest(self._number[place.frame])
            matched = self._keypoints.verify(keypoints, frames)
            best = max(range(len(frames)), key=lambda number: matched[number][1])
            pose, inliers = matched[best]
            is_posed = pose is not None and inliers >= config.min_inliers
            poses.append(self._frames[frames[best]].T_world_pano @ pose if is_posed else None)
            gain = config.weight * float(np.log1p(inliers / config.min_inliers))
            places.append(RankedPlace(place.frame, place.place, place.score + gain))
        order = sorted(range(len(places)), key=lambda number: -places[number].score)
        reranked = (*(places[number] for number in order), *answer.places[len(places) :])
        if poses[order[0]] is not None:
            return Localization(reranked, poses[order[0]], LocalizationStatus.OK)
        if order[0] == 0:
            return replace(answer, places=reranked)
        return Localization(reranked, None, LocalizationStatus.NO_POSE)

    def _nearest(self, number: int) -> list[int]:
        """Return the MAX_FRAMES scene frames nearest to a frame, in the same place. Without scene frames in the place,
        return the frame itself."""
        position_m = self._frames[number].T_world_pano[:3, 3]
        frames = self._frames_of.get(self._frames[number].place, [number])
        distance_m = [np.linalg.norm(self._frames[other].T_world_pano[:3, 3] - position_m) for other in frames]
        return [frames[row] for row in np.argsort(distance_m, kind="stable")[:MAX_FRAMES]]

    def note(self, description: Description) -> str | None:
        return self._ranking.note(_split(description)[0])

    def unknown_labels(self, description: Description) -> tuple[str, ...]:
        return self._ranking.unknown_labels(_split(description)[0])

    def unfit_for_map(self, description: Description) -> str | None:
        return self._ranking.unfit_for_map(_split(description)[0])

    def count_objects(self, description: Description) -> int:
        return self._ranking.count_objects(_split(description)[0])


def _split(description: Description) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Split a description into the arrays of the ranking and the arrays of the keypoints, without prefixes."""
    ranked, keypoints = (
        {name.removeprefix(prefix): array for name, array in description.items() if name.startswith(prefix)}
        for prefix in (_RANKING, _KEYPOINTS)
    )
    return ranked, keypoints


def _combine(ranked: Description, keypoints: Description) -> Description:
    """Combine the arrays of the ranking and of the keypoints to one description; the inverse of `_split`."""
    parts = (_RANKING, ranked), (_KEYPOINTS, keypoints)
    return {prefix + name: array for prefix, arrays in parts for name, array in arrays.items()}
