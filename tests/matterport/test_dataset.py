import pickle

import numpy as np
import pytest
from salframe_matterport.dataset import MatterportAnnotations
from salframe_matterport.readers import boxes_path
from salframe_matterport.scenes import read_scenes

from salframe.framework.config import validate
from salframe.framework.errors import ConfigError, DataError
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import pose_yaw, transform_points


def opened(building, **settings):
    return MatterportAnnotations(MatterportAnnotations.Config(root=building.root, **settings))


def objects_of(frame):
    return frame.load().annotations.objects


def test_folds_leave_one_viewpoint_out(building):
    folds = opened(building).folds()
    # c is alone in its region, "hidden" is not included.
    assert [fold.queries[0].id for fold in folds] == ["fake/a/query", "fake/b/query"]
    assert [[frame.id for frame in fold.mapping] for fold in folds] == [["fake/b", "fake/c"], ["fake/a", "fake/c"]]
    assert [frame.place for frame in folds[0].mapping] == ["fake/region-0", "fake/region-1"]
    assert folds[0].mapping[1] is folds[1].mapping[1]


def test_viewpoints_with_few_objects_stay_in_the_map_but_are_no_queries(building):
    folds = opened(building, min_visible=4).folds()
    assert [fold.id for fold in folds] == ["fake/b"]
    assert [frame.id for frame in folds[0].mapping] == ["fake/a", "fake/c"]


def test_queries_carry_no_pose_and_no_place_not_even_inside(building):
    dataset = opened(building)
    for fold in dataset.folds():
        (query,) = fold.queries
        assert type(query) is QueryFrame
        assert query.load().provides == dataset.provides == {"annotations"}
        packed = pickle.dumps(query)
        assert b"region" not in packed
        assert dataset.truth(query.id).T_world_pano[:3, 3].tobytes() not in packed


def test_objects_stand_where_they_are_in_the_world(building):
    dataset = opened(building, range_noise=0.0)
    frames = {frame.id: frame for fold in dataset.folds() for frame in fold.mapping}
    for frame in frames.values():
        objects = objects_of(frame)
        for label, centroid, size in zip(
            objects.labels, transform_points(frame.T_world_pano, objects.centroid_m), objects.size_m, strict=True
        ):
            if label in ("plant", "bed"):  # seen from one viewpoint only
                continue
            _, position, radius = next(
                ball for ball in building.balls.values() if ball[0].replace("#", " ").lower() == label
            )
            assert centroid == pytest.approx(position, abs=0.05)
            assert size[[0, 2]] == pytest.approx([2 * radius, 2 * radius], rel=0.25)
            assert size[1] == min(size[0], size[2])


def test_query_is_turned_and_truth_knows_how_far(building):
    dataset = opened(building, range_noise=0.0)
    fold = dataset.folds()[0]
    truth, objects = dataset.truth("fake/a/query"), objects_of(fold.queries[0])
    assert truth.place == "fake/region-0"
    assert sorted(truth.instances) == [1, 2, 3]
    assert truth.T_world_pano[:3, 3] == pytest.approx([0, 0, 1.5])
    assert abs(pose_yaw(truth.T_world_pano) - np.pi / 2) > 0.01
    for label, centroid in zip(objects.labels, transform_points(truth.T_world_pano, objects.centroid_m), strict=True):
        _, position, _ = next(ball for ball in building.balls.values() if ball[0].replace("#", " ").lower() == label)
        assert centroid == pytest.approx(position, abs=0.05)
    with pytest.raises(DataError, match="no query 'fake/a'"):
        dataset.truth("fake/a")


def test_box_length_lies_across_the_bearing(building):
    objects = objects_of(opened(building).folds()[0].mapping[0])
    across = np.stack([np.cos(objects.yaw_rad), np.sin(objects.yaw_rad)], 1)
    assert np.einsum("ni,ni->n", across, objects.centroid_m[:, :2]) == pytest.approx(0, abs=1e-9)
    assert (objects.yaw_rad >= 0).all()
    assert (objects.yaw_rad < np.pi).all()


def ranges(building, range_noise, seed):
    regions = {"a": 0, "b": 0, "c": 1}
    return {
        (scene.id, number): range_m
        for scene in read_scenes(building.root, "fake", regions, range_noise, seed)
        for number, range_m in zip(scene.object_id, scene.range_m, strict=True)
    }


