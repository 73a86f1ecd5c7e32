"""Floors seen from above, as masks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from salframe.framework.arrays import check_array
from salframe.framework.errors import DataError


@dataclass(frozen=True, eq=False)
class FloorMasks:
    """A floor seen from above. Row 0 is at the largest y, so that the picture reads like a map.

    free, region (rows, columns): bool free floor before obstacles, int32 region label (0 outside); obstacle bool. Pixel
    (row, column) covers x = origin_m[0] + column * resolution_m, y = origin_m[1] - row * resolution_m at its upper left
    corner. regions: label -> place. z_m is the floor's height in the world: a frame belongs to the highest floor below
    it. Raises DataError on masks of different sizes.
    """

    free: np.ndarray
    region: np.ndarray
    obstacle: np.ndarray
    resolution_m: float
    origin_m: tuple[float, float]
    regions: Mapping[int, str]
    z_m: float = 0.0

    def __post_init__(self) -> None:
        shape = check_array(self, "free", np.bool_, None, None).shape
        for name, dtype in (("region", np.int32), ("obstacle", np.bool_)):
            got = check_array(self, name, dtype, None, None).shape
            if got != shape:
                raise DataError(
                    f"the {name} mask of a floor is {got[1]} x {got[0]} pixels, "
                    f"expected {shape[1]} x {shape[0]} as its free mask"
                )
        if not self.resolution_m > 0:
            raise DataError(
                f"the masks of a floor have a resolution of {self.resolution_m} m a pixel, expected more than 0"
            )
