"""The evidence that comes with `saliency-places`: likelihood of the objects, outline, best panorama, rare labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from salframe.framework.errors import ConfigError
from salframe.framework.files.columns import Columns
from salframe.graphs.graph import with_range
from salframe.graphs.packing import graph_from_arrays
from salframe.graphs.segments import ranges
from salframe.localization.evidence_model import EvidenceColumn, EvidenceModel, PlaceFrames, PlaceHypotheses
from salframe.localization.localizer import Description
from salframe.panoramas.panorama import Panorama
from salframe_graphs.node_pairs import label_counts
from salframe_graphs.panorama_scores import PanoramaScores
from salframe_graphs.places.heights import at_map_height, height_of
from salframe_graphs.places.map_places import MapPlaces
from salframe_graphs.places.outline import OUTLINE, MapOutlines, free_outline, pack_outline, unpack_outline
from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.poses import Poses
from salframe_graphs.places.query_objects import QueryObjects
from salframe_graphs.sectors import BINS
from salframe_graphs.views import join_outlines

PACKED_OUTLINE = "outline_mm"
"""Key of the outline of free space in a packed description."""


@dataclass(frozen=True, eq=False)
class ObjectHypotheses(PlaceHypotheses):
    """Hypotheses of `saliency-places`, with the objects that they were made from.

    Attributes:
        nodes: The objects of the query, with the vocabulary of the map.
        places: The places of the map, with their objects.
        matching: Matches the query with single panoramas of the map.
    """

    nodes: QueryObjects
    places: MapPlaces
    matching: PanoramaScores


class LikelihoodEvidence(EvidenceModel):
    """Log likelihood ratio of the objects of the query at the best pose in the place, in the column `likelihood`.

    The ratio compares two assumptions: the query shows objects of the place, or it shows objects that are not in the
    map. It is positive if the first assumption fits better. If no object of the query has a range, the bearings and
    solid angles of the objects are compared. The value is then in the column `bearing_likelihood`, and `likelihood` is
    0.
    """

    name = "likelihood"
    version = "1"
    columns = (
        EvidenceColumn(
            "likelihood",
            "log likelihood ratio (nats) of the objects of the query, at the best pose in the candidate place",
            in_posterior=True,
        ),
        EvidenceColumn(
            "bearing_likelihood",
            "log likelihood ratio (nats) of the objects of the query, at the best pose in the candidate "
            "place, if no object has a range",
        ),
    )
    uses_pose = True

    def score(self, description: Description, hypotheses: PlaceHypotheses) -> Mapping[str, np.ndarray]:
        likelihood, unused = hypotheses.likelihood, np.zeros(len(hypotheses))
        if _with_objects(self, hypotheses).nodes.num_ranged:
            return {"likelihood": likelihood, "bearing_likelihood": unused}
        return {"likelihood": unused, "bearing_likelihood": likelihood}


class OutlineEvidence(EvidenceModel):
    """Log likelihood ratio of the outline of free space at the best pose in the place, in the column `outline`.

    The outline is measured at points above the furniture, which are mostly on walls. The ratio is large if the outline
    of the query agrees with the outlines of the place. The outline also helps
    the evidence `likelihood`: walls hide the objects behind the outline, so the query need not show these objects. A
    map stores 144 bytes for each reference frame.
    """

    name = "outline"
    version = "1"
    columns = (
        EvidenceColumn(
            "outline",
            "log likelihood ratio (nats) of the outline of the free space, at the best pose in the candidate place",
            in_posterior=True,
        ),
    )
    arrays = (OUTLINE,)
    uses = frozenset({"range"})
    uses_pose = True

    def describe(self, panorama: Panorama, description: Description) -> Description:
        if panorama.range_m is None:
            return {}
        return {OUTLINE: free_outline(panorama.range_m, height_of(description))}

    def join(self, descriptions: Sequence[Description], T_last_view: np.ndarray) -> Description:
        outlines_m = [description.get(OUTLINE) for description in descriptions]
        return {} if all(o is None for o in outlines_m) else {OUTLINE: join_outlines(outlines_m, T_last_view)}

    def pack(self, description: Description) -> Description:
        return {PACKED_OUTLINE: pack_outline(description[OUTLINE])} if OUTLINE in description else {}

    def unpack(self, packed: Description) -> Description:
        return {OUTLINE: unpack_outline(packed[PACKED_OUTLINE])} if PACKED_OUTLINE in packed else {}

    def index(self, descriptions: Sequence[Description], places: PlaceFrames, T_world_pano: np.ndarray) -> None:
        outline_m = np.full((len(descriptions), BINS), np.nan, np.float32)
        for row, description in enumerate(descriptions):
            if OUTLINE in description:
                outline_m[row] = description[OUTLINE]
        self._outlines = MapOutlines.of_places(outline_m, places, T_world_pano)

    def open_index(self, packed: Columns, places: PlaceFrames, T_world_pano: np.ndarray) -> None:
        outline_m = np.full((len(packed), BINS), np.nan, np.float32)
        outline_mm = packed.columns.get(PACKED_OUTLINE)
        if outline_mm is not None:
            outline_m[np.diff(outline_mm.start) > 0] = unpack_outline(outline_mm.values.reshape(-1, BINS))
        self._outlines = MapOutlines.of_places(outline_m, places, T_world_pano)

    def score(self, description: Description, hypotheses: PlaceHypotheses) -> Mapping[str, np.ndarray]:
        outline = np.zeros(len(hypotheses))
        if OUTLINE in description:
            count = len(hypotheses.yaw_rad)
            poses = Poses(hypotheses.place[:count], hypotheses.xy_m, hypotheses.yaw_rad, scale=hypotheses.scale)
            outline[:count] = self._outlines.ratio(description[OUTLINE], poses)
        return {"outline": outline}


class PanoramaEvidence(EvidenceModel):
    """Best score among the matches of the query with the single panoramas of the place, in the column `panorama`.

    The `matcher` of the localizer computes the scores.
    """

    name = "panorama"
    version = "1"
    columns = (
        EvidenceColumn(
            "panorama", "best score among the matches of the query with the single panoramas of the candidate place"
        ),
    )

    def score(self, description: Description, hypotheses: PlaceHypotheses) -> Mapping[str, np.ndarray]:
        made = _with_objects(self, hypotheses)
        places = made.places
        panorama = np.zeros(len(places.names))
        graph = with_range(graph_from_arrays(description))
        if len(graph):
            raised = at_map_height(graph, height_of(description), places.index.camera_height_m)
            for name, score in made.matching.place_scores(raised).items():
                if name in places.number:
                    panorama[places.number[name]] = score
        return {"panorama": panorama[places.scene_frames.name[made.place]]}


class LabelEvidence(EvidenceModel):
    """Labels that query and place share. Rare labels count more.

    `detected_labels` is the share of the query's labels that the place has. `labels_shared` is the Jaccard index of the
    labels of query and place. If no object of the query has a range, both columns are 0. The column
    `bearing_detected_labels` then contains the share of the query's labels that the place has.
    """

    name = "labels"
    version = "2"
    columns = (
        EvidenceColumn(
            "detected_labels",
            "share of the query's labels (0 to 1) that the candidate place has; rare labels count more",
        ),
        EvidenceColumn(
            "labels_shared", "Jaccard index of the labels of query and candidate place; rare labels count more"
        ),
        EvidenceColumn(
            "bearing_detected_labels",
            "share of the query's labels (0 to 1) that the candidate place has, if no object has a range; rare labels "
            "count more",
        ),
    )

    def score(self, description: Description, hypotheses: PlaceHypotheses) -> Mapping[str, np.ndarray]:
        made = _with_objects(self, hypotheses)
        detected, shared = label_evidence(made.nodes.label, made.places.index, made.place)
        unused = np.zeros(len(hypotheses))
        if made.nodes.num_ranged:
            return {"detected_labels": detected, "labels_shared": shared, "bearing_detected_labels": unused}
        return {"detected_labels": unused, "labels_shared": unused, "bearing_detected_labels": detected}


def _with_objects(evidence: EvidenceModel, hypotheses: PlaceHypotheses) -> ObjectHypotheses:
    if not isinstance(hypotheses, ObjectHypotheses):
        raise ConfigError(
            f"the evidence component {evidence.name!r} needs objects, so it works only with the localizer "
            f"saliency-places (method proposed): remove {evidence.name!r} from the setting `evidence`"
        )
    return hypotheses


def label_evidence(label: np.ndarray, index: PlaceIndex, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compare the labels of a query with the labels of places.

    Args:
        label: (n,) labels of the query's objects, as indices into the vocabulary of `index`; -1 for a label outside the
            vocabulary. At least one object.
        index: The places of the map.
        places: (K,) indices of the places to compare with.

    Returns:
        The share (K,) of the query's labels that each place has, and the Jaccard index (K,) of the labels of the query
        and the place. Both are weighted by rarity.
    """
    count = index.count[places]
    map_label = index.label[ranges(index.segments.start[places], count)]
    distinct, number, counts = label_counts(label, len(index.vocabulary), map_label, count)
    shared = np.minimum(counts, number) @ index.rarity[distinct]
    query_rarity = number @ index.rarity[distinct]
    return shared / query_rarity, shared / (index.weight[places] + query_rarity - shared)
