"""Draw a plan of a saliency graph viewed from above, with the camera in the middle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from salframe.drawing.canvas import INK, PAPER, Colour, disk, fill, fill_translucent, stroke
from salframe.drawing.text_placer import TextPlacer
from salframe.graphs.detections import Detections
from salframe.graphs.graph import SaliencyGraph, box_footprints
from salframe.panoramas.camera import Camera

GROUND, VIEW, RING, EDGE = (247, 248, 250), (233, 236, 242), (206, 211, 219), (118, 128, 146)
BEARING_LENGTH = 0.82
"""Length of the rays to objects of unknown range, divided by the distance from the camera to the upper edge of the
plan."""
MAX_NAMES = 30
"""Maximum number of objects with a name: the most salient objects."""
MAX_RINGS, RING_METRES = 6, (0.5, 1, 2, 5, 10, 20, 50)
"""Maximum number of rings around the camera, and possible distances between two rings in metres."""


class Plan:
    """A square plan viewed from above, with the +x axis of the panorama up. Objects are drawn as boxes; if no position
    is known, as rays.

    Args:
        detections: The detections.
        graph: Saliency graph of the detections; None if no position is known.
        colours: Colour of each label.
        side: Side of the plan in pixels.
        camera: The camera of a photograph; None for a panorama. The camera of a photograph is placed near the lower
            edge, and its field of view is shaded.
    """

    def __init__(
        self,
        detections: Detections,
        graph: SaliencyGraph | None,
        colours: Mapping[str, Colour],
        side: int,
        camera: Camera | None = None,
    ) -> None:
        self._side, self._colours, self._points = side, colours, max(11, round(side / 50))
        self._middle = np.array([side / 2, side * (0.5 if camera is None else 0.92)])
        self._image: np.ndarray = np.full((side, side, 3), GROUND, np.uint8)
        self._placer = TextPlacer(side, side, self._points)
        self._placer.taken.append(np.concatenate([self._middle - self._points, self._middle + self._points]))
        reach_m = 1.0 if graph is None else _reach(graph)
        self._scale = (self._middle[1] - 2.2 * self._points) / reach_m
        if camera is not None:
            self._shade_view(camera)
        self._name_sides(all_around=camera is None)
        if graph is None:
            self._draw_ring(BEARING_LENGTH)
        else:
            self._draw_rings(reach_m)
        self._image = self._placer.draw(self._image)  # names of rings and sides, under the objects
        self._placer.text_boxes.clear()
        if graph is None:
            self._draw_rays(detections)
        else:
            self._draw_graph(graph)
        head = side / 55 * np.array([(0, -1.3), (0.8, 0.9), (0, 0.45), (-0.8, 0.9)])
        fill(self._image, self._middle + head, INK)

    @property
    def image(self) -> np.ndarray:
        """The plan, (side, side, 3) uint8."""
        return self._placer.draw(self._image)

    def pixel(self, xy_m: np.ndarray) -> np.ndarray:
        """Return the pixels (x, y) of the plan, (..., 2), for positions (x, y) in the panorama frame in metres."""
        return self._middle - np.asarray(xy_m)[..., ::-1] * self._scale

    def _draw_graph(self, graph: SaliencyGraph) -> None:
        """Draw boxes, edges, nodes and names. The width of an edge grows with its weight. The radius of a node grows
        with its saliency."""
        place, boxes = self.pixel(graph.centroid_m[:, :2]), self.pixel(box_footprints(graph))
        colours = [self._colours[label] for label in graph.labels]
        self._image = fill_translucent(self._image, zip(boxes, colours, strict=True), 0.35)
        for box, colour in zip(boxes, colours, strict=True):
            stroke(self._image, box, colour, self._side / 600, closed=True)
        max_weight = graph.weights.max(initial=1e-9)
        for edge, weight in zip(graph.edges, graph.weights, strict=True):
            stroke(self._image, place[edge], EDGE, self._side / 900 * (1 + 4 * weight / max_weight))
        share = graph.saliency / max(graph.saliency.max(initial=0), 1e-9)
        radius = self._side / 160 * (0.6 + 1.6 * np.sqrt(share))
        around = np.concatenate([place - radius[:, None], place + radius[:, None]], 1)
        self._placer.taken += list(around)
        for centre, r, colour in zip(place, radius, colours, strict=True):
            disk(self._image, centre, r + self._side / 500, PAPER)
            disk(self._image, centre, r, colour)
        for i in range(min(len(graph), MAX_NAMES)):
            label, inside = graph.labels[i], ((place[i] >= 0) & (place[i] < self._side)).all()
            if inside:
                self._placer.put(label, colours[i], around[i], place[i])
            else:
                far_m = np.hypot(*graph.centroid_m[i, :2])
                self._write(f"{label}, {far_m:.1f} m", self._towards(place[i]), colours[i])

    def _towards(self, beyond: np.ndarray) -> np.ndarray:
        """Return the point where the line from the camera to a pixel outside the plan leaves the plan."""
        ahead = beyond - self._middle
        room = np.where(ahead > 0, self._side - self._middle, self._middle) / np.maximum(np.abs(ahead), 1e-9)
        return self._middle + room.min() * ahead

    def _draw_rays(self, detections: Detections) -> None:
        """Draw each object as a ray with its bearing, inside a sector whose width is the square root of its solid
        angle."""
        across = np.clip(np.sqrt(np.nan_to_num(detections.solid_angle_sr)), 0.01, np.pi)
        for label, bearing, width in zip(detections.labels, detections.bearing, across, strict=True):
            if not np.isfinite(bearing).all():
                continue
            azimuth, colour = np.arctan2(bearing[1], bearing[0]), self._colours[label]
            edge = azimuth + width * np.linspace(-0.5, 0.5, 24)
            fan = np.vstack([[0, 0], np.column_stack([np.cos(edge), np.sin(edge)])]) * BEARING_LENGTH
            self._image = fill_translucent(self._image, [(self.pixel(fan), colour)], 0.3)
            towards = np.array([-np.sin(azimuth), -np.cos(azimuth)])
            tip = self._middle + BEARING_LENGTH * self._scale * towards
            stroke(self._image, np.stack([self._middle, tip]), colour, self._side / 400)
            beyond = np.abs(towards) @ self._placer.measure(label) / 2 + 2
            self._write(label, tip + beyond * towards, colour)

    def _draw_rings(self, reach_m: float) -> None:
        """Draw circles around the camera at round distances. Their distances are written to the front right of the
        camera."""
        step_m = next((metres for metres in RING_METRES if metres * MAX_RINGS >= reach_m), RING_METRES[-1])
        for radius_m in step_m * np.arange(1, reach_m // step_m + 1):
            self._draw_ring(radius_m)
            self._write(f"{radius_m:g} m", self.pixel(radius_m * np.array([np.sqrt(0.5), -np.sqrt(0.5)])))

    def _draw_ring(self, radius_m: float) -> None:
        angle = np.linspace(0, 2 * np.pi, 180, endpoint=False)
        ring = self.pixel(radius_m * np.column_stack([np.cos(angle), np.sin(angle)]))
        stroke(self._image, ring, RING, self._side / 900, closed=True)

    def _name_sides(self, *, all_around: bool) -> None:
        """Write the azimuth of each side of the plan, as seen from the camera."""
        inset, middle = 1.2 * self._points, self._side / 2
        self._write("0°", np.array([middle, inset]))
        if all_around:
            self._write("+90°", np.array([1.4 * inset, middle]))
            self._write("-90°", np.array([self._side - 1.4 * inset, middle]))
            self._write("180°", np.array([middle, self._side - inset]))

    def _shade_view(self, camera: Camera) -> None:
        """Shade the field of view of the photograph."""
        row = camera.rays()[camera.height // 2, :, :2]
        sides = row[np.isfinite(row).all(1)][[0, -1]]
        far = 2 * self._side / self._scale * sides / np.linalg.norm(sides, axis=1, keepdims=True)
        fill(self._image, np.stack([self._middle, *self.pixel(far)]), VIEW)

    def _write(self, text: str, at: np.ndarray, colour: Colour = GROUND) -> None:
        """Write a text centred on a pixel; nearby if there is no room."""
        self._placer.put(text, colour, np.concatenate([at, at]), at)


def _reach(graph: SaliencyGraph) -> float:
    """Return the distance from the camera that the plan shows, in metres. The plan shows all boxes except boxes that
    are much farther away than the others."""
    if not len(graph):
        return 1.0
    distance_m = np.hypot(graph.centroid_m[:, 0], graph.centroid_m[:, 1])
    ends_m = distance_m + np.hypot(graph.size_m[:, 0], graph.size_m[:, 1]) / 2
    return float(max(1.0, min(ends_m.max(), 3 * np.median(distance_m))))
