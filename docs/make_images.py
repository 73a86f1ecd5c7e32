"""Draw the pictures of the documentation into docs/images: `python docs/make_images.py`. Takes some minutes, most of it
rendering."""

from __future__ import annotations

import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from PIL import Image
from salframe_house.frames import choose_frames
from salframe_house.render import HouseRenderer
from salframe_house.rendering import buildings, frames_of, render_frame

from salframe import build_map, open_topology
from salframe.drawing.floor_picture import draw_topology
from salframe.drawing.import_preview import preview_import
from salframe.evaluation.finished_runs import write_report
from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.graphs.detections import Detections
from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.geometry import pose_2d, rays_to_pixels
from salframe.panoramas.importing import import_data
from salframe.panoramas.opening import configure_dataset, find_dataset, reference_frames
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.topology.build import build_topology

RIGHT, WRONG = "#0072b2", "#d55e00"
IMAGES = Path(__file__).with_name("images")
SAMPLE = Path(__file__).parent / "tutorials" / "apartment"
SEED = 7
QUERY = 5
FRAME = "map-bedroom-01-0"
HEIGHT = 768
LOST = {"two rooms with the same furniture": (204, "query-0222"), "objects of adjacent rooms": (200, "query-0108")}
"""Causes of wrong answers of `proposed`, each with the seed of a house-42 and a query in it."""
HALO = [patheffects.withStroke(linewidth=2.5, foreground="white")]


def draw_panorama_graph(path: Path) -> None:
    """A rendered panorama with its objects and context edges, beside its saliency graph seen from above."""
    building, changed = buildings("home", 12, SEED, 0.1)
    spec = next(frame for frame in choose_frames(building, changed, SEED) if frame.id == FRAME)
    rendering = HouseRenderer(building.scene(), "day", HEIGHT).render(
        pose_2d(spec.x_m, spec.y_m, spec.yaw_rad, spec.z_m)
    )
    annotations = Annotations(rendering.instance_id, building.labels)
    panorama = Panorama(FRAME, rendering.rgb, rendering.range_m, annotations=annotations)
    config = configure(
        "localizer",
        "proposed",
        settings("localizer", "proposed"),
        [{"detector": {"kind": "annotations", "noise": "none"}}],
    )
    graph = registry().build("localizer", config).graph(panorama)

    palette = plt.get_cmap("tab20").colors
    colours = {label: palette[i % len(palette)] for i, label in enumerate(sorted(set(graph.labels)))}
    figure, (image, plan) = plt.subplots(1, 2, figsize=(13.5, 4.5), width_ratios=(2.6, 1), layout="constrained")
    _draw_image(image, panorama, graph, colours)
    _draw_plan(plan, graph, colours)
    figure.savefig(path, dpi=120, bbox_inches="tight", pil_kwargs={"quality": 82})


def _draw_image(axes: Axes, panorama: Panorama, graph: SaliencyGraph, colours: dict[str, tuple]) -> None:
    """The panorama between 60 degrees above and below the horizon, under a ruler of azimuths."""
    height = len(panorama.rgb)
    axes.imshow(panorama.rgb)
    for instance, label in panorama.annotations.labels.items():
        mask = panorama.annotations.instance_id == instance
        if label in colours and mask.any():
            axes.contour(mask, [0.5], colors=[colours[label]], linewidths=1.6)
    column, row = rays_to_pixels(graph.centroid_m, height)
    for a, b in graph.edges:
        # An edge across the seam is drawn from both sides of the picture.
        step = (column[b] - column[a] + height) % (2 * height) - height
        for start, end in ((column[a], column[a] + step), (column[b] - step, column[b])):
            axes.plot([start, end], [row[a], row[b]], color="white", linewidth=1.2, alpha=0.9)
    for label, x, y in zip(graph.labels, column, row, strict=True):
        axes.plot(x, y, "o", color=colours[label], markeredgecolor="white", markersize=7)
        _write(axes, label, x, y)
    axes.set(xlim=(0, 2 * height), ylim=(height * 5 / 6, height / 6), yticks=[], xlabel="")
    azimuth_deg = np.arange(-180, 181, 30)
    axes.set_xticks((180 - azimuth_deg) / 180 * height, [f"{a}°" for a in azimuth_deg])
    axes.xaxis.tick_top()
    axes.set_title("azimuth in the panorama's frame: 0° is ahead (+x), left is positive", fontsize=11, pad=10)


