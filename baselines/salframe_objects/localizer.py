"""The localizer `objects`: which labels are there, and nothing else (the paper's "objects (Jaccard)" row)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.config import ComponentConfig, identity, slot
from salframe.localizer import Description, Localizer, rank_places
from salframe.registry import registry
from salframe.types import Localization, MapFrame, Panorama


class ObjectSetLocalizer(Localizer):
    """Jaccard index of the label sets of query and map; gives a place and no pose."""

    name = "objects"
    version = "1"

    class Config(ComponentConfig):
        detector: slot("detector", "annotations")  # type: ignore[valid-type]
        labels: Literal["set", "multiset"] = Field("set", description="which labels are there, or how many of each")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._detector = registry().build("detector", self.config.detector)

    @property
    def needs(self) -> frozenset[str]:
        return self._detector.needs

    def describe_identity(self) -> dict:
        return {"localizer": self.name, "version": self.version, "detector": identity(self.config.detector)}

    def describe(self, panorama: Panorama) -> Description:
        labels, counts = np.unique(np.array(self._detector.detect(panorama).labels, dtype=np.str_), return_counts=True)
        return {"labels": labels, "counts": counts}

    def index(self, descriptions: Sequence[Description], frames: Sequence[MapFrame]) -> None:
        self._map_frames = list(frames)
        self._vocabulary = {label: i for i, label in enumerate(sorted({str(label) for d in descriptions for label in d["labels"]}))}
        self._counts = np.zeros((len(self._vocabulary), len(frames)))
        for scene, description in enumerate(descriptions):
            rows = [self._vocabulary[str(label)] for label in description["labels"]]
            self._counts[rows, scene] = self._numbers(description)

    def match(self, description: Description) -> Localization:
        number = self._numbers(description)
        if not len(number):
            return Localization((), None, "no-objects")
        row = np.array([self._vocabulary.get(str(label), -1) for label in description["labels"]])
        known = row >= 0
        shared = np.minimum(self._counts[row[known]], number[known, None]).sum(0)
        score = shared / (self._counts.sum(0) + number.sum() - shared)
        places = rank_places(self._map_frames, np.where(score > 0, score, -np.inf))
        return Localization(places, None, "no-pose" if places else "no-match")

    def scene_bytes(self, description: Description) -> int:
        """A 16-bit label index each, and a byte for the number where numbers are kept."""
        return len(description["labels"]) * (2 if self.config.labels == "set" else 3)

    def _numbers(self, description: Description) -> np.ndarray:
        return np.ones(len(description["labels"])) if self.config.labels == "set" else np.asarray(description["counts"], float)
