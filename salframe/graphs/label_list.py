"""The labels of the annotated objects of a dataset, and their names in the vocabulary."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum

from salframe.framework.errors import DataError, describe_error
from salframe.graphs.vocabulary import common_label, is_moving, is_object, near_names, object_label
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.opening import Progress
from salframe.panoramas.panorama import Panorama, visible_instances


class LabelStatus(StrEnum):
    """Whether the vocabulary has a label. MOVING: maps do not contain these objects, which are people, animals and
    bags."""

    KNOWN = "known"
    UNKNOWN = "unknown"
    NOT_OBJECT = "not an object"
    MOVING = "moving"


@dataclass(frozen=True)
class ListedLabel:
    """A label of the annotated objects of a dataset.

    Attributes:
        label: The label, after the replacements in the label table of the data folder.
        name: The `object_label` of the label. A map is matched with a query by these names.
        common: The `common_label` of the label. Different detectors are compared by these names.
        objects: Number of objects with this label that are visible in at least one panorama.
        status: Whether the vocabulary has the label.
        near: Names of the vocabulary that resemble an unknown label, best first; () for a label with another status.
    """

    label: str
    name: str
    common: str
    objects: int
    status: LabelStatus
    near: tuple[str, ...] = ()

    @classmethod
    def of(cls, label: str, objects: int) -> ListedLabel:
        """Return the entry of a label, which is looked up in the vocabulary. `objects` objects have this label."""
        name = object_label(label)
        known = is_object(name)
        status = {True: LabelStatus.KNOWN, False: LabelStatus.NOT_OBJECT, None: LabelStatus.UNKNOWN}[known]
        status = LabelStatus.MOVING if is_moving(label) else status
        return cls(label, name, common_label(label), objects, status, near_names(label) if known is None else ())


@dataclass(frozen=True)
class LabelList:
    """The labels of the annotated objects of a dataset.

    Attributes:
        labels: The labels, the most frequent first.
        failures: The one-line error of each panorama that could not be read, by id.
    """

    labels: tuple[ListedLabel, ...]
    failures: Mapping[str, str]


def list_labels(dataset: Dataset, progress: Progress | None = None) -> LabelList:
    """Return the labels of the annotated objects in all panoramas of a dataset. Panoramas that cannot be read are left
    out.

    Args:
        dataset: A prepared dataset.
        progress: Called as progress(name of the dataset, done, total) with numbers of panoramas; None: not called.

    Raises:
        DataError: No panorama has annotations.
    """
    frames: dict[str, ReferenceFrame | QueryFrame] = {}
    for fold in dataset.folds():
        frames.update((view.id, view) for query in fold.queries for view in (*query.earlier, query))
        frames.update((frame.id, frame) for frame in fold.references)
    keys: dict[str, set[Hashable]] = defaultdict(set)
    failures: dict[str, str] = {}
    num_annotated = 0
    for done, (id, frame) in enumerate(frames.items(), 1):
        try:
            panorama = frame.load()
        except DataError as error:
            failures[id] = describe_error(error)
        else:
            num_annotated += panorama.annotations is not None
            for label, key in _objects(panorama):
                keys[label].add(key)
        if progress is not None:
            progress(dataset.name, done, len(frames))
    if not num_annotated:
        first = f" (first error: {next(iter(failures.values()))})" if failures else ""
        raise DataError(
            f"none of the {len(frames)} panoramas of {dataset.name} has annotations, expected "
            f"instance images or lists of objects{first}"
        )
    listed = [ListedLabel.of(label, len(objects)) for label, objects in keys.items()]
    return LabelList(tuple(sorted(listed, key=lambda row: (-row.objects, row.label))), failures)


def _objects(panorama: Panorama) -> Iterator[tuple[str, Hashable]]:
    """Yield the label and the key of each visible object of a panorama; objects without a label are left out."""
    annotations = panorama.annotations
    if annotations is None:
        return
    if annotations.objects is not None:
        yield from zip(annotations.objects.labels, annotations.objects.keys, strict=True)
    elif annotations.instance_id is not None:
        for key in visible_instances(annotations.instance_id):
            if key in annotations.labels:
                yield annotations.labels[key], key
