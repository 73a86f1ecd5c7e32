"""Every setting of `proposed` has an effect: another value gives another answer to a query, or other descriptions."""

from functools import cache

import numpy as np
import pytest
from salframe_graphs.places.localizer import OUTLINE, SaliencyPlacesLocalizer
from salframe_graphs.sectors import BINS

from salframe.framework.components.identity import identity
from salframe.framework.components.presets import configure, settings
from salframe.framework.components.settings import list_settings
from salframe.framework.config import merge
from salframe.framework.validation import validate
from salframe.graphs.detections import Detections, unit_vectors
from salframe.graphs.graph import GraphConfig, build_graph
from salframe.graphs.packing import graph_to_arrays
from salframe.localization.map import LocalizationMap
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import invert_pose, pose_2d, transform_points

LABELS = ("bed", "sofa", "chair", "chair", "table", "lamp", "plant", "tv")
NUM_ROOMS, NUM_OBJECTS, WIDTH_M = 6, 9, 6.0
CHANGES = {
    "matcher": ("triplet", {}),
    "matcher.rarity": (False, {}),
    "matcher.confidence": (False, {}),
    "matcher.min_candidate_ratio": (0.8, {}),
    "matcher.max_candidates": (4, {}),
    "matcher.scene_index": ("compiled-lists", {"matcher": {"max_candidates": 3}}),
    "matcher.height_scale_m": (0.5, {}),
    "matcher.size_scale": ([0.4, 0.3], {}),
    "matcher.ring_edges_m": ([1.5, 3.0], {}),
    "matcher.hops": (0, {}),
    "matcher.structure_weight": (1.0, {}),
    "matcher.min_similarity": (0.5, {}),
    "matcher.similarity_score": (0.2, {}),
    "matcher.geometry_score": (0.5, {}),
    "matcher.tolerance_m": (0.15, {}),
    "matcher.tolerance_share": (0.2, {}),
    "matcher.max_scale_error": (0.2, {}),
    "matcher.max_shift_m": (1.0, {}),
    "pose": (False, {}),
    "top_k": (2, {}),
    "agreement": (0.0, {}),
    "agreement_radius_m": (0.1, {}),
    "nearest_scene": (False, {}),
    "rates.label_agreement": (0.6, {}),
    "rates.position_error_m": (0.2, {}),
    "rates.range_error_share": (0.2, {}),
    "rates.height_error_m": (0.5, {}),
    "rates.length_error_log": (0.5, {}),
    "rates.box_height_error_log": (0.5, {}),
    "rates.detection_logit": (1.0, {}),
    "rates.detection_per_saliency": (1.0, {}),
    "rates.detection_per_distance": (-0.5, {}),
    "rates.clutter": (0.5, {}),
    "weights.likelihood": (0.2, {}),
    "weights.bearing_likelihood": (0.2, {}),
    "weights.outline": (0.05, {}),
    "weights.panorama": (3.0, {}),
    "weights.detected_labels": (0.5, {}),
    "weights.labels_shared": (1.0, {}),
    "weights.bearing_detected_labels": (0.5, {}),
    "likelihood.detection_per_sighting": (1.0, {}),
    "likelihood.area_m2": (30.0, {}),
    "likelihood.height_span_m": (1.0, {}),
    "likelihood.size_span_log": (1.0, {}),
    "likelihood.unplaced_share": (0.9, {}),
    "likelihood.scale_error": (0.01, {}),
    "likelihood.camera_height_error_m": (0.02, {}),
    "likelihood.bearings.bearing_error_rad": (0.1, {}),
    "likelihood.bearings.horizontal_error_m": (0.2, {}),
    "likelihood.bearings.vertical_error_m": (0.2, {}),
    "likelihood.bearings.side_error_share": (0.3, {}),
    "likelihood.bearings.size_error_log": (0.3, {}),
    "likelihood.bearings.size_bias_log": (0.3, {}),
    "likelihood.bearings.size_span_log": (2.0, {}),
    "likelihood.bearings.clutter_solid_angle_sr": (1.0, {}),
    "likelihood.bearings.detection_logit": (1.0, {}),
    "likelihood.bearings.detection_per_logit": (0.5, {}),
    "likelihood.bearings.detection_per_distance": (-2.0, {}),
    "posterior.temperature": (2.0, {}),
    "posterior.head.bias": (1.0, {}),
    "posterior.head.evidence": ({"outline": {"slope": 5.0}}, {}),
    "posterior.head.absent_mean": (1.0, {}),
    "posterior.head.absent_deviation": (3.0, {}),
    "posterior.head.slope": (0.5, {}),
    "posterior.head.accuracy": (0.5, {}),
    "posterior.head.objects": (0.0, {}),
    "posterior.head.mean_effect": (1.0, {}),
    "posterior.head.deviation_effect": (1.0, {}),
    "posterior.head.bias_effect": (1.0, {}),
    "posterior.head.min_log_ratio": (-0.5, {"posterior": {"calibrate": False}}),  # a calibration replaces it
    "posterior.head.accuracy_effect": (5.0, {}),
    "posterior.max_out_of_map_probability": (0.0001, {}),
    "posterior.calibrate": (False, {}),
    "posterior.query_distance_m": (5.0, {}),
    "posterior.max_false_accept": (0.1, {"posterior": {"head": {"bias": 3.0}}}),
    "candidates": (2, {}),
    "scene_index": ("compiled-lists", {"candidates": 2}),
    "merged": (False, {}),
    "poses": (1, {}),
}
"""For each setting of matching another value, and the other settings with which it shows."""
DESCRIBING = {
    "level": "off",
    "range": "onnx-depth",
    "detector": "panoseg",
    "saliency": "uniform",
    "graph.min_share": 0.1,
    "graph.top_k": 3,
    "graph.extent": "max",
    "graph.distance": "centroid",
    "evidence": ["likelihood", "panorama", "labels"],
}
"""For each setting of descriptions another value."""


