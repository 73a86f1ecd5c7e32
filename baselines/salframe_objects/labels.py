"""Places as weighted sets of labels: the base class of the localizers `objects` and `salient-objects`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from salframe.graphs.vocabulary import unknown_labels
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.localizer import Description, Localizer
from salframe.localization.ranking import rank_places
from salframe.panoramas.frames import ReferenceFrame


class WeightedLabels(Localizer):
    """Weighted Jaccard index of labels: J = sum_l min(w_l, w'_l) / sum_l max(w_l, w'_l) over the labels l of query and
    reference frame. The method gives no pose.

    Weights of 1 give the Jaccard index of sets, and object counts give the Jaccard index of multisets. A description
    contains each label once, in `labels` (L,).
    """

    @abstractmethod
    def weigh(self, description: Description) -> np.ndarray:
        """Return the weight (L,) float64 of each label of a description."""

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        self._frames = list(frames)
        self._vocabulary = {
            label: i for i, label in enumerate(sorted({str(label) for d in descriptions for label in d["labels"]}))
        }
        self._weights = np.zeros((len(self._vocabulary), len(frames)))
        for scene, description in enumerate(descriptions):
            rows = [self._vocabulary[str(label)] for label in description["labels"]]
            self._weights[rows, scene] = self.weigh(description)

    def match(self, description: Description) -> Localization:
        weight = self.weigh(description)
        if not len(weight):
            return Localization((), None, LocalizationStatus.NO_OBJECTS)
        row = np.array([self._vocabulary.get(str(label), -1) for label in description["labels"]])
        in_map = row >= 0
        shared = np.minimum(self._weights[row[in_map]], weight[in_map, None]).sum(0)
        score = shared / (self._weights.sum(0) + weight.sum() - shared)
        places = rank_places(self._frames, np.where(score > 0, score, -np.inf))
        return Localization(places, None, LocalizationStatus.NO_POSE if places else LocalizationStatus.NO_MATCH)

    def unknown_labels(self, description: Description) -> tuple[str, ...]:
        return unknown_labels(description, self._vocabulary)
