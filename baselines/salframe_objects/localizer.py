"""The localizers `objects` and `salient-objects`, which compare labels (the paper's rows "objects" and "salient
objects")."""

from __future__ import annotations

from typing import Literal

import numpy as np

from salframe.framework.component import match_only
from salframe.framework.components.slots import slot
from salframe.graphs.detections import Detections
from salframe.graphs.vocabulary import with_object_labels, written_labels
from salframe.localization.detecting import DetectingLocalizer
from salframe.localization.localizer import Description, LevelledConfig, posterior_slot, range_slot
from salframe.panoramas.panorama import Panorama
from salframe_objects.labels import WeightedLabels
from salframe_objects.salient import SalientObjects


class ObjectSetLocalizer(DetectingLocalizer, WeightedLabels):
    """Compares the object labels of query and reference frame by the Jaccard index. It gives a place and no pose."""

    name = "objects"
    version = "4"

    class Config(LevelledConfig):
        range: range_slot()  # type: ignore[valid-type]
        detector: slot("detector", "auto")  # type: ignore[valid-type]
        labels: Literal["set", "multiset"] = match_only(
            "set",
            description="how the labels of two panoramas are compared. set: each label counts once; multiset: each "
            "label counts as often as it occurs",
        )
        posterior: posterior_slot()  # type: ignore[valid-type]

    def describe_objects(self, detections: Detections, panorama: Panorama) -> Description:
        names = np.array(with_object_labels(detections).labels, dtype=np.str_)
        labels, counts = np.unique(names, return_counts=True)
        return {"labels": labels, "counts": counts, **written_labels(detections)}

    def weigh(self, description: Description) -> np.ndarray:
        return (
            np.ones(len(description["labels"]))
            if self.config.labels == "set"
            else np.asarray(description["counts"], float)
        )

    def count_objects(self, description: Description) -> int:
        return int(np.sum(description["counts"]))

    def pack(self, description: Description) -> Description:
        return {"labels": description["labels"], "counts": description["counts"].astype(np.uint16)}


class SalientObjectsLocalizer(SalientObjects, WeightedLabels):
    """Compares the object labels of query and reference frame, weighted by saliency. It gives a place and no pose.

    The score is the weighted Jaccard index J = sum_l min(w_l, w'_l) / sum_l max(w_l, w'_l) over all labels l:

    - w_l: sum of S^p over the objects with the label l in the query
    - w'_l: the same sum in the reference frame
    - S: saliency of an object
    - p: the setting `saliency_power`

    The paper compares with a method "salient objects", but gives no formula. The formula above is ours.
    """

    name = "salient-objects"
    version = "4"

    def describe_objects(self, detections: Detections, panorama: Panorama) -> Description:
        names = np.array(with_object_labels(detections).labels, dtype=np.str_)
        labels, of_object = np.unique(names, return_inverse=True)
        weight = np.bincount(of_object, self.weigh_objects(detections), len(labels))
        return {"labels": labels, "weight": weight, **written_labels(detections)}

    def weigh(self, description: Description) -> np.ndarray:
        return description["weight"]
