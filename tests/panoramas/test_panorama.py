"""What a panorama accepts as arrays: the checks of the files' readers, for programs."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.panoramas.frames import ReferenceFrame, Truth
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.images import read_range, write_range
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama, unlabelled_note

HEIGHT = 16
SHAPE = (HEIGHT, 2 * HEIGHT)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, ">f4"])
def test_floating_point_ranges_are_converted(dtype):
    range_m = Panorama("a", range_m=np.full(SHAPE, 2.5, dtype)).range_m
    assert range_m.dtype == np.float32
    assert (range_m == 2.5).all()


@pytest.mark.parametrize("dtype", [np.uint16, np.int32, np.int64, bool])
def test_integer_ranges_are_refused_with_the_unit(dtype):
    with pytest.raises(
        DataError, match=r"a: range_m has dtype .*, expected floating-point metres.*0\.001 for millimetres"
    ):
        Panorama("a", range_m=np.ones(SHAPE, dtype))


@pytest.mark.parametrize("unknown", [np.inf, -np.inf, 0.0, -1.0, 1e300])
def test_ranges_that_are_no_distance_are_unknown(unknown):
    given = np.full(SHAPE, 2.0)
    given[3, 4] = unknown
    range_m = Panorama("a", range_m=given).range_m
    assert np.isnan(range_m[3, 4])
    assert (range_m == 2).sum() == range_m.size - 1
    assert given[3, 4] == unknown  # the array of the caller does not change


def test_a_range_image_is_written_as_a_panorama_has_it(tmp_path):
    range_m = np.full(SHAPE, 2.0)
    range_m[0, :5] = np.inf, -np.inf, -1.0, 70.0, np.nan
    write_range(tmp_path / "a.png", range_m)
    written = read_range(tmp_path / "a.png")
    assert np.isnan(written[0, :5]).all()
    assert np.isnan(written).sum() == 5


def test_read_only_strided_and_listed_arrays_are_accepted():
    wide = np.full((HEIGHT, 4 * HEIGHT), 2.0)[:, ::2]
    wide.flags.writeable = False
    assert (Panorama("a", range_m=wide).range_m == 2).all()
    assert (Panorama("a", range_m=wide.tolist()).range_m == 2).all()
    assert Annotations(np.zeros(SHAPE, int).tolist()).instance_id.dtype == np.int32


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            {"rgb": np.zeros((*SHAPE, 3))},
            "the rgb image has dtype float64, expected uint8 from 0 to 255: scale other values",
        ),
        ({"rgb": np.zeros((*SHAPE, 3), np.uint16)}, "the rgb image has dtype uint16, expected uint8"),
        ({"rgb": np.zeros((*SHAPE, 4), np.uint8)}, r"shape \(16, 32, 4\), expected \(\*, \*, 3\)"),
        ({"rgb": "a.jpg"}, "a: the rgb image has the type str, expected an array"),
        ({"range_m": [[1.0, 2.0], [1.0]]}, "a: the range image has the type list, expected an array of numbers"),
        ({"range_m": np.ma.masked_less(np.ones(SHAPE), 2)}, "has masked values, expected an array without a mask"),
        ({"valid": np.ones(SHAPE)}, "Panorama.valid has dtype float64, expected bool"),
        ({"annotations": {7: "chair"}}, r"annotations has the type dict, expected Annotations\(instance_id, labels\)"),
    ],
)
def test_other_kinds_are_refused(parts, message):
    with pytest.raises(DataError, match=message) as caught:
        Panorama("a", **parts)
    assert "\n" not in str(caught.value)


def test_a_mask_of_integers_is_true_where_it_is_not_black():
    valid = np.zeros(SHAPE, np.uint8)
    valid[:3] = 255
    np.testing.assert_array_equal(Panorama("a", valid=valid).valid, valid == 255)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int64, np.uint32])
def test_ids_of_any_integer_type_are_converted(dtype):
    assert (Annotations(np.full(SHAPE, 7, dtype), {7: "chair"}).instance_id == 7).all()


@pytest.mark.parametrize("id", [-1, 65536, 2**32 + 7])
def test_ids_that_no_file_can_hold_are_refused(id):
    with pytest.raises(DataError, match=f"Annotations.instance_id has .* from {id} to {id}, expected"):
        Annotations(np.full(SHAPE, id, np.int64), {7: "chair"})


def test_ids_as_text_are_converted():
    labels = Annotations(np.full(SHAPE, 7), {"7": "chair", np.int64(8): "bed"}).labels
    assert labels == {7: "chair", 8: "bed"}
    assert {type(id) for id in labels} == {int}


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ({"chair": 7}, "has the instance id 'chair', expected a whole number from 0 to 65535"),
        ({7.5: "chair"}, "has the instance id 7.5, expected a whole number"),
        ({-7: "chair"}, "has the instance id -7, expected a whole number"),
        ({7: None}, "has the label None of the instance id 7, expected text, such as 'chair'"),
        ({7: "chair", "7": "bed"}, "has the instance id 7 twice"),
        (["bed", "chair"], "Annotations.labels has the type list, expected the label of each instance id"),
    ],
)
def test_labels_that_fit_no_id_are_refused(labels, message):
    with pytest.raises(DataError, match=message):
        Annotations(np.full(SHAPE, 7), labels)


def test_objects_without_a_label_are_named():
    ids = np.zeros(SHAPE, np.int32)
    ids[:4], ids[4:8], ids[8, :5] = 7, 9, 11  # 11 covers too few pixels to be an object
    assert unlabelled_note(Panorama("a", annotations=Annotations(ids, {7: "chair", 9: "bed"}))) is None
    assert unlabelled_note(Panorama("a", annotations=Annotations(objects=ObjectBoxes.empty()))) is None
    assert unlabelled_note(Panorama("a", annotations=Annotations(ids, {7: "chair"}))) == (
        "a: 1 of 2 objects of the instance image are ignored, because their ids have no label: 9"
    )


@pytest.mark.parametrize(
    "wrong", [np.diag([1, 1, -1, 1]), np.diag([2, 2, 2, 1]), np.full((4, 4), np.nan), np.diag([1, 1, 1, 2])]
)
def test_poses_that_are_no_rigid_motion_are_refused(wrong):
    for build in (lambda: ReferenceFrame("a", "room", wrong), lambda: Truth("room", wrong)):
        with pytest.raises(DataError, match="expected a rigid motion: a rotation without scale or reflection"):
            build()
    assert ReferenceFrame("a", "room", pose_2d(1, 2, 3).tolist()).T_world_pano.shape == (4, 4)


@pytest.mark.parametrize("up", [[0, 0, 0], [0, np.nan, 1], [0, 1], "up"])
def test_up_that_is_no_direction_is_refused(up):
    with pytest.raises(DataError, match="up"):
        Panorama("p", up=np.array(up) if isinstance(up, list) else up)