def _draw_plan(axes: Axes, graph: SaliencyGraph, colours: dict[str, tuple]) -> None:
    """The graph from above, x up as the picture's centre is ahead; a node's area is its saliency, an edge's width its
    weight."""
    ahead, left = graph.centroid_m[:, 0], graph.centroid_m[:, 1]
    for (a, b), weight in zip(graph.edges, graph.weights, strict=True):
        axes.plot(left[[a, b]], ahead[[a, b]], color="0.6", linewidth=0.8 + 14 * weight, zorder=1)
    axes.scatter(
        left,
        ahead,
        s=40 + 2600 * graph.saliency,
        c=[colours[label] for label in graph.labels],
        edgecolors="white",
        zorder=2,
    )
    for label, x, y, share in zip(graph.labels, left, ahead, graph.saliency, strict=True):
        text = f"{label} {share:.0%}" if share >= 0.01 else label
        _write(axes, text, x, y)
    axes.annotate("", (0, 0.7), (0, 0), arrowprops={"arrowstyle": "-|>", "color": "black"}, zorder=3)
    axes.plot(0, 0, "ko", zorder=5)
    axes.set_aspect("equal")
    axes.margins(0.22, 0.12)
    axes.invert_xaxis()
    axes.set(xlabel="y (m), left of the panorama", ylabel="x (m), ahead")
    axes.grid(color="0.93")
    axes.set_axisbelow(True)
    axes.set_title("the same graph from above; percent: saliency", fontsize=11, pad=10)


def _write(axes: Axes, text: str, x: float, y: float) -> None:
    """A label above a point."""
    axes.annotate(
        text, (x, y), (0, 8), textcoords="offset points", ha="center", fontsize=10, path_effects=HALO, zorder=4
    )


def draw_detections(path: Path) -> None:
    """What `annotations` and `panoseg` (a score of 0.5) see in rooms of buildings that training never saw."""
    figure, axes = plt.subplots(4, 1, figsize=(13.5, 19), layout="constrained")
    annotated = registry().build("detector", configure("detector", "annotations", {"noise": "none"}))
    panoseg = registry().build("detector", configure("detector", "panoseg", {"min_score": 0.5}))
    for pair, (style, lighting, frame) in zip(
        axes.reshape(2, 2), (("home", "day", FRAME), ("office", "dim", "map-meeting-room-01-0")), strict=True
    ):
        building, changed = buildings(style, 12, SEED, 0.1)
        spec = next(spec for spec in choose_frames(building, changed, SEED) if spec.id == frame)
        rendering = HouseRenderer(building.scene(), lighting, HEIGHT).render(
            pose_2d(spec.x_m, spec.y_m, spec.yaw_rad, spec.z_m)
        )
        panorama = Panorama(
            frame, rendering.rgb, rendering.range_m, annotations=Annotations(rendering.instance_id, building.labels)
        )
        for each, name, detector in zip(
            pair, ("annotated", "panoseg, score at least 0.5"), (annotated, panoseg), strict=True
        ):
            _draw_objects(each, panorama, detector.detect(panorama))
            each.set_title(f"{style}, {lighting}: {name}", fontsize=11)
    figure.savefig(path, dpi=100, bbox_inches="tight", pil_kwargs={"quality": 80})


def _draw_objects(axes: Axes, panorama: Panorama, detections: Detections) -> None:
    """The panorama with the outline and label of each object, at the network's resolution."""
    palette = plt.get_cmap("tab20").colors
    rows = 256
    scale = len(panorama.rgb) / rows
    axes.imshow(panorama.rgb)
    for number, (label, points_m) in enumerate(zip(detections.labels, detections.points_m or (), strict=True)):
        mask = np.zeros((rows, 2 * rows), bool)
        column, row = (np.floor(values).astype(int) for values in rays_to_pixels(points_m, rows))
        mask[np.clip(row, 0, rows - 1), column % (2 * rows)] = True
        extent = (np.arange(2 * rows) + 0.5) * scale, (np.arange(rows) + 0.5) * scale
        axes.contour(*extent, mask, [0.5], colors=[palette[number % len(palette)]], linewidths=1.4)
        x, y = rays_to_pixels(detections.centroid_m[number : number + 1], len(panorama.rgb))
        _write(axes, label, x[0], y[0])
    axes.set(
        xlim=(0, 2 * len(panorama.rgb)), ylim=(len(panorama.rgb) * 5 / 6, len(panorama.rgb) / 6), xticks=[], yticks=[]
    )


def draw_floor(path: Path) -> None:
    """The floor plan of house-42: reference frames, and queries with correct and wrong answers of `proposed`."""
    overrides = ["data.rgb=false", f"data.seed={SEED}"]
    run = Run.load(compare(Request(("proposed",), "house-42", settings=tuple(overrides))).run)
    dataset = find_dataset("house-42", overrides=overrides)
    rows = run.rows("proposed", AnswerRow)
    truths = [dataset.truth(row.query) for row in rows]
    answers = [row.places[0].place if row.places else None for row in rows]
    correct = np.array([answer == truth.place for answer, truth in zip(answers, truths, strict=True)])
    query_m = np.array([truth.T_world_pano[:2, 3] for truth in truths])
    map_m = np.array([frame.T_world_pano[:2, 3] for frame in reference_frames(dataset)])
    (floor,) = dataset.floors()

    height, width = floor.region.shape
    figure, axes = plt.subplots(figsize=(11, 11 * height / width + 0.9), layout="constrained")
    left_m, top_m = floor.origin_m
    extent = (left_m, left_m + width * floor.resolution_m, top_m - height * floor.resolution_m, top_m)
    axes.imshow(_floor_picture(floor), extent=extent, interpolation="nearest")
    axes.plot(*map_m.T, "+", color="0.35", markersize=7, label=f"reference frame ({len(map_m)})")
    axes.plot(*query_m[correct].T, "o", color=RIGHT, markersize=5, label=f"query, correct room ({correct.sum()})")
    axes.plot(*query_m[~correct].T, "X", color=WRONG, markersize=10, label=f"query, wrong room ({(~correct).sum()})")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, frameon=False)
    figure.savefig(path, dpi=110, bbox_inches="tight")