def test_range_noise_is_a_seeded_factor_per_viewpoint_and_object(building):
    exact = ranges(building, 0.0, seed=0)
    seen_often = [key for key in exact if key[1] in (1, 2, 3)]
    factors = np.array([[ranges(building, 0.05, seed)[key] / exact[key] for key in seen_often] for seed in range(25)])
    assert ranges(building, 0.05, seed=0) == ranges(building, 0.05, seed=0)
    assert np.log(factors).std() == pytest.approx(0.05, rel=0.2)
    assert np.log(factors).mean() == pytest.approx(0, abs=0.015)
    correlation = np.corrcoef(factors.T) - np.eye(len(seen_often))
    assert np.abs(correlation).max() < 0.8  # one factor for several would correlate fully


def test_object_seen_once_gets_a_range_of_the_building(building):
    exact = ranges(building, 0.0, seed=0)
    known = {range_m for (_, number), range_m in exact.items() if number in (1, 2, 3)}
    drawn = {ranges(building, 0.0, seed)[("fake/b", 5)] for seed in range(20)}
    assert drawn <= known
    assert len(drawn) > 3


def test_unknown_range_is_nan_where_nothing_can_be_triangulated(building):
    building.sees = {"a": (1, 2, 3), "b": (4, 5), "c": ()}
    building.write()
    objects = objects_of(opened(building).folds()[0].queries[0])
    assert len(objects.labels) == 3
    assert np.isnan(objects.centroid_m).all()


def test_keys_and_order_do_not_link_an_object_across_viewpoints(building):
    mapping = {frame.id: objects_of(frame) for fold in opened(building).folds() for frame in fold.mapping}
    keys = [key for objects in mapping.values() for key in objects.keys]
    assert len(set(keys)) == len(keys) == 3 + 4 + 3
    assert all(list(objects.keys) == sorted(objects.keys) for objects in mapping.values())


def test_keys_stay_when_the_panorama_is_turned(building):
    first, second = opened(building).folds()
    mapped = objects_of(next(frame for frame in second.mapping if frame.id == "fake/a"))
    turned = objects_of(first.queries[0])
    assert mapped.keys == turned.keys
    assert mapped.labels == turned.labels
    assert np.linalg.norm(mapped.centroid_m, axis=1) == pytest.approx(np.linalg.norm(turned.centroid_m, axis=1))
    assert mapped.size_m == pytest.approx(turned.size_m)


def test_fingerprint_follows_settings_and_content_but_not_the_folder(building, tmp_path):
    first = opened(building).fingerprint
    assert opened(building).fingerprint == first
    assert opened(building, seed=1).fingerprint != first
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for part in ("connectivity", "reverie", "vp2room_label.json"):
        (building.root / part).rename(moved / part)
    building.root = moved
    assert opened(building).fingerprint == first
    path = boxes_path(moved, "fake", "c")
    path.write_text(path.read_text().replace('"bed"', '"cot"'))
    assert opened(building).fingerprint != first


def test_bad_input_is_one_clear_line(building, tmp_path):
    with pytest.raises(DataError, match="--data-dir DIR"):
        MatterportAnnotations().folds()
    with pytest.raises(DataError, match="has no building other, expected some of fake"):
        opened(building, scans=("other",)).folds()
    with pytest.raises(DataError, match="gives no query: expected a viewpoint with 9 visible objects"):
        opened(building, min_visible=9).folds()
    with pytest.raises(ConfigError, match=r"data\.min_visible: received 0, expected"):
        validate(MatterportAnnotations.Config, {"min_visible": 0}, "data")
    building.write_json("vp2room_label.json", {"pano_info": {"fake": {"a": {"region_index": "0"}}}})
    with pytest.raises(DataError, match="2 viewpoints of fake have no region"):
        opened(building).folds()
    boxes_path(building.root, "fake", "b").unlink()
    with pytest.raises(DataError, match=r"cannot read .*fake_b\.json"):
        opened(building).folds()
    with pytest.raises(DataError, match=r"cannot read .*fake_b\.json"):
        _ = opened(building).fingerprint


def test_prepare_reports_progress(building):
    seen = []
    opened(building).prepare(lambda done, total: seen.append((done, total)))
    assert seen == [(0, 1), (1, 1)]
