import json
import pickle

import numpy as np
import pytest
from salframe_matterport.dataset import MatterportAnnotations
from salframe_matterport.readers import boxes_path
from salframe_matterport.scenes import read_scenes

from salframe.framework.components.presets import configure_default
from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, DataError
from salframe.framework.validation import validate
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.geometry import pose_yaw, transform_points

from .conftest import ball_boxes


def opened(building, **settings):
    return MatterportAnnotations(MatterportAnnotations.Config(root=building.root, **settings))


def objects_of(frame):
    return frame.load().annotations.objects


def test_folds_leave_one_viewpoint_out(building):
    folds = opened(building).folds()
    # c is alone in its region, "hidden" is not included.
    assert [fold.queries[0].id for fold in folds] == ["fake/a/query", "fake/b/query"]
    assert [[frame.id for frame in fold.references] for fold in folds] == [["fake/b", "fake/c"], ["fake/a", "fake/c"]]
    assert [frame.place for frame in folds[0].references] == ["fake/region-0", "fake/region-1"]
    assert folds[0].references[1] is folds[1].references[1]


def test_viewpoints_with_few_objects_stay_in_the_map_but_are_no_queries(building):
    folds = opened(building, min_visible=4).folds()
    assert [fold.id for fold in folds] == ["fake/b"]
    assert [frame.id for frame in folds[0].references] == ["fake/a", "fake/c"]


def test_queries_carry_no_pose_and_no_place_not_even_inside(building):
    dataset = opened(building)
    for fold in dataset.folds():
        (query,) = fold.queries
        assert type(query) is QueryFrame
        assert query.load().provides == dataset.provides == {"annotations"}
        packed = pickle.dumps(query)
        assert b"region" not in packed
        assert dataset.truth(query.id).T_world_pano[:3, 3].tobytes() not in packed


def test_queries_without_range_have_directions_and_solid_angles(building):
    """The solid angle of a box is a quarter of its surface divided by the squared range (Cauchy's formula)."""
    detector = registry().build("detector", configure_default("detector", "annotations"))
    (ranged,), (query,) = (opened(building, query_range=known).folds()[0].queries for known in (True, False))
    objects, detections = objects_of(ranged), detector.detect(query.load())
    assert detections.labels == objects.labels
    assert np.isnan(detections.centroid_m).all()
    range_m = np.linalg.norm(objects.centroid_m, axis=1)
    np.testing.assert_allclose(detections.bearing, objects.centroid_m / range_m[:, None], atol=1e-6)
    length, width, height = objects.size_m.T
    surface_m2 = 2 * (length * width + width * height + height * length)
    np.testing.assert_allclose(detections.solid_angle_sr, surface_m2 / 4 / range_m**2, rtol=1e-6)
    references = opened(building, query_range=False).folds()[0].references
    assert all(np.isfinite(detector.detect(frame.load()).centroid_m).all() for frame in references)


def test_objects_stand_where_they_are_in_the_world(building):
    dataset = opened(building, range_noise=0.0)
    frames = {frame.id: frame for fold in dataset.folds() for frame in fold.references}
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
    objects = objects_of(opened(building).folds()[0].references[0])
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
    references = {frame.id: objects_of(frame) for fold in opened(building).folds() for frame in fold.references}
    keys = [key for objects in references.values() for key in objects.keys]
    assert len(set(keys)) == len(keys) == 3 + 4 + 3
    assert all(list(objects.keys) == sorted(objects.keys) for objects in references.values())


def test_keys_stay_when_the_panorama_is_turned(building):
    first, second = opened(building).folds()
    mapped = objects_of(next(frame for frame in second.references if frame.id == "fake/a"))
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
    with pytest.raises(DataError, match="has no building other, expected one or more of fake"):
        opened(building, scans=("other",)).folds()
    with pytest.raises(DataError, match=r"has no queries, expected a viewpoint with at least 9 visible objects"):
        opened(building, min_visible=9).folds()
    with pytest.raises(ConfigError, match=r"data\.min_visible: received 0, expected"):
        validate(MatterportAnnotations.Config, {"min_visible": 0}, "data")
    building.write_json("vp2room_label.json", {"pano_info": {"fake": {"a": {"region_index": "0"}}}})
    with pytest.raises(DataError, match="no region for 2 viewpoints of fake"):
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


def row_of(building, count):
    """`count` viewpoints of region 0 in a row, farther and farther apart, all of which see objects 1 to 4."""
    building.viewpoints = {f"v{i}": (0.3 * i * (i + 1) / 2, 0.1 * i, 1.5, 40 * i, 0) for i in range(count)}
    building.viewpoints["c"] = (0.4, 3.0, 1.5, 10, 1)
    building.sees = dict.fromkeys(building.viewpoints, (1, 2, 3, 4))
    building.write()
    return building


def test_leave_out_takes_the_nearest_of_the_region_out_too(building):
    row = row_of(building, 4)
    frames = {fold.id: [frame.id for frame in fold.references] for fold in opened(row, leave_out=2).folds()}
    assert frames == {
        "fake/v0": ["fake/v2", "fake/v3", "fake/c"],
        "fake/v1": ["fake/v2", "fake/v3", "fake/c"],
        "fake/v2": ["fake/v0", "fake/v3", "fake/c"],
        "fake/v3": ["fake/v0", "fake/v1", "fake/c"],
    }
    with pytest.raises(DataError, match=r"at least 3 visible objects, in a region with at least 4 other viewpoints"):
        opened(row, leave_out=4).folds()
    with pytest.raises(ConfigError, match=r"data\.leave_out: received 0, expected"):
        validate(MatterportAnnotations.Config, {"leave_out": 0}, "data")


