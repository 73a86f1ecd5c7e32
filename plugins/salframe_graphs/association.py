"""Objects of panoramas without range: association of bearings with objects, and triangulation of the objects
(docs/explanation/maps-without-range.md#maps-without-range)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from salframe.graphs.triangulation import MAX_RANGE_M, meeting_points, position_covariance

BEARING_ERROR_RAD = 0.016
"""Standard deviation of the horizontal and of the vertical angle of a bearing."""
CENTRE_ERROR_M = 0.05
"""Standard deviation (m) of the visible centre of an object across the bearing, for an object of size 0."""
SIDE_ERROR_SHARE = 0.09
"""Standard deviation of the visible centre, relative to the side length of the object. The centre varies because the
visible part of an object changes with the viewpoint."""
SIZE_ERROR_LOG = 0.6
"""Standard deviation of ln(projected area) of one object between panoramas, which show different sides of it."""
MAX_SIGMAS = 3.5
"""Maximum deviation of a bearing from an object, in standard deviations."""
MIN_PARALLAX_RAD = np.radians(4.0)
"""Minimum angle between two bearings that give a hypothesis. At smaller angles the range is too uncertain."""
DETECTION = 0.6
"""Probability that an object within MAX_RANGE_M is detected in a panorama of the same place. Doors, walls and furniture
hide the other objects."""
CLUTTER_SR = 7.5
"""Solid angle (sr) over which the bearings of unrelated objects are assumed to be distributed evenly, as in the
likelihood of queries without range."""
MIN_LOG_RATIO = 0.0
"""Minimum log likelihood ratio of a hypothesis that becomes an object. The alternative is that its bearings are
unrelated."""
SIZE_PRIOR_COUNT = 3
"""Minimum number of triangulated objects of a label from which a size prior of the label is computed."""
MIN_RANGE_M = 0.2
"""Minimum distance of an object from a viewpoint."""
MAX_MISSES = 1
"""Maximum number of other panoramas of the place that do not show an object which a single panorama shows. With more,
the bearing is probably a false positive. On tuning data (offices, seeds 100 to 103), such objects increase the accuracy
in maps of two panoramas per room, and decrease it in maps of four."""
MIN_SIZE_SPREAD_LOG = 0.35
"""Lower bound of the standard deviation of ln(projected area) of a label."""
AREA_SPAN_LOG = 7.0
"""Width of the interval of ln(projected area) in which the areas of wrong hypotheses are distributed evenly."""


@dataclass(frozen=True, eq=False)
class ObjectBearings:
    """N bearings of objects from panoramas with known poses, in the world.

    Attributes:
        frame: (N,) int64, index of the panorama of each bearing.
        group: (F,) int64, index of the place of each of the F panoramas; -1 for a panorama that shows several places.
        label: (N,) labels.
        origin_m: (N, 3) positions of the cameras in the world.
        direction: (N, 3) unit vectors in the world.
        solid_angle_sr: (N,) solid angles of the objects, NaN where unknown.
    """

    frame: np.ndarray
    group: np.ndarray
    label: np.ndarray
    origin_m: np.ndarray
    direction: np.ndarray
    solid_angle_sr: np.ndarray


@dataclass(frozen=True, eq=False)
class TriangulatedObjects:
    """M objects, triangulated from N bearings.

    Attributes:
        owner: (N,) int64 index of the object of each bearing; -1 if the bearing belongs to no object.
        position_m: (M, 3) positions in the world.
        covariance_m2: (M, 3, 3) covariances of the positions.
        log_area: (M,) ln of the projected area (m^2), NaN if the solid angles of all bearings are unknown.
    """

    owner: np.ndarray
    position_m: np.ndarray
    covariance_m2: np.ndarray
    log_area: np.ndarray


def triangulate_objects(rays: ObjectBearings) -> TriangulatedObjects:
    """Associate bearings with objects, and return the triangulated objects.

    Two bearings with the same label from panoramas of one place give a hypothesis: the point where the bearings meet.
    Each panorama of the place contributes to the log likelihood ratio of the hypothesis: either the log ratio of its
    best-fitting bearing with the label, compared with an unrelated bearing, or the log probability of a missed
    detection. The best hypothesis becomes an object and takes its bearings. This is repeated with the remaining
    bearings. The first pass estimates the typical size of each label. The second pass uses these sizes as a prior. The
    bearings that belong to no object afterwards become objects at the range that agrees with the typical size.

    Args:
        rays: The bearings.
    """
    sizes = _label_sizes(rays, _associate(rays, {}))
    return _add_single(rays, _associate(rays, sizes), sizes)


def _add_single(
    rays: ObjectBearings, objects: TriangulatedObjects, sizes: dict[str, tuple[float, float]]
) -> TriangulatedObjects:
    """Add an object for each bearing of a single panorama, if the typical size of its label is known.

    The range of the object follows from its solid angle and the size. A bearing is left out if more than MAX_MISSES
    other panoramas of the place do not show the object.
    """
    prior = np.array([sizes.get(label, (np.nan, np.nan)) for label in rays.label.tolist()])
    range_m = np.exp((prior[:, 0] - np.log(rays.solid_angle_sr)) / 2)
    rows = np.flatnonzero((objects.owner < 0) & (range_m > MIN_RANGE_M) & (range_m < MAX_RANGE_M))
    group = rays.group[rays.frame[rows]]
    rows, group = rows[group >= 0], group[group >= 0]
    position = rays.origin_m[rows] + range_m[rows, None] * rays.direction[rows]
    frames, first = np.unique(rays.frame, return_index=True)
    is_near = (cdist(position, rays.origin_m[first]) < MAX_RANGE_M) & (rays.group[frames] == group[:, None])
    is_likely = is_near.sum(1) - 1 <= MAX_MISSES
    rows, position = rows[is_likely], position[is_likely]
    log_area, spread = prior[rows].T
    along_m2 = range_m[rows] ** 2 * (spread**2 + SIZE_ERROR_LOG**2) / 4
    across_m2 = (range_m[rows] * _bearing_error(range_m[rows], np.exp(log_area / 2))) ** 2
    direction = rays.direction[rows]
    covariance = (along_m2 - across_m2)[:, None, None] * direction[:, :, None] * direction[:, None, :]
    covariance += across_m2[:, None, None] * np.eye(3)
    owner = objects.owner.copy()
    owner[rows] = len(objects.position_m) + np.arange(len(rows))
    return TriangulatedObjects(
        owner,
        np.concatenate([objects.position_m, position]),
        np.concatenate([objects.covariance_m2, covariance]),
        np.concatenate([objects.log_area, log_area]),
    )


def _label_sizes(rays: ObjectBearings, objects: TriangulatedObjects) -> dict[str, tuple[float, float]]:
    """Return the median and the spread of ln(projected area) for each label with at least SIZE_PRIOR_COUNT objects."""
    labels = np.empty(len(objects.position_m), object)
    labels[objects.owner[objects.owner >= 0]] = rays.label[objects.owner >= 0]
    sizes = {}
    for label in sorted(set(labels.tolist())):
        area = objects.log_area[(labels == label) & np.isfinite(objects.log_area)]
        if len(area) >= SIZE_PRIOR_COUNT:
            median = float(np.median(area))
            spread = 1.4826 * float(np.median(np.abs(area - median)))
            sizes[label] = median, max(spread, MIN_SIZE_SPREAD_LOG)
    return sizes


def _associate(rays: ObjectBearings, sizes: dict[str, tuple[float, float]]) -> TriangulatedObjects:
    owner = np.full(len(rays.frame), -1)
    position, covariance, area = [np.zeros((0, 3))], [np.zeros((0, 3, 3))], [np.zeros(0)]
    count = 0
    for label in sorted(set(rays.label.tolist())):
        rows = np.flatnonzero(rays.label == label)
        for members in _LabelRays(rays, rows, sizes.get(label)).objects():
            chosen = rows[members]
            target = np.zeros(len(chosen), int)
            origin, direction = rays.origin_m[chosen], rays.direction[chosen]
            point = meeting_points(origin, direction, target, 1)
            range_m = np.linalg.norm(point - origin, axis=1)
            log_area = np.log(rays.solid_angle_sr[chosen]) + 2 * np.log(range_m)
            mean_area = float(np.nanmean(log_area)) if np.isfinite(log_area).any() else np.nan
            error_rad = _bearing_error(range_m, np.exp(np.nan_to_num(mean_area) / 2))
            owner[chosen] = count
            position.append(point)
            covariance.append(position_covariance(origin, point[0], error_rad)[None])
            area.append(np.array([mean_area]))
            count += 1
    return TriangulatedObjects(owner, np.concatenate(position), np.concatenate(covariance), np.concatenate(area))


def _bearing_error(range_m: np.ndarray, side_m: np.ndarray | float) -> np.ndarray:
    """Return the standard deviation (rad) of the bearing of an object at range `range_m` with sides of `side_m`."""
    centre_m2 = CENTRE_ERROR_M**2 + (SIDE_ERROR_SHARE * side_m) ** 2
    return np.sqrt(BEARING_ERROR_RAD**2 + centre_m2 / np.maximum(range_m, 0.3) ** 2)


class _LabelRays:
    """The n rays of one label. The method `objects` associates the rays with objects."""

    def __init__(self, rays: ObjectBearings, rows: np.ndarray, size: tuple[float, float] | None) -> None:
        self._origin, self._direction = rays.origin_m[rows], rays.direction[rows]
        self._frame, self._log_sr = rays.frame[rows], np.log(rays.solid_angle_sr[rows])
        self._size = size
        self._group_of_frame = rays.group
        self._group = rays.group[self._frame]
        frames, first = np.unique(rays.frame, return_index=True)
        self._camera_frame, self._camera_m = frames, rays.origin_m[first]
        self._density = np.log(max(len(rows) / len(frames), 0.05) / CLUTTER_SR)

    def objects(self) -> list[np.ndarray]:
        """Return for each object the indices of its rays among the n rays, best object first."""
        groups = np.unique(self._group[self._group >= 0]).tolist()
        candidates = [candidate for group in groups for candidate in self._candidates(group)]
        taken = np.zeros(len(self._frame), bool)
        chosen = []
        # A hypothesis whose rays were taken is evaluated again without them, when its turn comes.
        candidates.sort(key=lambda candidate: (-candidate[0], candidate[1].tolist()))
        for log_ratio, members, share in candidates:
            free = ~taken[members]
            if not free.all():
                if free.sum() < 2 or log_ratio - share[~free].sum() <= MIN_LOG_RATIO:
                    continue
                members = members[free]
                if self._parallax(members) < MIN_PARALLAX_RAD:
                    continue
            taken[members] = True
            chosen.append(members)
        return chosen

    def _parallax(self, members: np.ndarray) -> float:
        direction = self._direction[members]
        return float(np.arccos(np.clip((direction @ direction.T).min(), -1, 1)))

    def _candidates(self, group: int) -> list[tuple[float, np.ndarray, np.ndarray]]:
        """Return the hypotheses of objects near the panoramas of a place: the log likelihood ratio of each, its rays,
        and the contribution of each ray to this ratio."""
        of_place = self._group == group
        if not of_place.any():
            return []
        place_m = self._camera_m[self._group_of_frame[self._camera_frame] == group]
        near = (self._group == -1) & (cdist(self._origin, place_m).min(1) < MAX_RANGE_M)
        rows = np.flatnonzero(of_place | near)
        a, b = np.triu_indices(len(rows), 1)
        a, b = rows[a], rows[b]
        apart = (self._frame[a] != self._frame[b]) & (of_place[a] | of_place[b])
        a, b = a[apart], b[apart]
        point, range_a, range_b, parallax = _meet(
            self._origin[a], self._direction[a], self._origin[b], self._direction[b]
        )
        sound = (parallax > MIN_PARALLAX_RAD) & (range_a > MIN_RANGE_M) & (range_b > MIN_RANGE_M)
        sound &= (range_a < MAX_RANGE_M) & (range_b < MAX_RANGE_M)
        a, b, point = a[sound], b[sound], point[sound]
        if not len(a):
            return []
        area = np.nanmean(self._areas(point, np.stack([a, b], 1)), 1)
        fit, deviation = self._fit(point, rows, area)
        index = {row: column for column, row in enumerate(rows.tolist())}
        pair = np.arange(len(a))
        columns = np.array([[index[i], index[j]] for i, j in zip(a.tolist(), b.tolist(), strict=True)])
        sound = (deviation[pair[:, None], columns] < MAX_SIGMAS).all(1)
        point, fit, deviation = point[sound], fit[sound], deviation[sound]
        # Each panorama contributes its best bearing or, without a bearing that fits, a missed detection.
        fit = np.where(deviation < MAX_SIGMAS, fit, -np.inf)
        frames, column_frame = np.unique(self._frame[rows], return_inverse=True)
        camera = self._group_of_frame[self._camera_frame] == group
        missed = np.zeros(len(point))
        log_missed = (cdist(point, self._camera_m[camera]) < MAX_RANGE_M) * np.log(1 - DETECTION)
        missed += log_missed.sum(1)
        best = np.full((len(point), len(frames)), -1)
        gain = np.full((len(point), len(frames)), -np.inf)
        for number in range(len(frames)):
            columns = np.flatnonzero(column_frame == number)
            winner = columns[fit[:, columns].argmax(1)]
            best[:, number], gain[:, number] = winner, fit[np.arange(len(point)), winner]
            if self._group_of_frame[frames[number]] == group:
                gain[:, number] -= np.log(1 - DETECTION)  # the detection replaces the miss counted above
        used = gain > 0
        total = missed + np.where(used, gain, 0).sum(1)
        if self._size is not None:
            median, spread = self._size
            mean_area = np.full(len(point), np.nan)
            for number in np.flatnonzero(used.any(1)).tolist():
                members = rows[best[number][used[number]]]
                mean_area[number] = self._areas(point[[number]], members[None]).mean()
            prior = np.log(AREA_SPAN_LOG / (np.sqrt(2 * np.pi) * spread)) - 0.5 * ((mean_area - median) / spread) ** 2
            total += np.nan_to_num(prior)
        valid = np.flatnonzero((total > MIN_LOG_RATIO) & (used.sum(1) >= 2))
        return [(float(total[k]), rows[best[k][used[k]]], gain[k][used[k]]) for k in valid.tolist()]

    def _areas(self, point: np.ndarray, members: np.ndarray) -> np.ndarray:
        """Return ln(projected area) (H, k) of hypotheses at points (H, 3), computed from each of their k rays."""
        offset = point[:, None] - self._origin[members]
        return self._log_sr[members] + np.log((offset * offset).sum(-1))

    def _fit(self, point: np.ndarray, rows: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the log ratio (H, n) of each ray as a detection of each hypothesis, and the angle (H, n) between ray
        and hypothesis in standard deviations."""
        offset = point[:, None] - self._origin[rows]
        range_m = np.maximum(np.linalg.norm(offset, axis=2), 1e-6)
        along = np.einsum("hnk,nk->hn", offset, self._direction[rows])
        angle = np.arccos(np.clip(along / range_m, -1, 1))
        sigma = _bearing_error(range_m, np.exp(np.nan_to_num(area) / 2)[:, None])
        deviation = angle / sigma
        log_density = -0.5 * deviation**2 - np.log(2 * np.pi * sigma**2)
        size = (self._log_sr[rows] + 2 * np.log(range_m) - area[:, None]) / SIZE_ERROR_LOG
        log_size = np.log(AREA_SPAN_LOG / (np.sqrt(2 * np.pi) * SIZE_ERROR_LOG)) - 0.5 * size**2
        fit = np.log(DETECTION) + log_density - self._density + np.nan_to_num(log_size)
        return np.where(range_m < MAX_RANGE_M, fit, -np.inf), deviation


def _meet(
    origin_a: np.ndarray, direction_a: np.ndarray, origin_b: np.ndarray, direction_b: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the points (P, 3) halfway between the nearest points of P pairs of rays, both ranges, and the parallax."""
    cosine = np.einsum("pk,pk->p", direction_a, direction_b)
    baseline = origin_b - origin_a
    to_a = np.einsum("pk,pk->p", baseline, direction_a)
    to_b = np.einsum("pk,pk->p", baseline, direction_b)
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    range_a, range_b = (to_a - cosine * to_b) / sine2, (cosine * to_a - to_b) / sine2
    point = (origin_a + range_a[:, None] * direction_a + origin_b + range_b[:, None] * direction_b) / 2
    return point, range_a, range_b, np.arccos(np.clip(cosine, -1, 1))
