"""Localize the reference frames of a map after they, or their places, were removed from the map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from salframe.localization.localizer import Description, Localizer
from salframe.localization.posterior import Head, Posterior, evidence_columns
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.hidden_places import hide_places

MAX_FRAMES = 200
"""Maximum number of reference frames that are localized after these frames were removed from the map. It is also the
maximum number that are localized after their places were removed."""
MAX_FRAMES_OF_PLACE = 4
"""Maximum number of frames of one place that are localized after they were removed from the map."""
PLACE_GROUPS = 10
"""Maximum number of groups of places. All places of a group are removed at once, so that the map is indexed once for
each group."""


@dataclass(frozen=True, eq=False)
class FrameAnswers:
    """Answers to N scene frames of a map that were used as queries.

    Before a frame is localized, it is hidden (removed from the map), either alone or with all frames of its place.

    Attributes:
        contrast: (N,) float64 contrast of each answer, see `Posterior.contrast`.
        is_right: (N,) bool, whether the first place of the answer is the place of the frame; False if the place was
            hidden.
        is_absent: (N,) bool, whether all frames of the place were hidden.
        objects: (N,) int64 number of objects of each frame; 0: unknown.
        distance_m: (N,) float64 distance in metres to the nearest scene frame of the same place that was not hidden;
            NaN if the place was hidden.
        place: (N,) int64 index of the place of each frame.
        evidence: Mapping from the name of a column of evidence to its values for the first places, (N,) float64; NaN if
            an answer lacks the column.
    """

    contrast: np.ndarray
    objects: np.ndarray
    is_right: np.ndarray
    is_absent: np.ndarray
    distance_m: np.ndarray
    place: np.ndarray
    evidence: Mapping[str, np.ndarray] = field(default_factory=dict, kw_only=True)

    def take(self, rows: np.ndarray) -> FrameAnswers:
        """Return the answers with these indices."""
        columns = (self.contrast, self.objects, self.is_right, self.is_absent, self.distance_m, self.place)
        evidence = {name: value[rows] for name, value in self.evidence.items()}
        return FrameAnswers(*(column[rows] for column in columns), evidence=evidence)

    def log_ratio(self, head: Head) -> np.ndarray:
        """Return the logarithms (N,) of the likelihood ratios that a head computes for the answers."""
        return head.log_ratio(self.contrast, self.objects, self.evidence)

    def in_map(self, head: Head) -> np.ndarray:
        """Return the probabilities (N,) of being in the map that a head computes for the answers."""
        return head.in_map(self.contrast, self.objects, self.evidence)


def localize_frames(
    localizer: Localizer,
    posterior: Posterior,
    descriptions: Sequence[Description],
    frames: Sequence[ReferenceFrame],
    floors: Sequence[FloorMasks],
) -> FrameAnswers:
    """Localize scene frames of a map after they, or all frames of their places, were removed from the map.

    Answers without a place are left out. Frames that cause an exception in the localizer are left out too. Arguments
    are those of `calibrate_posterior`.
    """
    number = {place: i for i, place in enumerate(dict.fromkeys(frame.place for frame in frames))}
    scenes: dict[str, list[int]] = {}
    for row, frame in enumerate(frames):
        if frame.kind is FrameKind.SCENE:
            scenes.setdefault(frame.place, []).append(row)
    rows: list[tuple[float, int, bool, bool, float, int]] = []
    evidence: list[Mapping[str, float]] = []
    for shown, queries, is_absent in _hide(frames, scenes, floors):
        localizer.index([descriptions[row] for row in shown], [frames[row] for row in shown])
        positions_m: dict[str, list[np.ndarray]] = {}
        for row in shown:
            if frames[row].kind is FrameKind.SCENE:
                positions_m.setdefault(frames[row].place, []).append(frames[row].T_world_pano[:3, 3])
        for row in queries:
            try:
                answer = localizer.match(descriptions[row])
            except Exception:  # if the localizer fails on a frame, only the answer to this frame is lost
                continue
            places = answer.places
            if not places:
                continue
            place, distance_m = frames[row].place, np.nan
            if not is_absent:
                shift_m = np.array(positions_m[place]) - frames[row].T_world_pano[:3, 3]
                distance_m = float(np.linalg.norm(shift_m, axis=1).min())
            contrast = posterior.contrast(np.array([ranked.score for ranked in places], np.float64))
            is_right = not is_absent and places[0].place == place
            objects = localizer.count_objects(descriptions[row])
            rows.append((contrast, objects, is_right, is_absent, distance_m, number[place]))
            evidence.append(answer.evidence)
    columns = zip(*rows, strict=True) if rows else [()] * 6
    kinds = (np.float64, np.int64, np.bool_, np.bool_, np.float64, np.int64)
    return FrameAnswers(
        *(np.array(column, kind) for column, kind in zip(columns, kinds, strict=True)),
        evidence=evidence_columns(evidence),
    )


def _hide(
    frames: Sequence[ReferenceFrame], scenes: dict[str, list[int]], floors: Sequence[FloorMasks]
) -> Iterator[tuple[list[int], list[int], bool]]:
    """Yield maps with hidden frames: the rows of the frames that remain, the rows of the hidden frames to localize, and
    whether whole places were hidden.

    First, one frame of each place with several scene frames is hidden, in MAX_FRAMES_OF_PLACE rounds. Then the places
    are hidden, in groups.
    """
    num_left = MAX_FRAMES
    for round in range(MAX_FRAMES_OF_PLACE):
        hidden = [rows[round] for rows in scenes.values() if len(rows) > max(round, 1)]
        queries = _spread(hidden, num_left)
        num_left -= len(queries)
        if queries:
            chosen = set(queries)
            yield [row for row in range(len(frames)) if row not in chosen], queries, False
    num_groups = min(PLACE_GROUPS, len(scenes))
    for group in range(num_groups):
        places = list(scenes)[group::num_groups]
        remaining = {frame.id for frame in hide_places(frames, places, floors)}
        shown = [row for row, frame in enumerate(frames) if frame.id in remaining]
        if shown:
            yield shown, _spread([row for place in places for row in scenes[place]], MAX_FRAMES // num_groups), True


def _spread(rows: list[int], count: int) -> list[int]:
    """Return at most `count` of the rows, at even intervals."""
    if len(rows) <= count:
        return rows
    return [rows[i] for i in np.linspace(0, len(rows) - 1, count).round().astype(int)]
