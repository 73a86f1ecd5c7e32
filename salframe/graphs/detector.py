"""The role `detector`: detects objects in a panorama."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

from salframe.framework.component import Role
from salframe.graphs.detections import Detections
from salframe.panoramas.panorama import Panorama


class Detector(Role):
    """Detects objects in a panorama."""

    role = "detector"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb", "range"})
    """Parts of a panorama that `detect` requires, of "rgb", "range" and "annotations"."""
    column_step: ClassVar[int] = 1
    """Number of pixel columns of one rotation step. If the panorama is rotated by a multiple of this step, the
    detections rotate by the same angle and do not change otherwise. For other rotations, this holds within 2 degrees
    for 95 % of the detections."""
    turn_tolerance_m: ClassVar[float] = 1e-4
    """Maximum change of a centroid and of a size in metres, apart from the rotation itself, if the panorama is rotated
    by a multiple of `column_step`."""

    @classmethod
    def noise_in(cls, config: Any, rendered: bool) -> str | None:
        """Return the name of the noise that this detector adds to annotations; None if it adds none.

        Args:
            config: Settings of the detector.
            rendered: Whether the panoramas are rendered; otherwise they are real.
        """
        return None

    @abstractmethod
    def detect(self, panorama: Panorama) -> Detections:
        """Return the objects of a panorama, in the panorama frame.

        Must not change its input. The same input must give the same output.
        """
