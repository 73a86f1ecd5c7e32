import numpy as np
import pytest
from salframe_rangefinder import salframe_provides
from salframe_rangefinder.detector import HeightBands
from salframe_rangefinder.evidence import RangeSpectrum
from salframe_rangefinder.rooms import BoxRooms, draw_room

import salframe
from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.panoramas.geometry import row_elevation

COMPONENTS = [item for item in salframe_provides() if isinstance(item, type) and issubclass(item, salframe.Component)]


@pytest.mark.parametrize("component", COMPONENTS, ids=lambda component: component.name)
def test_every_component_keeps_the_rules_of_its_role(component):
    assert not salframe.check_component(component).failed


def hall() -> salframe.Panorama:
    """Return a panorama of a round hall of radius 4 m and height 2.6 m, at 1.5 m above the floor.

    A cupboard front of height 2 m is 1 m behind the camera.
    """
    elevation_rad = row_elevation(128)[:, None] * np.ones((1, 256))
    hall_m = np.minimum(4 / np.cos(elevation_rad), np.where(elevation_rad > 0, 1.1, -1.5) / np.sin(elevation_rad))
    behind = np.abs(np.arange(256) - 127.5) > 120
    front = behind & (np.abs(np.tan(elevation_rad) + 0.5) < 1)  # from 1.5 m below the camera to 0.5 m above it
    return salframe.Panorama("hall", range_m=np.where(front, 1 / np.cos(elevation_rad), hall_m).astype(np.float32))


def test_a_cupboard_across_the_seam_is_one_tall_object():
    detections = HeightBands().detect(hall())
    assert detections.labels == ("tall object",)
    np.testing.assert_allclose(detections.centroid_m[0, :2], (-1, 0), atol=0.02)


def test_a_file_says_what_objects_are_called(tmp_path):
    (tmp_path / "names.txt").write_text("stool\ntable\ncupboard\n")
    detector = HeightBands(HeightBands.Config(names=tmp_path / "names.txt"))
    assert detector.detect(hall()).labels == ("cupboard",)
    (tmp_path / "names.txt").write_text("stool\n")
    with pytest.raises(salframe.ConfigError, match=r"names\.txt: number of lines is 1, expected 3 labels"):
        detector.detect(hall())


def test_the_range_finder_sees_floor_ceiling_and_walls_where_they_are():
    range_m = BoxRooms(BoxRooms.Config(height=128, boxes=1)).folds()[0].references[0].load().range_m
    half = np.pi / 256  # rows and columns are half a pixel off the axes
    assert range_m[0, 0] == pytest.approx(1.1 / np.cos(half), rel=1e-5)
    assert range_m[-1, 0] == pytest.approx(1.5 / np.cos(half), rel=1e-5)
    low_m, high_m = draw_room(0, 0, 1)
    assert low_m[1, 1] > 1 or high_m[1, 1] < -1 or low_m[1, 0] > -1  # no box in front of the wall behind
    assert range_m[63, 0] == pytest.approx(high_m[0, 0] / np.cos(half) ** 2, rel=1e-5)


def test_the_most_similar_frame_of_each_place_counts():
    """The last of three frames has the spectrum of the query, in the place of the first; the second is far off."""
    evidence = RangeSpectrum()
    spectrum_m = np.zeros(16)
    frames = [{"range_spectrum_m": spectrum_m + difference_m / 4} for difference_m in (1.5, 3.0, 0.0)]
    places = salframe.PlaceFrames(["a", "b"], np.array([0, 1]), np.array([0, 2, 1]), np.array([0, 2, 3]))
    evidence.index(frames, places, np.tile(np.eye(4)[:3], (3, 1, 1)))
    hypotheses = salframe.PlaceHypotheses(np.array([1, 0]), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(2))
    assert evidence.score(frames[2], hypotheses)["range_spectrum"].tolist() == [-2.0, 0.0]
    assert evidence.score({}, hypotheses)["range_spectrum"].tolist() == [0.0, 0.0]


def test_the_ranges_around_a_camera_tell_rooms_apart():
    """With this evidence alone, the rooms of all queries rank first. The detector finds something in each of them."""
    rooms = BoxRooms(BoxRooms.Config(rooms=6))
    settings = {"detector": "height-bands", "evidence": ["range-spectrum"]}
    localizer = registry().build("localizer", configure("localizer", "saliency-places", settings))
    fold = rooms.folds()[0]
    map = salframe.LocalizationMap.build(localizer, fold.references)
    places = [map.localize(query).places[0].place for query in fold.queries]
    assert places == [rooms.truth(query.id).place for query in fold.queries]
