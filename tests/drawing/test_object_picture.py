"""Pictures of objects: positions of outlines and names compared with closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from ball_plugin import BALLS, angular_radius, balls

from salframe.drawing.object_picture import (
    COLOURS,
    choose_colours,
    draw_objects,
    draw_outlines,
    find_lines,
    name_objects,
)
from salframe.drawing.plan import Plan
from salframe.drawing.text_placer import TextPlacer
from salframe.graphs.detections import Detections
from salframe.graphs.graph import GraphConfig, build_graph
from salframe.panoramas.camera import Camera
from salframe.panoramas.geometry import equirectangular_rays

HEIGHT = 640
GREY = np.full((HEIGHT, 2 * HEIGHT, 3), 128, np.uint8)


def outlined(rgb: np.ndarray, detections: Detections, camera: Camera | None = None) -> np.ndarray:
    lines = find_lines(len(rgb), detections, camera)
    return draw_outlines(rgb, detections, lines, choose_colours(detections.labels))


def is_colour(image: np.ndarray, detections: Detections, label: str) -> np.ndarray:
    return (image == choose_colours(detections.labels)[label]).all(-1)


def off_outline(coloured: np.ndarray, rays: np.ndarray, centre_m, radius_m: float) -> np.ndarray:
    """Return the distances, in radians, of the pixels in an object's colour from its outline."""
    towards = np.array(centre_m) / np.linalg.norm(centre_m)
    return np.arccos(np.clip(rays[coloured] @ towards, -1, 1)) - angular_radius(centre_m, radius_m)


@pytest.mark.parametrize("with_range", [True, False])
@pytest.mark.parametrize(("label", "centre_m", "radius_m", "score"), BALLS)
def test_a_panorama_has_outlines_around_the_objects(label, centre_m, radius_m, score, with_range):
    detections = balls(with_range)
    coloured = is_colour(outlined(GREY, detections), detections, label)
    off = off_outline(coloured, equirectangular_rays(HEIGHT), centre_m, radius_m)
    assert len(off) > 100
    assert np.abs(off).max() < 2 * np.pi / 256  # the detector's pixels, and half of the line
    if label == "ottoman":
        columns = np.flatnonzero(coloured.any(0))
        assert columns.min() < 100
        assert columns.max() > 2 * HEIGHT - 100
        assert not ((columns > 200) & (columns < 2 * HEIGHT - 200)).any()


UPWARDS = Camera.of_field_of_view(1300, 900, 80, elevation_deg=25)
BARREL = replace(UPWARDS, distortion_model="plumb_bob", distortion=(-0.2, 0.05, 0.001, 0.002, 0))


@pytest.mark.parametrize("with_range", [True, False])
@pytest.mark.parametrize("camera", [UPWARDS, BARREL], ids=["pinhole", "barrel"])
def test_a_photograph_is_drawn_in_its_own_pixels(camera, with_range):
    detections = balls(with_range)
    drawn = outlined(np.full((900, 1300, 3), 128, np.uint8), detections, camera)
    assert drawn.shape == (900, 1300, 3)
    rays = camera.rays()
    label, centre_m, radius_m, _ = BALLS[1]
    off = off_outline(is_colour(drawn, detections, label), rays, centre_m, radius_m)
    assert len(off) > 100
    assert np.abs(off).max() < 2 * np.pi / 256
    assert not is_colour(drawn, detections, "ottoman").any()  # behind the camera


def test_around_a_pole_the_outline_is_a_line_across_and_nothing_else():
    unknown, down = np.full((1, 3), np.nan), np.array([[0, 0, -1.0]])
    solid_angle_sr = np.array([2 * np.pi * (1 - np.cos(np.radians(40)))])
    detections = Detections(("rug",), np.ones(1), unknown, unknown, np.full(1, np.nan), None, down, solid_angle_sr)
    drawn = outlined(GREY, detections)
    rows, columns = np.nonzero(is_colour(drawn, detections, "rug"))
    border = 140 / 180 * HEIGHT  # 50 deg down
    assert np.abs(rows + 0.5 - border).max() < 3
    assert set(columns) == set(range(2 * HEIGHT))
    changed = (drawn != 128).any(-1)
    assert changed[int(border) + 8 :].all()
    assert not changed[: int(border) - 8].any()


def test_names_lie_on_the_objects():
    """Naming changes boxes only, each of which is near the middle of its object."""
    detections = balls(False)
    colours, lines = choose_colours(detections.labels), find_lines(HEIGHT, detections)
    named = name_objects(GREY, detections, lines, colours)
    for i, (label, centre_m, _, _) in enumerate(BALLS):
        rows, columns = np.nonzero((named == colours[label]).all(-1))
        x, y, z = np.array(centre_m) / np.linalg.norm(centre_m)
        column, row = (1 - np.arctan2(y, x) / np.pi) * HEIGHT, (0.5 - np.arcsin(z) / np.pi) * HEIGHT
        reach = np.ptp(np.vstack(lines[i])[:, 1]) / 2 + 20
        away = np.abs((columns.mean() - column + HEIGHT) % (2 * HEIGHT) - HEIGHT)
        assert away < np.ptp(columns)
        assert abs(rows.mean() - row) < reach
    assert (named == GREY).all(-1).mean() > 0.98


