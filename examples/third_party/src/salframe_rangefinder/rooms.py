"""A data set without files: random rooms with boxes along their walls, as measured by a range finder."""

from functools import lru_cache, partial

import numpy as np
from pydantic import Field

import salframe
from salframe.framework.components.identity import identity
from salframe.framework.files.hashes import digest

EYE_M, PITCH_M = 1.5, 10.0


class BoxRooms(salframe.Dataset):
    """A row of rooms with boxes along their walls, each with a reference frame in the middle and a query near it."""

    name = "box-rooms"
    version = "1"
    provides = frozenset({"range"})

    class Config(salframe.ComponentConfig):
        rooms: int = Field(4, ge=1, description="number of rooms")
        boxes: int = Field(6, ge=1, description="number of boxes per room")
        shift_m: float = Field(
            0.3, ge=0, le=1, description="maximum offset of a query from the reference frame along x and y"
        )
        height: int = Field(128, ge=32, description="height of a panorama in pixels")
        seed: int = Field(0, ge=0, description="seed of rooms and queries")

    @property
    def fingerprint(self):
        return digest(identity(self.config))  # the data depend on the settings only

    def folds(self):
        references = []
        for number in range(self.config.rooms):
            id, pose = f"room-{number}/map", salframe.pose_2d(PITCH_M * number, 0, 0, EYE_M)
            references.append(salframe.ReferenceFrame(id, f"room-{number}", pose, load=partial(self._look, id, pose)))
        queries = [
            salframe.QueryFrame(id, partial(self._look, id, self.truth(id).T_world_pano)) for id in self._queries
        ]
        return [salframe.Fold("all", tuple(references), tuple(queries))]

    def truth(self, query_id):
        if query_id not in self._queries:
            raise salframe.DataError(f"the dataset {self.name} has no query {query_id!r}")
        number = self._queries.index(query_id)
        rng = np.random.default_rng((self.config.seed, number, 1))
        x_m, y_m = rng.uniform(-self.config.shift_m, self.config.shift_m, 2)
        return salframe.Truth(
            f"room-{number}", salframe.pose_2d(PITCH_M * number + x_m, y_m, rng.uniform(-np.pi, np.pi), EYE_M)
        )

    @property
    def _queries(self):
        return [f"room-{number}/query" for number in range(self.config.rooms)]

    def _look(self, id, pose):
        number = round(pose[0, 3] / PITCH_M)
        low_m, high_m = draw_room(self.config.seed, number, self.config.boxes)
        eye_m = pose[:3, 3] - (PITCH_M * number, 0, 0)
        rays = salframe.equirectangular_rays(self.config.height).astype(float) @ pose[:3, :3].T
        with np.errstate(divide="ignore"):
            sides_m = (np.stack([low_m, high_m]) - eye_m)[:, :, None, None] / rays
        enters_m, leaves_m = sides_m.min(0).max(-1), sides_m.max(0).min(-1)
        boxes_m = np.where((enters_m > 0) & (enters_m < leaves_m), enters_m, np.inf)[1:].min(0)
        return salframe.Panorama(id, range_m=np.minimum(leaves_m[0], boxes_m).astype(np.float32))


@lru_cache
def draw_room(seed, number, boxes):
    """Return the low and high corners (1 + boxes, 3), in metres, of a room centred at x = y = 0 and of its boxes."""
    rng = np.random.default_rng((seed, number, 0))
    half_m = rng.uniform((2.2, 2.0), (3.5, 3.0))
    size_m = rng.uniform((0.3, 0.3, 0.4), (0.8, 0.8, 2.1), (boxes, 3))
    middle_m = rng.uniform(-1, 1, (boxes, 2)) * half_m
    axis = rng.integers(0, 2, boxes)
    rows = np.arange(boxes)
    middle_m[rows, axis] = rng.choice((-1, 1), boxes) * (half_m[axis] - size_m[rows, axis] / 2)  # along a wall
    low_m = np.column_stack([np.clip(middle_m - size_m[:, :2] / 2, -half_m, half_m), np.zeros(boxes)])
    high_m = np.column_stack([np.clip(middle_m + size_m[:, :2] / 2, -half_m, half_m), size_m[:, 2]])
    return np.vstack([[*-half_m, 0], low_m]), np.vstack([[*half_m, 2.6], high_m])
