"""The twenty buildings of shared data: the figures stated for them. Skipped where they are absent."""

from collections import Counter

import numpy as np
import pytest
from salframe_matterport.bearings import bearing, direction
from salframe_matterport.dataset import MatterportAnnotations
from salframe_matterport.readers import boxes_path, connectivity_path, read_boxes, read_connectivity

from salframe.graphs.triangulation import triangulate


@pytest.fixture(scope="module")
def dataset(real_root):
    dataset = MatterportAnnotations(MatterportAnnotations.Config(root=real_root))
    dataset.prepare(lambda done, total: None)
    return dataset


def object_centres(path):
    """Object id -> centre (3,), from the O lines of an official house file."""
    rows = (line.split() for line in path.read_text().splitlines() if line.startswith("O "))
    return {int(row[1]): np.array(row[4:7], float) for row in rows}


@pytest.fixture(scope="module")
def against_truth(real_root):
    """Bearing errors (degrees) and triangulation errors (metres) of the two buildings whose house file has objects."""
    bearing_deg, position_m = [], []
    for scan in ("GdvgFV5R1Z5", "YmJkqBEsHnH"):
        centres = object_centres(real_root / "house" / f"{scan}.house")
        rays = []
        for viewpoint, pose in read_connectivity(connectivity_path(real_root, scan)).items():
            for number, boxes in read_boxes(boxes_path(real_root, scan, viewpoint), viewpoint).items():
                seen = bearing(boxes.view, boxes.box_px)
                towards, offset = direction(seen.azimuth_rad, seen.elevation_rad), centres[number] - pose[:3, 3]
                bearing_deg.append(np.degrees(np.arccos(np.clip(towards @ offset / np.linalg.norm(offset), -1, 1))))
                rays.append((pose[:3, 3], towards, number))
        origin, towards, numbers = (np.array(column) for column in zip(*rays, strict=True))
        distinct, target = np.unique(numbers, return_inverse=True)
        found = triangulate(origin, towards, target, len(distinct))
        position_m += [
            np.linalg.norm(found[i] - centres[n]) for i, n in enumerate(distinct) if np.isfinite(found[i]).all()
        ]
    return np.array(bearing_deg), np.array(position_m)


def test_bearings_point_at_the_true_centres(against_truth):
    bearing_deg, _ = against_truth
    assert len(bearing_deg) == 82
    assert np.median(bearing_deg) < 3.2


def test_triangulation_finds_the_true_centres(against_truth):
    _, position_m = against_truth
    assert len(position_m) >= 16
    assert np.median(position_m) < 0.11


def test_queries_are_those_of_the_rule(dataset):
    assert len(dataset.folds()) == 1009


def test_label_multisets_score_what_is_stated(dataset):
    labels = {
        frame.id: Counter(frame.load().annotations.objects.labels)
        for fold in dataset.folds()
        for frame in fold.references
    }
    correct = 0.0
    for fold in dataset.folds():
        query = fold.queries[0]
        seen = Counter(query.load().annotations.objects.labels)
        jaccard = np.array(
            [(seen & labels[frame.id]).total() / (seen | labels[frame.id]).total() for frame in fold.references]
        )
        best = [frame.place for frame, score in zip(fold.references, jaccard, strict=True) if score == jaccard.max()]
        correct += best.count(dataset.truth(query.id).place) / len(best)  # ties share the point
    assert correct / 1009 == pytest.approx(0.764, abs=0.002)


def test_one_query_in_twenty_shares_no_object_with_its_region(dataset):
    folds = dataset.folds()
    instances = {fold.id: set(dataset.truth(fold.queries[0].id).instances) for fold in folds}
    places = {fold.id: dataset.truth(fold.queries[0].id).place for fold in folds}
    scenes = dataset.scenes()
    lonely = sum(
        not any(
            instances[fold.id] & set(scenes[frame.id].object_id.tolist())
            for frame in fold.references
            if frame.place == places[fold.id]
        )
        for fold in folds
    )
    assert lonely / 1009 == pytest.approx(0.05, abs=0.002)


def test_shared_objects_give_the_relative_pose(dataset):
    """The frames fit together: two viewpoints that share objects agree on where they stand, up to range noise and
    bearings."""
    folds = dataset.folds()
    scenes = dataset.scenes()
    shift_m, turn_deg = [], []
    for fold in folds:
        truth, query = dataset.truth(fold.queries[0].id), fold.queries[0].load().annotations.objects.centroid_m
        for frame in fold.references:
            common, in_query, in_frame = np.intersect1d(
                scenes[fold.id].object_id, scenes[frame.id].object_id, return_indices=True
            )
            if frame.place != truth.place or len(common) < 3:
                continue
            # Planar Procrustes in complex numbers: world = a * query + b.
            q = query[in_query, :2] @ [1, 1j]
            w = (
                frame.load().annotations.objects.centroid_m @ frame.T_world_pano[:3, :3].T + frame.T_world_pano[:3, 3]
            )[in_frame, :2] @ [1, 1j]
            turn = np.vdot(q - q.mean(), w - w.mean())
            turn /= abs(turn)
            x, y = truth.T_world_pano[:2, 3]
            shift_m.append(abs(w.mean() - turn * q.mean() - (x + 1j * y)))
            turn_deg.append(abs(np.degrees(np.angle(turn / (truth.T_world_pano[:2, 0] @ [1, 1j])))))
    assert len(shift_m) == 1202
    assert np.median(shift_m) < 0.09
    assert np.median(turn_deg) < 2.5
