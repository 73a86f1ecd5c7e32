"""What a detector finds in panoramas and photographs, to look at: a picture of each."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from salframe.drawing.object_picture import draw_objects
from salframe.framework.components.auto import Choice
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import list_settings
from salframe.framework.components.slots import slot
from salframe.framework.config import merge, nest, parse_override
from salframe.framework.errors import (
    ConfigError,
    DataError,
    InputMissing,
    InvalidAnswer,
    PluginFailed,
    RequirementMissing,
    UnknownName,
    WeightsMissing,
    describe_error,
)
from salframe.framework.files.reading import image_notes
from salframe.framework.files.writing import atomic_path
from salframe.framework.validation import Settings, validate
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.graph import GraphConfig, SaliencyGraph, build_graph
from salframe.graphs.saliency import SaliencyModel
from salframe.panoramas.camera_height import units_note
from salframe.panoramas.opening import Progress
from salframe.panoramas.panorama import Panorama

if TYPE_CHECKING:
    from salframe.panoramas.shot import Shot

SUFFIX, MARK = ".objects.png", ("Software", "salframe show-objects")
"""How a picture's name ends, and the text in the file by which it is known to be one."""
SETUP_ERRORS = (ConfigError, UnknownName, PluginFailed, RequirementMissing, WeightsMissing)
"""What is wrong with the settings or the machine, not with an image."""


class ShowConfig(Settings):
    """What `--set` changes: the detector, and how its objects become a saliency graph."""

    detector: slot("detector")  # type: ignore[valid-type]
    saliency: slot("saliency")  # type: ignore[valid-type]
    graph: GraphConfig = GraphConfig.model_validate({})


@dataclass(frozen=True, eq=False)
class ObjectView:
    """What was found in an image: where its picture lies, the detector with those of its settings that are not as they
    come, the objects in the panorama frame, their saliency (N,) float64, None where no range is known, and the seconds
    that detection took."""

    image: Path
    picture: Path
    detector: str
    detections: Detections
    saliency: np.ndarray | None
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """Angles in degrees, lengths in metres, null for what is not known."""
        found = self.detections
        x, y, z = found.bearing.T
        range_m = np.linalg.norm(found.centroid_m, axis=1)
        objects = [
            {
                "label": found.labels[i],
                "score": float(found.scores[i]),
                "azimuth_deg": _number(np.degrees(np.arctan2(y[i], x[i]))),
                "elevation_deg": _number(np.degrees(np.arctan2(z[i], np.hypot(x[i], y[i])))),
                "range_m": _number(range_m[i]),
                "size_m": found.size_m[i].tolist() if np.isfinite(found.size_m[i]).all() else None,
                "saliency": None if self.saliency is None else float(self.saliency[i]),
            }
            for i in range(len(found))
        ]
        named = {"image": str(self.image), "picture": str(self.picture), "detector": self.detector}
        return {**named, "seconds": self.seconds, "objects": objects}


@dataclass(frozen=True, eq=False)
class ObjectViews:
    """The images that were shown, in the order in which they were named, why others were not, in a line each,
    and notes:
    what `auto` became, and which ranges seem to be in a wrong unit."""

    views: tuple[ObjectView, ...]
    failures: Mapping[Path, str]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        return {
            "images": [view.to_json() for view in self.views],
            "failures": [{"image": str(image), "error": error} for image, error in self.failures.items()],
        }


def show_objects(
    images: Sequence[str | Path],
    output: str | Path = ".",
    *,
    detector: str | None = None,
    overrides: Sequence[str] = (),
    range_image: str | Path | None = None,
    fov_deg: float | None = None,
    pitch_deg: float | None = None,
    progress: Progress | None = None,
) -> ObjectViews:
    """Detect objects in images and write a picture of each to the folder `output`, as NAME.objects.png.

    An image twice as wide as high is a panorama; one that a manifest.json names comes with the other parts of its
    frame. fov_deg makes photographs of them, of this horizontal field of view, taken looking up by pitch_deg.
    range_image is the range of the one image: along the ray of a panorama, z-depth of a photograph, 16 bits,
    millimetres. An image that cannot be shown costs its own answer alone. Raises SalframeError on names and settings
    that are wrong.
    """
    paths, output = [Path(image) for image in images], Path(output)
    range_image = None if range_image is None else Path(range_image)
    _check(paths, output, range_image, fov_deg, pitch_deg)
    content = _nest(detector, overrides)
    stages: dict[frozenset[str], _Stages] = {}  # by what an image provides, on which `auto` depends
    views, failures = [], {}
    notes: dict[str, None] = {}
    for done, image in enumerate(paths):
        if progress:
            progress("show-objects", done, len(paths))
        try:
            picture = output / (image.stem + SUFFIX)
            _check_picture(picture)
            shot = _open(image, range_image, fov_deg, pitch_deg)
            provides = shot.panorama.provides
            if provides not in stages:
                choice = Choice(image.name, partial(frozenset, provides))
                stages[provides] = _Stages(validate(ShowConfig, content, "show-objects", choice))
                notes |= dict.fromkeys(choice.notes)
            if units := units_note([replace(shot.panorama, id=image.name)]):
                notes[f"warning: {units}"] = None
            views.append(_show(image, picture, shot, stages[provides]))
        except SETUP_ERRORS:
            raise
        except Exception as error:
            failures[image] = describe_error(error)
    if progress:
        progress("show-objects", len(paths), len(paths))
    return ObjectViews(tuple(views), failures, tuple(notes))