@cache
def preset():
    """The settings of `proposed`, on annotations."""
    return configure("localizer", "proposed", merge(settings("localizer", "proposed"), {"detector": "annotations"}))


def changed(key, value):
    """A mapping that holds one setting."""
    for name in reversed(key.split(".")):
        value = {name: value}
    return value


def configured(*changes):
    content = preset().model_dump(mode="json")
    del content["weights"]  # the evidence determines which there are
    for change in changes:
        content = merge(content, change)
    return validate(SaliencyPlacesLocalizer.Config, content, "proposed")


def room(number):
    """Detections in the world of a room's objects; half of the rooms are alike but for positions."""
    rng, kind = np.random.default_rng(number), np.random.default_rng(number % 3)
    centre = (WIDTH_M * number, 0.0, 0.0)
    centroid_m = np.column_stack([rng.uniform(-2.5, 2.5, (NUM_OBJECTS, 2)), kind.uniform(-1, 1, NUM_OBJECTS)]) + centre
    labels = [str(label) for label in kind.choice(LABELS, NUM_OBJECTS)]
    return labels, centroid_m, kind.uniform(0.3, 1.5, (NUM_OBJECTS, 3))


def described(rooms, T_world_pano, seed):
    """The graph of the objects of some rooms seen with errors, some of them missed, and an outline of free space."""
    rng = np.random.default_rng(seed)
    labels, centroid_m, size_m = (np.concatenate(parts) for parts in zip(*map(room, rooms), strict=True))
    seen = rng.random(len(labels)) < 0.85
    local_m = transform_points(invert_pose(T_world_pano), centroid_m[seen])
    local_m += rng.normal(0, 0.06, local_m.shape)
    size_m = size_m[seen] * rng.uniform(0.85, 1.15, (seen.sum(), 3))
    found = Detections(
        labels[seen].tolist(), rng.uniform(0.4, 1, seen.sum()), local_m, size_m, rng.uniform(0, np.pi, seen.sum())
    )
    volume = size_m.prod(1)
    outline_m = rng.uniform(1.5, 3.5, BINS).astype(np.float32)
    return {**graph_to_arrays(build_graph(found, volume / volume.sum(), GraphConfig())), OUTLINE: outline_m}


