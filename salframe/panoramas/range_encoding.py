"""Encoding of a 16-bit range image: unit, values for unknown range, and kind of depth."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.geometry import cube_depth_of_range, range_of_cube_depth

MILLIMETRE = 0.001
"""Default unit of a range image in metres."""
MAX_STEP = int(np.iinfo(np.uint16).max)
"""Largest value of a 16-bit image."""


class RangeKind(StrEnum):
    """Quantity that the values of a range image measure.

    RAY: range along the ray. Z: depth along the optical axis, of a photograph. CUBE: depth along the axis of the cube
    face that shows the pixel, of an equirectangular image resampled from the six faces of a cube.
    """

    RAY = "ray"
    Z = "z"
    CUBE = "cube"


@dataclass(frozen=True)
class RangeEncoding:
    """The encoding of a range image. A value of 0 always means an unknown range.

    Attributes:
        unit_m: Metres per step of the stored integers.
        missing: Further values that mean an unknown range.
        kind: Quantity that the values measure.

    Raises:
        DataError: A value is out of its range.
    """

    unit_m: float = MILLIMETRE
    missing: tuple[int, ...] = ()
    kind: RangeKind | str = RangeKind.RAY

    def __post_init__(self) -> None:
        if not (isinstance(self.unit_m, int | float) and 0 < self.unit_m < np.inf):
            raise DataError(
                f"the setting range_unit_m is {self.unit_m!r}, expected the metres per unit of the range image, a "
                "number above 0, such as 0.001 for millimetres"
            )
        for value in self.missing:
            if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MAX_STEP:
                raise DataError(
                    f"the setting range_missing has the value {value!r}, expected integers from 0 to {MAX_STEP}"
                )
        try:
            object.__setattr__(self, "kind", RangeKind(self.kind))
        except ValueError:
            raise DataError(
                f"the setting range_kind is {self.kind!r}, expected one of {', '.join(RangeKind)}"
            ) from None

    def panorama_range(self, steps: np.ndarray) -> np.ndarray:
        """Return the range along the ray of a panorama in metres, (H, 2H) float32, NaN where unknown.

        Args:
            steps: (H, 2H) integer values of the file.

        Raises:
            DataError: The encoding is of the kind Z, or it is of the kind CUBE and the shape of `steps` is not (H, 2H).
        """
        self.check_panorama()
        depth_m = self._metres(steps)
        if self.kind != RangeKind.CUBE:
            return depth_m
        height, width = steps.shape
        if width != 2 * height:
            raise DataError(f"the range image is {width} x {height}, expected width = 2 x height (equirectangular)")
        return range_of_cube_depth(depth_m).astype(np.float32)

    def photograph_depth(self, steps: np.ndarray) -> np.ndarray:
        """Return the depth of a photograph in metres, of the kind of this encoding, (h, w) float32, NaN where unknown.

        Args:
            steps: (h, w) integer values of the file.

        Raises:
            DataError: The kind is CUBE.
        """
        if self.kind == RangeKind.CUBE:
            raise DataError(
                "the setting range_kind is 'cube' for a photograph, expected 'z' (depth along the optical axis) or "
                "'ray'"
            )
        return self._metres(steps)

    def panorama_steps(self, range_m: np.ndarray) -> np.ndarray:
        """Convert ranges along the ray to the pixel values of an image file, (H, 2H) uint16.

        This is the inverse of `panorama_range`. NaN and ranges above the 16-bit limit become 0.

        Args:
            range_m: (H, 2H) range along the ray in metres.

        Raises:
            DataError: The kind is Z.
        """
        self.check_panorama()
        depth_m = np.nan_to_num(range_m.astype(np.float64))
        if self.kind == RangeKind.CUBE:
            depth_m = cube_depth_of_range(depth_m)
        steps = np.round(depth_m / self.unit_m)
        return np.where(steps <= MAX_STEP, steps, 0).astype(np.uint16)

    def check_panorama(self) -> None:
        """Check that a panorama can have this encoding. Raises DataError."""
        if self.kind == RangeKind.Z:
            raise DataError(
                "the setting range_kind is 'z' for a panorama, which has no optical axis, expected 'ray', or 'cube' "
                "(depth along the axis of the cube face of each pixel)"
            )

    def _metres(self, steps: np.ndarray) -> np.ndarray:
        is_known = (steps > 0) & ~np.isin(steps, self.missing)
        return np.where(is_known, steps * self.unit_m, np.nan).astype(np.float32)
