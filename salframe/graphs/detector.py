"""The role `detector`: objects in a panorama."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

from salframe.framework.component import Role
from salframe.graphs.detections import Detections
from salframe.panoramas.panorama import Panorama


class Detector(Role):
    """Finds objects in a panorama."""

    role = "detector"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb", "range"})
    column_step: ClassVar[int] = 1
    """Turning the panorama by a multiple of this many columns turns the objects and nothing else; by others, 95 % of
    them within 2 degrees."""
    turn_tolerance_m: ClassVar[float] = 1e-4
    """How far a centroid may move (metres) and a size change when the panorama turns by a multiple of `column_step`."""

    @classmethod
    def noise_in(cls, config: Any, rendered: bool) -> str | None:
        """The name of the errors that it puts into annotations, those of a renderer or of real panoramas; None where it
        puts in none."""
        return None

    @abstractmethod
    def detect(self, panorama: Panorama) -> Detections:
        """The objects of a panorama, in its frame. Must not change its input; the same input gives the same output."""