@cache
def scene():
    """The described frames of a map, its floor, and described queries: with range, without, and of a doorway."""
    frames, descriptions = [], []
    for number in range(NUM_ROOMS):
        for view in range(2):
            T = pose_2d(WIDTH_M * number + (-1, 1)[view], 0.3, number + view)
            frames.append(ReferenceFrame(f"frame-{number}-{view}", f"room-{number}", T))
            descriptions.append(described([number], T, (number, view)))
    for number in range(NUM_ROOMS - 1):
        T = pose_2d(WIDTH_M * (number + 0.5), 0.0, 0.4)
        frames.append(ReferenceFrame(f"door-{number}", f"door-{number}", T, FrameKind.TRANSITION))
        descriptions.append(described([number, number + 1], T, (number, 7)))
    region = np.repeat(np.arange(1, NUM_ROOMS + 1, dtype=np.int32), 60)[None].repeat(60, 0)
    free = np.ones(region.shape, bool)
    names = {number + 1: f"room-{number}" for number in range(NUM_ROOMS)}
    floor = FloorMasks(free, region, ~free, 0.1, (-3.0, 3.0), names)
    queries = []
    for number in range(NUM_ROOMS):
        T = pose_2d(WIDTH_M * number + 0.5, -0.4, 1.0 + number)
        query = described([number], T, (number, 11))
        unknown = {name: np.full_like(query[name], np.nan) for name in ("centroid_m", "size_m", "yaw_rad")}
        bearing = unit_vectors(query["centroid_m"])
        flat = {name: values for name, values in query.items() if name != OUTLINE}
        range_m = np.linalg.norm(query["centroid_m"], axis=1)
        flat["solid_angle_sr"] = query["size_m"].prod(1) ** (2 / 3) / range_m**2
        queries += [query, {**flat, **unknown, "edges": np.zeros((0, 2), np.int64), "bearing": bearing}]
    T = pose_2d(WIDTH_M * 1.5 + 0.2, 0.1, 2.0)
    return frames, descriptions, floor, [*queries, described([1, 2], T, (1, 13))]


def answers(config):
    """All numbers and names of the answers to all queries."""
    frames, descriptions, floor, queries = scene()
    made = LocalizationMap.from_descriptions(
        SaliencyPlacesLocalizer(config), descriptions, frames, [floor], calibrate=True
    )
    return [_comparable(made.answer(query)) for query in queries]


def _comparable(answer):
    pose = None if answer.T_world_query is None else answer.T_world_query.round(7).tolist()
    places = [(place.frame, round(place.score, 9), place.probability) for place in answer.places]
    return answer.status, places, pose, answer.out_of_map_probability, answer.max_accepted_probability


@pytest.mark.parametrize("key", CHANGES)
def test_a_setting_of_matching_changes_an_answer(key):
    if "compiled-lists" in CHANGES[key]:
        pytest.importorskip("numba")
    value, others = CHANGES[key]
    assert answers(configured(others, changed(key, value))) != answers(configured(others))


@pytest.mark.parametrize("key", DESCRIBING)
def test_a_setting_of_descriptions_changes_what_they_are_known_by(key):
    plain, other = preset(), configured(changed(key, DESCRIBING[key]))
    assert identity(plain, describing=True) != identity(other, describing=True)


def test_these_are_all_settings():
    nested = {"detector.", "range."}  # settings of components that have tests of their own
    listed = {one.key for one in list_settings(preset()) if not one.key.startswith(tuple(nested))}
    joining = {  # see test_joined_views.py and test_distant_views.py
        *("odometry.drift_share", "odometry.heading_drift_deg"),
        *("view_objects.position_error_m", "view_objects.range_error_share"),
        *("distant_views.near_m", "distant_views.window_m", "distant_views.same_place_m"),
    }
    one_place = {"posterior.head.other_score"}  # see test_posterior.py
    assert listed == {*CHANGES, *DESCRIBING, *joining, *one_place}
