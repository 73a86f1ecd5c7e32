"""Signs of rooms: where they hang, what the queries can read, and their pixels."""

from collections import Counter

import numpy as np
import pytest
from salframe_house.building import Building, generate_building
from salframe_house.rendering import buildings, render_pose
from salframe_house.signs import change_signs, place_signs, room_number

from salframe.framework.components.presets import configure
from salframe.framework.errors import ConfigError
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import split_text


@pytest.fixture(scope="module")
def house() -> Building:
    return buildings("office", 12, 0, 0.1, signs=True)[0]


def test_numbers_of_rooms():
    assert [room_number(index) for index in (0, 13, 98, 99, 211)] == ["1.01", "1.14", "1.99", "2.01", "3.14"]


def test_each_room_has_a_poster_on_its_wall_and_a_plate_beside_its_door(house):
    for index, room in enumerate(house.rooms):
        in_room = [sign for sign in house.signs if sign.label == f"text: {room_number(index)}"]
        posters = [sign for sign in in_room if sign.room == room.id]
        assert len(in_room) <= 2
        assert len(posters) <= 1
        for sign in in_room:
            place = next(other for other in house.rooms if other.id == sign.room)
            gaps = np.abs(
                np.array(
                    [*np.subtract(place.low_m, (sign.x_m, sign.y_m)), *np.subtract(place.high_m, (sign.x_m, sign.y_m))]
                )
            )
            assert gaps.min() < 0.02
            towards = np.array([sign.x_m, sign.y_m]) + 0.1 * np.array([np.cos(sign.yaw_rad), np.sin(sign.yaw_rad)])
            assert (towards > place.low_m).all()
            assert (towards < place.high_m).all()
    texts = Counter(split_text(sign.label)[1] for sign in house.signs)
    assert len(texts) >= 10  # nearly every room has a free wall


def test_signs_collide_with_nothing(house):
    boxes = np.array([placed.bounds_m for placed in (*house.objects, *house.signs)])
    first = len(house.objects)
    for i in range(first, len(boxes)):
        low, high = np.maximum(boxes[:, 0], boxes[i, 0]), np.minimum(boxes[:, 1], boxes[i, 1])
        assert ((high - low > 1e-4).all(1)).sum() == 1


def test_the_shares_of_changed_signs_are_those_of_the_settings():
    layout = generate_building("office", 42, 1).layout
    signs = place_signs(layout, (), 1) * 40
    changed = change_signs(signs, 0.3, 0.05, 3)
    unreadable = sum(sign.label == "text" for sign in changed)
    wrong = sum(a.label not in (b.label, "text") for a, b in zip(changed, signs, strict=True))
    count = len(signs)
    for number, share in ((unreadable, 0.3), (wrong, 0.05)):
        assert abs(number - share * count) < 4 * np.sqrt(share * (1 - share) * count)
    assert change_signs(signs, 0.0, 0.0, 3) == signs


def test_a_rendered_sign_shows_its_number_where_its_annotation_is(house):
    sign = next(s for s in house.signs if s.size_m[1] == 0.6)
    ahead = np.array([np.cos(sign.yaw_rad), np.sin(sign.yaw_rad)])
    x_m, y_m = np.array([sign.x_m, sign.y_m]) + 0.8 * ahead
    config = configure(
        "dataset",
        "house",
        {"style": "office", "rooms": 12, "signs": True, "height": 512, "lighting": "day", "changed_fraction": 0.0},
    )
    panorama = render_pose(config, pose_2d(float(x_m), float(y_m), sign.yaw_rad + np.pi, sign.z_m + 0.15))
    inside = panorama.annotations.instance_id == sign.instance_id
    assert panorama.annotations.labels[sign.instance_id] == sign.label
    columns = np.nonzero(inside)[1]
    assert abs(columns.mean() + 0.5 - 512) < 3  # straight ahead
    width_rad = 2 * np.arctan(0.3 / 0.8)
    assert np.ptp(columns) + 1 == pytest.approx(width_rad / np.pi * 512, abs=4)
    letters = panorama.rgb[inside].mean(1)
    assert np.percentile(letters, 5) < 0.5 * np.percentile(letters, 60)


def test_more_than_all_signs_cannot_change():
    with pytest.raises(ConfigError, match=r"signs_unreadable is 0.7 and signs_wrong is 0.5; expected a sum"):
        configure("dataset", "house", {"signs_unreadable": 0.7, "signs_wrong": 0.5})
