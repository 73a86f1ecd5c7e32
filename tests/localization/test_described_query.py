"""Queries are described in one way: when they are turned, against rooms of known height and hand-made views."""

from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.framework.files.cache import Cache
from salframe.localization.described_query import DescribedView, describe_query, describe_view
from salframe.localization.level_frames import split_level
from salframe.panoramas.camera_height import LevelSurfaces
from salframe.panoramas.frames import QueryFrame
from salframe.testing.rooms import EYE_M, ROOMS, look, stand

CAMERA_Z_M = np.array([EYE_M, EYE_M])
UPRIGHT, HANGING = LevelSurfaces(1.5, 1.1), LevelSurfaces(1.1, 1.5)


def make(method="proposed", **changes):
    content, detector = settings("localizer", method), {"detector": "annotations"}
    return registry().build("localizer", configure("localizer", method, content, [detector, changes]))


def hanging(room, yaw_rad=0.4):
    pose = stand(room, 0.45, 0.55, yaw_rad=yaw_rad)
    pose[:3, :3] = pose[:3, :3] @ Rotation.from_euler("x", 180, degrees=True).as_matrix()
    return pose


def views(*surfaces):
    """Views whose descriptions name them, and how often each was turned."""
    calls = []

    def turn(number):
        calls.append(number)
        return {"turned": np.array(number)}, 0.5

    return [
        DescribedView(f"q{n}", {"view": np.array(n)}, one, 0.25, partial(turn, n)) for n, one in enumerate(surfaces)
    ], calls


def test_the_surfaces_of_a_view_are_those_of_the_room():
    room = ROOMS[0]
    frames = [QueryFrame("q", partial(look, room, "q", pose)) for pose in (stand(room, 0.45, 0.55), hanging(room))]
    upright, upside_down = (describe_view(make(), frame).surfaces for frame in frames)
    np.testing.assert_allclose(upright, [EYE_M, room.size_m[2] - EYE_M], rtol=0.02)
    np.testing.assert_allclose(upside_down, [room.size_m[2] - EYE_M, EYE_M], rtol=0.02)


def test_the_description_of_a_turned_view_is_that_of_the_upright_camera():
    room, localizer = ROOMS[1], make()
    view = describe_view(localizer, QueryFrame("q", partial(look, room, "q", hanging(room))))
    turned, rotation = split_level(view.describe_turned()[0])
    np.testing.assert_allclose(rotation, np.diag([1.0, -1, -1]))
    upright = localizer.describe(look(room, "q", stand(room, 0.45, 0.55, yaw_rad=0.4)))
    assert turned["labels"].tolist() == upright["labels"].tolist()
    np.testing.assert_allclose(turned["centroid_m"], upright["centroid_m"], atol=0.05)


def test_a_query_is_turned_if_all_of_its_views_seem_to_be_upside_down():
    warnings = []
    for surfaces in ((UPRIGHT,), (HANGING, UPRIGHT), (HANGING, LevelSurfaces(np.nan, np.nan))):
        listed, calls = views(*surfaces)
        query = describe_query(make(), listed, None, CAMERA_Z_M, warnings.append)
        assert (len(query.descriptions), query.turned, calls) == (len(surfaces), (), [])
        assert query.seconds == 0.25 * len(surfaces)
    listed, calls = views(HANGING, HANGING)
    query = describe_query(make(), listed, None, CAMERA_Z_M, warnings.append)
    assert [one["turned"].item() for one in query.turned] == calls == [0, 1]
    assert [one["view"].item() for one in query.descriptions] == [0, 1]
    assert query.seconds == 2 * 0.25 + 2 * 0.5
    assert warnings == []


@pytest.mark.parametrize("localizer", [make(level="off"), make("objects")], ids=["level off", "no range"])
def test_a_query_that_is_not_turned_is_told(localizer):
    warnings = []
    listed, calls = views(HANGING)
    assert describe_query(localizer, listed, None, CAMERA_Z_M, warnings.append).turned == ()
    assert calls == []
    assert warnings == [
        "q0 seems to be upside down: the image shows the floor 1.10 m below the camera and the ceiling 1.50 m above "
        "it, but the cameras of the map are at z = 1.50 m: turn the images by 180 deg"
    ]


def test_cached_surfaces_are_measured_once(tmp_path):
    room, cache = ROOMS[0], Cache(tmp_path)
    pose, loaded = hanging(room), []

    def load():
        loaded.append(1)
        return look(room, "q", pose)

    first, again = (describe_view(make(), QueryFrame("q", load), cache, "rooms") for _ in range(2))
    assert len(loaded) == 2  # one for the description, one for the surfaces
    assert first.surfaces == again.surfaces
    assert first.seconds == again.seconds