def test_one_map_holds_all_buildings_apart_and_not_the_query(building, tmp_path):
    regions = json.loads((building.root / "vp2room_label.json").read_text())
    building.scan = "other"
    building.write()
    regions["pano_info"]["other"] = regions["pano_info"]["fake"]
    building.write_json("vp2room_label.json", regions)
    every = {f"{scan}/{name}" for scan in ("fake", "other") for name in "abc"}
    whole = opened(building, one_map=True)
    assert [[query.id for query in fold.queries] for fold in whole.folds()] == [
        ["fake/a/query", "other/a/query"],
        ["fake/b/query", "other/b/query"],
    ]
    for fold in whole.folds():
        assert {frame.id for frame in fold.references} == every - {query.id[:-6] for query in fold.queries}
        at_m = {frame.id: frame.T_world_pano[0, 3] for frame in fold.references}
        assert at_m["other/c"] - at_m["fake/c"] == pytest.approx(1000)
        for query in fold.queries:
            alone, shift_m = opened(building).truth(query.id), 1000.0 * query.id.startswith("other")
            assert whole.truth(query.id).place == f"{query.id.split('/')[0]}/region-0"
            assert whole.truth(query.id).T_world_pano[:3, 3] == pytest.approx(
                alone.T_world_pano[:3, 3] + [shift_m, 0, 0]
            )


def test_ranges_of_a_map_without_the_bearings_of_its_query(building):
    """A bearing of v1 to object 1 that is far off moves the ranges of the other viewpoints, unless v1 asks."""
    row = row_of(building, 4)
    right = {frame.id: objects_of(frame) for frame in opened(row, range_noise=0.0).folds()[0].references}
    path = boxes_path(row.root, "fake", "v1")
    content = json.loads(path.read_text())
    views, boxes = ball_boxes(np.array([0.5, -1.4, -0.9]), 0.3)
    content["v1"]["1"] |= {"visible_pos": views, "bbox2d": boxes}
    path.write_text(json.dumps(content))
    as_it_is, without = (
        {fold.id: fold for fold in opened(row, range_noise=0.0, query_triangulates=flag).folds()}
        for flag in (True, False)
    )

    def range_m(frame):
        objects = objects_of(frame)
        return np.linalg.norm(objects.centroid_m[objects.labels.index("arm chair")])

    def off_m(fold):
        """How far the range of object 1 at v2 and v3 is from that without the bad bearing."""
        return max(
            abs(range_m(frame) - np.linalg.norm(right[id].centroid_m[right[id].labels.index("arm chair")]))
            for frame in fold.references
            for id in ("fake/v2", "fake/v3")
            if frame.id.startswith(id)
        )

    assert off_m(without["fake/v1"]) < 0.2 * off_m(as_it_is["fake/v1"])
    assert off_m(without["fake/v1"]) < 0.03
    # Ranges depend on the query here, so frames have names of their own; those that share no object keep theirs.
    ids = {frame.id for frame in without["fake/v1"].references}
    assert len(ids) == 4
    assert ids.isdisjoint({"fake/v0", "fake/v2", "fake/v3", "fake/c"})
    assert ids.isdisjoint(frame.id for frame in without["fake/v0"].references)
    # The query sees what it always saw.
    query = [objects_of(folds["fake/v1"].queries[0]).centroid_m for folds in (as_it_is, without)]
    assert query[0] == pytest.approx(query[1])


def test_hidden_places_and_other_maps_change_the_questions_and_no_panorama(building):
    row = row_of(building, 4)
    plain = opened(row)
    assert plain.query_key == plain.fingerprint
    hidden = opened(row, hide_query_place=True)
    folds = hidden.folds()
    assert len(folds) == 2 * len(plain.folds())
    for fold in folds[1::2]:
        places = {frame.place for frame in fold.references}
        assert hidden.truth(fold.queries[0].id).place not in places
        assert places == {"fake/region-1"}
    keys = {plain.query_key}
    for settings in ({"hide_query_place": True}, {"leave_out": 2}, {"one_map": True}, {"query_triangulates": False}):
        other = opened(row, **settings)
        assert other.content_key == plain.content_key
        keys.add(other.query_key)
    assert len(keys) == 5


def test_a_field_of_view_shows_the_objects_before_a_query_and_all_of_the_map(building):
    whole, half = opened(building), opened(building, query_fov_deg=180.0)
    for before, after in zip(whole.folds(), half.folds(), strict=True):
        (taken,), (seen,) = before.queries, after.queries
        objects = objects_of(taken)
        ahead = [label for label, (x_m, *_) in zip(objects.labels, objects.centroid_m, strict=True) if x_m >= 0]
        assert objects_of(seen).labels == tuple(ahead) != objects.labels
        assert [objects_of(frame).labels for frame in after.references] == [
            objects_of(f).labels for f in before.references
        ]
        assert {frame.content for frame in after.references} == {whole.content_key}
        assert seen.content not in ("", whole.content_key)
    assert half.fingerprint == whole.fingerprint
    assert half.query_key != whole.query_key


def test_missed_objects_of_queries_are_those_of_no_map_frame(building):
    blind = opened(building, query_noise={"missed": 1.0})
    for fold in blind.folds():
        assert objects_of(fold.queries[0]).labels == ()
        assert all(objects_of(frame).labels for frame in fold.references)