def _check(
    images: Sequence[Path], output: Path, range_image: Path | None, fov_deg: float | None, pitch_deg: float | None
) -> None:
    """Raises ConfigError on what would go wrong with every image."""
    if not images:
        raise ConfigError("received no image, expected at least one")
    if range_image is not None and len(images) != 1:
        raise ConfigError(f"received {len(images)} images and the range of one, expected one image with --range")
    if pitch_deg is not None and fov_deg is None:
        raise ConfigError("received --pitch without --fov, expected the field of view of photographs with it")
    if output.exists() and not output.is_dir():
        raise ConfigError(f"{output} is a file, expected a folder for the pictures")
    stem, count = Counter(image.stem for image in images).most_common(1)[0]
    if count > 1:
        raise ConfigError(
            f"{count} images would all be shown as {stem}{SUFFIX}: show them one by one, each in a folder"
        )


def _nest(detector: str | None, overrides: Sequence[str]) -> dict[str, Any]:
    """The settings of a ShowConfig as nested mappings."""
    content: dict[str, Any] = {} if detector is None else {"detector": detector}
    for override in overrides:
        content = merge(content, nest(*parse_override(override)))
    return content


def _open(image: Path, range_image: Path | None, fov_deg: float | None, pitch_deg: float | None) -> Shot:
    from salframe.panoramas.shot import open_panorama, open_photograph

    if fov_deg is None:
        return open_panorama(image, range_image)
    return open_photograph(image, np.radians(fov_deg), np.radians(pitch_deg or 0.0), range_image)


class _Stages:
    """From a panorama to its objects and their graph."""

    def __init__(self, config: ShowConfig) -> None:
        self._detector: Detector = registry().build("detector", config.detector)
        self._saliency: SaliencyModel = registry().build("saliency", config.saliency)
        self._graph = config.graph
        changed = [
            f"{one.key}={Path(str(one.value)).name}"
            for one in list_settings(config.detector)
            if one.value != one.default
        ]
        self.detector = f"{config.detector.kind} ({', '.join(changed)})" if changed else config.detector.kind

    def detect(self, panorama: Panorama) -> tuple[Detections, float]:
        """The objects, and the seconds it took. Raises InputMissing, InvalidAnswer."""
        absent = sorted(self._detector.needs - panorama.provides)
        if absent:
            hint = " (--range FILE)" if absent == ["range"] else ""
            raise InputMissing(f"{self._detector.name} needs {' and '.join(absent)}{hint}, which {panorama.id} has not")
        start = time.perf_counter()
        found = self._detector.detect(panorama)
        seconds = time.perf_counter() - start
        if not isinstance(found, Detections):
            raise InvalidAnswer(f"detect gave {type(found).__name__}, expected Detections")
        return found, seconds

    def link(self, found: Detections) -> tuple[np.ndarray | None, SaliencyGraph | None]:
        """The objects' saliency and their graph; neither where no object's position is known."""
        if not np.isfinite(found.centroid_m).all(1).any():
            return None, None
        saliency = self._saliency.score(found)
        return saliency, build_graph(found, saliency, self._graph)


def _show(image: Path, picture: Path, shot: Shot, stages: _Stages) -> ObjectView:
    found, seconds = stages.detect(shot.panorama)
    saliency, graph = stages.link(found)
    title = f"{image.name}    {stages.detector}: {len(found)} objects in {seconds:.2f} s"
    drawn = draw_objects(shot.rgb, found, saliency=saliency, graph=graph, camera=shot.camera, title=title)
    _write_picture(picture, drawn)
    return ObjectView(image, picture, stages.detector, found, saliency, seconds)


def _check_picture(path: Path) -> None:
    """Raises DataError where another file than a picture of ours has the name."""
    if path.exists() and image_notes(path).get(MARK[0]) != MARK[1]:
        raise DataError(f"{path} is there and no picture of show-objects: remove it, or name another folder (-o)")


def _write_picture(path: Path, drawn: np.ndarray) -> None:
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    mark = PngInfo()
    mark.add_text(*MARK)
    try:
        with atomic_path(path) as temporary:
            Image.fromarray(drawn).save(temporary, "PNG", pnginfo=mark)
    except OSError as error:
        raise DataError(f"cannot write {path}: {error.strerror or error}") from None


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
