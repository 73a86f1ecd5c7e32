"""Views of a query that were taken far apart, perhaps in several places: groups of views, and the rule that names the
place of the last view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from salframe.framework.validation import Settings
from salframe.panoramas.geometry import as_complex, pose_yaw
from salframe_graphs.places.poses import Poses

_MOTIONS = "T_last_group"
"""Key of the motions of the groups in a description."""


class DistantViews(Settings):
    """Settings for the views of a query that were taken far apart, in a map without floor masks."""

    near_m: float = Field(
        2.5,
        ge=0,
        description="maximum distance (m) between the final view of a group and the other views of this group. Only "
        "used in a map without floor masks: there, successive views of a query form groups, and each group is assumed "
        "to be in one place",
    )
    window_m: float = Field(
        5.0,
        gt=0,
        description="radius (m) of the window of a candidate place. The window contains all objects within this "
        "distance of a reference frame of the place, even objects of other places. If a query has several groups of "
        "views (see `distant_views.near_m`), all its views are matched with the window to estimate the pose",
    )
    same_place_m: float = Field(
        2.0,
        gt=0,
        description="distance (m) between two views at which the probability that they are in the same place is 1/e",
    )


@dataclass(frozen=True, eq=False)
class ViewGroup:
    """Views of a query that were joined because they are near to each other.

    Attributes:
        description: The joined description, in the frame of the last view of the group.
        T_last_group: (4, 4) transform from the frame of the group's last view to the frame of the query's last view.
    """

    description: Mapping[str, np.ndarray]
    T_last_group: np.ndarray

    @property
    def distance_m(self) -> float:
        """Distance in metres between the last view of this group and the last view of the query."""
        return float(np.linalg.norm(self.T_last_group[:3, 3]))

    def poses(self, position_m: np.ndarray, yaw_rad: float, count: int) -> Poses:
        """Return the world pose of the last view of this group, computed from that of the last view of the query, and
        repeated for `count` places.

        Args:
            position_m: (2,) world position of the last view of the query, in metres.
            yaw_rad: World yaw of the last view of the query.
            count: Number of places.
        """
        offset = np.exp(1j * yaw_rad) * as_complex(self.T_last_group[None, :2, 3])
        moved_m = position_m + np.array([offset[0].real, offset[0].imag])
        yaw = yaw_rad + pose_yaw(self.T_last_group)
        return Poses(np.arange(count), np.tile(moved_m, (count, 1)), np.full(count, yaw))


def group_views(T_last_view: np.ndarray, near_m: float) -> list[range]:
    """Group the views of a query, and return the indices of the views of each group, in the order of the views.

    Args:
        T_last_view: (V, 4, 4) transforms from the frame of each view to the frame of the last view.
        near_m: Maximum distance of a view from the last view of its group, in metres.
    """
    position_m = T_last_view[:, :3, 3]
    groups: list[range] = []
    end = len(position_m)
    while end:
        start = end - 1
        while start and np.linalg.norm(position_m[start - 1] - position_m[end - 1]) <= near_m:
            start -= 1
        groups.insert(0, range(start, end))
        end = start
    return groups


def groups_to_arrays(groups: Sequence[ViewGroup]) -> dict[str, np.ndarray]:
    """Return groups of distant views as arrays that the description of a query can contain."""
    arrays = {f"{n}/{name}": array for n, group in enumerate(groups) for name, array in group.description.items()}
    return {_MOTIONS: np.stack([group.T_last_group for group in groups]), **arrays}


def groups_from_arrays(arrays: Mapping[str, np.ndarray]) -> list[ViewGroup]:
    """Return the groups that `groups_to_arrays` stored in a description; an empty list if it has no groups."""
    groups = []
    for number, T_last_group in enumerate(arrays.get(_MOTIONS, ())):
        prefix = f"{number}/"
        parts = {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
        groups.append(ViewGroup(parts, T_last_group))
    return groups


def combine_groups(scores: Sequence[np.ndarray | None], distance_m: Sequence[float], same_place_m: float) -> np.ndarray:
    """Return the score (K,) of each place for the last view of a query.

    The score is the score of the last group plus, for each earlier group, ln(rho p + (1 - rho) / K). Here, p is the
    softmax of the group's scores, and rho = exp(-d / same_place_m) is the probability that a group at the distance d is
    in the place of the last view.

    Args:
        scores: The scores (K,) of the places for each group; None if a group gives no evidence.
        distance_m: The distance of each group from the last view, in metres.
        same_place_m: Distance at which rho is 1/e.
    """
    num_places = next(len(score) for score in scores if score is not None)
    total = np.zeros(num_places) if scores[-1] is None else scores[-1].copy()
    for score, distance in zip(scores[:-1], distance_m[:-1], strict=True):
        if score is not None:
            rho = np.exp(-distance / same_place_m)
            total += np.log(rho * np.exp(score - np.logaddexp.reduce(score)) + (1 - rho) / num_places)
    return total
