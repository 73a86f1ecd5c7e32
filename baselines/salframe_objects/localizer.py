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
    """Jaccard index of the label sets of query and map; gives a place and no pose."""

    name = "objects"
    version = "3"

    class Config(LevelledConfig):
        range: range_slot()  # type: ignore[valid-type]
        detector: slot("detector", "auto")  # type: ignore[valid-type]
        labels: Literal["set", "multiset"] = match_only(
            "set",
            description="comparison of the labels of two panoramas. set: without their counts; multiset: with "
            "their counts",
        )
        posterior: posterior_slot()  # type: ignore[valid-type]

    def describe_detections(self, detections: Detections, panorama: Panorama) -> Description:
        names = np.array(with_object_labels(detections).labels, dtype=np.str_)
        labels, counts = np.unique(names, return_counts=True)
        return {"labels": labels, "counts": counts, **written_labels(detections)}

    def weigh(self, description: Description) -> np.ndarray:
        return (
            np.ones(len(description["labels"]))
            if self.config.labels == "set"
            else np.asarray(description["counts"], float)
        )

    def pack(self, description: Description) -> Description:
        return {"labels": description["labels"], "counts": description["counts"].astype(np.uint16)}


class SalientObjectsLocalizer(SalientObjects, WeightedLabels):
    """Jaccard index of labels weighted by their saliency; gives a place and no pose.

    J = sum_l min(w_l, w'_l) / sum_l max(w_l, w'_l), where w_l is the sum of S^p over the objects with the label l in
    the query, w'_l the sum in the reference frame, S the saliency and p = `saliency_power`. The paper names
    "a collection of salient objects" without a formula. A weight of each object instead of a threshold is our
    interpretation. p = 1/3 was the best of 0.33, 0.5 and 1 on tuning buildings.
    """

    name = "salient-objects"
    version = "3"

    def describe_detections(self, detections: Detections, panorama: Panorama) -> Description:
        names = np.array(with_object_labels(detections).labels, dtype=np.str_)
        labels, of_object = np.unique(names, return_inverse=True)
        weight = np.bincount(of_object, self.weigh_objects(detections), len(labels))
        return {"labels": labels, "weight": weight, **written_labels(detections)}

    def weigh(self, description: Description) -> np.ndarray:
        return description["weight"]