def test_a_name_lies_on_a_large_object_and_beside_a_small_one():
    placer = TextPlacer(1000, 500, 20)
    placer.put("table", (1, 2, 3), np.array([300, 200, 700, 400]), np.array([500.0, 300]))
    placer.put("cup", (1, 2, 3), np.array([100, 100, 104, 104]), np.array([102.0, 102]))
    table, cup = placer.text_boxes
    np.testing.assert_allclose(table.box.reshape(2, 2).mean(0), [500, 300])
    assert cup.box[3] <= 100
    assert cup.box[0] < 102 < cup.box[2]
    assert table.leads_to is cup.leads_to is None


def test_crowded_names_keep_clear_of_each_other_and_stay_in_the_picture():
    placer = TextPlacer(1200, 700, 18)
    for number in range(40):
        at = np.array([1190.0, 5.0]) - (number % 7, -(number % 5))
        placer.put(f"chair 0.{number:02d}", (9, 9, 9), np.concatenate([at - 2, at + 2]), at)
    boxes = np.array([name.box for name in placer.text_boxes])
    assert (boxes[:, :2] >= 0).all()
    assert (boxes[:, 2:] <= (1200, 700)).all()
    a, b = np.triu_indices(len(boxes), 1)
    overlap = np.minimum(boxes[a, 2:], boxes[b, 2:]) - np.maximum(boxes[a, :2], boxes[b, :2])
    assert not (overlap > 1e-6).all(1).any()
    assert sum(name.leads_to is not None for name in placer.text_boxes) > 20


def test_a_label_has_its_colour_in_every_picture_and_no_two_share_one():
    alone, many = choose_colours(["sofa"]), choose_colours(f"thing {number}" for number in range(len(COLOURS)))
    assert alone == choose_colours(["sofa", "sofa"])
    assert len(set(many.values())) == len(COLOURS)
    assert len(choose_colours(f"thing {number}" for number in range(50))) == 50


def plan_of(detections: Detections) -> tuple[Plan, np.ndarray]:
    graph = build_graph(detections, np.full(len(detections), 1 / len(detections)), GraphConfig())
    colours = choose_colours(detections.labels)
    plan = Plan(detections, graph, colours, 800)
    return plan, np.array([(plan.image == colours[label]).all(-1) for label in detections.labels])


def test_the_plan_looks_ahead_upwards_and_has_nodes_at_their_positions():
    detections = balls(True)
    plan, coloured = plan_of(detections)
    np.testing.assert_allclose(plan.pixel((0, 0)), (400, 400))
    ahead, left = plan.pixel((1, 0)) - 400, plan.pixel((0, 1)) - 400
    assert ahead[0] == left[1] == 0
    assert ahead[1] == left[0] < 0
    for centroid, colour in zip(detections.centroid_m, coloured, strict=True):
        x, y = np.round(plan.pixel(centroid[:2])).astype(int)
        assert colour[y - 2 : y + 2, x - 2 : x + 2].all()


def test_what_lies_far_beyond_the_others_is_named_at_the_plans_border():
    """Nine objects 1 m away and one 30 m to the right, which does not determine the scale."""
    angle = np.linspace(0, 2 * np.pi, 9, endpoint=False)
    centroid = np.vstack([np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]), [[0, -30, 0]]])
    detections = Detections((*("cup",) * 9, "tower"), np.ones(10), centroid, np.full((10, 3), 0.1), np.zeros(10))
    plan, coloured = plan_of(detections)
    assert np.hypot(*(plan.pixel(centroid[0, :2]) - 400)) > 100
    rows, columns = np.nonzero(coloured[9])
    assert columns.min() > 800 - 160
    assert columns.max() >= 797
    assert abs(rows.mean() - 400) < 40


def test_without_range_the_plan_has_rays():
    detections = balls(False)
    colours = choose_colours(detections.labels)
    plan = Plan(detections, None, colours, 800)
    for label, bearing in zip(detections.labels, detections.bearing, strict=True):
        azimuth = np.arctan2(bearing[1], bearing[0])
        x, y = np.round(plan.pixel(0.5 * np.array([np.cos(azimuth), np.sin(azimuth)]))).astype(int)
        assert (plan.image[y - 1 : y + 1, x - 1 : x + 1] == colours[label]).all(-1).any()


@pytest.mark.parametrize("size", [(96, 192), (640, 1280), (2700, 5400)])
def test_a_picture_is_of_a_size_to_read(size):
    drawn = draw_objects(np.full((*size, 3), 128, np.uint8), balls(True), title="grey " * 100)
    assert drawn.dtype == np.uint8
    assert 1280 <= drawn.shape[1] <= 2700
    assert drawn.shape[0] > drawn.shape[1]


def test_nothing_found_is_a_picture_too():
    empty = Detections.empty()
    assert draw_objects(GREY, empty, saliency=np.zeros(0)).shape[1] == 2 * HEIGHT
    graph = build_graph(empty, np.zeros(0), GraphConfig())
    assert Plan(empty, graph, {}, 300).image.shape == (300, 300, 3)
