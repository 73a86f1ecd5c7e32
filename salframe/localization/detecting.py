"""Base of localizers that describe a panorama by the objects that a detector detects."""

from __future__ import annotations

from abc import abstractmethod

from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.vocabulary import without_moving_objects
from salframe.localization.localizer import Description, Localizer
from salframe.panoramas.panorama import Panorama


class DetectingLocalizer(Localizer):
    """Base of localizers whose setting `detector` selects the detector. The localizer has the `needs`, the
    `column_step` and the `turn_tolerance_m` of this detector."""

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._detector = registry().build("detector", self.config.detector)

    @property
    def detector(self) -> Detector:
        """The detector."""
        detector: Detector = self._detector
        return detector

    def describe_detections(self, detections: Detections, panorama: Panorama) -> Description:
        """Return the description of a panorama from its detections, without objects that move by themselves or are
        carried: people, pets and bags. Arguments are those of `describe_objects`."""
        return self.describe_objects(without_moving_objects(detections), panorama)

    @abstractmethod
    def describe_objects(self, detections: Detections, panorama: Panorama) -> Description:
        """Return the description of a panorama from its detections.

        Args:
            detections: The detections, in the panorama frame.
            panorama: The panorama. If only its detections are known, it contains no images and no annotations.
        """

    def describe(self, panorama: Panorama) -> Description:
        return self.describe_detections(self._detector.detect(panorama), panorama)

    @property
    def needs(self) -> frozenset[str]:
        needs: frozenset[str] = self._detector.needs
        return needs

    @property
    def column_step(self) -> int | None:  # type: ignore[override]
        """Number of pixel columns of one rotation step of the detector (`Detector.column_step`)."""
        step: int = self._detector.column_step
        return step

    @property
    def turn_tolerance_m(self) -> float:  # type: ignore[override]
        """Maximum change of the detections if the panorama is rotated, in metres (`Detector.turn_tolerance_m`)."""
        tolerance_m: float = self._detector.turn_tolerance_m
        return tolerance_m