def draw_lost(path: Path) -> None:
    """Two queries of house-42 with a wrong answer of `proposed` and the objects of its detector. Below each query: the
    panorama of the answer, and the panorama with the highest score of the correct room."""
    figure, axes = plt.subplots(3, 2, figsize=(19, 10.4), layout="constrained")
    detector = registry().build("detector", configure("detector", "annotations", {}))
    for column, (cause, (seed, query)) in zip(axes.T, LOST.items(), strict=True):
        settings = ("data.rgb=false", f"data.seed={seed}")
        run = Run.load(compare(Request(("proposed",), "house-42", settings=settings)).run)
        (row,) = (row for row in run.rows("proposed", AnswerRow) if row.query == query)
        place = find_dataset("house-42", overrides=settings).truth(query).place
        answer, correct = row.places[0], next(one for one in row.places if one.place == place)
        config = configure_dataset("house-42", None, [{"seed": seed}])[1]
        frames = {frame.id: frame for frame in frames_of(config)}
        titles = (
            f"query in {place} ({cause})",
            f"answer: {answer.place}, score {answer.score:.1f}",
            f"correct place: {place}, score {correct.score:.1f}",
        )
        for each, id, title in zip(column, (query, answer.frame, correct.frame), titles, strict=True):
            panorama = render_frame(config, frames[id])
            _draw_objects(each, panorama, detector.detect(panorama))
            each.set_title(title, fontsize=13)
    figure.savefig(path, dpi=80, bbox_inches="tight", pil_kwargs={"quality": 80})


def draw_map(path: Path) -> None:
    """The topological map of house-12."""
    dataset = find_dataset("house-12", overrides=["data.rgb=false"])
    draw_topology(build_topology(dataset.floors(), reference_frames(dataset)), path)


def draw_apartment(contact_sheet: Path, top_view: Path, plan: Path) -> None:
    """The sample recording of the tutorials: its panoramas and its poses before the import, and its map."""
    pictures, floors = SAMPLE / "pictures", SAMPLE / "floors.yaml"
    with TemporaryDirectory() as name:
        folder, saved = Path(name) / "apartment", Path(name) / "apartment.map"
        preview = preview_import("pictures", pictures, folder, floors=floors)
        for drawn, path in zip(preview.pictures, (contact_sheet, top_view), strict=True):
            Image.open(drawn).convert("RGB").save(path, quality=82)
        import_data("pictures", pictures, folder, floors=floors)
        build_map(str(folder), saved, overrides=["detector.kind=panoseg"])
        draw_topology(open_topology(saved), plan)


def draw_report(path: Path) -> None:
    """A query of `house-6` as the report shows it, in headless Chromium."""
    request = Request(("proposed", "objects", "sovs"), "house-6", settings=(f"data.seed={SEED}",))
    with TemporaryDirectory() as folder:
        page = write_report([compare(request).run], Path(folder) / "report.html").path
        picture = page.with_suffix(".png")
        flags = [
            "--headless=new",
            "--no-sandbox",
            "--hide-scrollbars",
            "--window-size=1280,920",
            "--virtual-time-budget=3000",
        ]
        subprocess.run(["chromium", *flags, f"--screenshot={picture}", f"{page.as_uri()}#q0-{QUERY}"], check=True)
        Image.open(picture).convert("RGB").save(path, quality=82)


def _floor_picture(floor: FloorMasks) -> np.ndarray:
    """(rows, columns, 3) uint8: rooms in pale colours, obstacles darker, no floor white."""
    palette = np.array(plt.get_cmap("Pastel2").colors)
    colour = palette[floor.region % len(palette)] * np.where(floor.obstacle, 0.85, 1.0)[..., None]
    inside = floor.free | (floor.region > 0)
    return (np.where(inside[..., None], colour, 1.0) * 255).astype(np.uint8)


if __name__ == "__main__":
    IMAGES.mkdir(exist_ok=True)
    draw_panorama_graph(IMAGES / "panorama-graph.jpg")
    draw_detections(IMAGES / "panoseg.jpg")
    draw_floor(IMAGES / "floor.png")
    draw_lost(IMAGES / "lost.jpg")
    draw_map(IMAGES / "topological-map.png")
    draw_apartment(*(IMAGES / name for name in ("apartment-panoramas.jpg", "apartment-poses.png", "apartment-map.png")))
    draw_report(IMAGES / "report.jpg")
