"""Draw pictures of the objects that a detector detects in panoramas and photographs."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from salframe.drawing.object_picture import draw_objects
from salframe.framework.components.auto import Choice, name_parts
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import list_settings
from salframe.framework.components.slots import slot
from salframe.framework.config import merge, parse_override
from salframe.framework.errors import (
    ConfigError,
    DataError,
    InputMissing,
    InvalidAnswer,
    PluginFailed,
    RequirementMissing,
    UnknownName,
    WeightsError,
    describe_error,
)
from salframe.framework.files.image_files import image_notes
from salframe.framework.files.writing import atomic_path
from salframe.framework.overrides import nest
from salframe.framework.validation import Settings, validate
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.graph import GraphConfig, SaliencyGraph, build_graph
from salframe.graphs.saliency import SaliencyModel
from salframe.panoramas.camera import Camera
from salframe.panoramas.camera_height import units_note
from salframe.panoramas.opening import Progress
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_encoding import MILLIMETRE, RangeEncoding, RangeKind
from salframe.panoramas.range_missing import missing_note
from salframe.panoramas.shot import Shot, missing_depth_note, open_panorama, open_photograph

SUFFIX, MARK = ".objects.png", ("Software", "salframe show-objects")
"""Suffix of the names of pictures, and the PNG text that marks a file as such a picture."""
SETUP_ERRORS = (ConfigError, UnknownName, PluginFailed, RequirementMissing, WeightsError)
"""Errors of the settings or the installation. They affect all images."""


class ShowConfig(Settings):
    """Settings for `--set`: the detector, and how a saliency graph is built from its objects."""

    detector: slot("detector")  # type: ignore[valid-type]
    saliency: slot("saliency")  # type: ignore[valid-type]
    graph: GraphConfig = GraphConfig.model_validate({})


@dataclass(frozen=True, eq=False)
class ObjectView:
    """The objects of an image.

    Attributes:
        image: Path of the image.
        picture: Path of the picture.
        detector: Name of the detector, and its settings that differ from the defaults.
        detections: N objects, in the panorama frame.
        saliency: (N,) float64, saliency of the objects; None if no position is known.
        seconds: Computing time of the detection.
    """

    image: Path
    picture: Path
    detector: str
    detections: Detections
    saliency: np.ndarray | None
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """Return the objects as JSON, with angles in degrees, lengths in metres, and null for unknown values."""
        detections = self.detections
        x, y, z = detections.bearing.T
        range_m = np.linalg.norm(detections.centroid_m, axis=1)
        objects = [
            {
                "label": detections.labels[i],
                "score": float(detections.scores[i]),
                "azimuth_deg": _number(np.degrees(np.arctan2(y[i], x[i]))),
                "elevation_deg": _number(np.degrees(np.arctan2(z[i], np.hypot(x[i], y[i])))),
                "range_m": _number(range_m[i]),
                "size_m": detections.size_m[i].tolist() if np.isfinite(detections.size_m[i]).all() else None,
                "saliency": None if self.saliency is None else float(self.saliency[i]),
            }
            for i in range(len(detections))
        ]
        named = {"image": str(self.image), "picture": str(self.picture), "detector": self.detector}
        return {**named, "seconds": self.seconds, "objects": objects}


@dataclass(frozen=True, eq=False)
class ObjectViews:
    """The results of `show_objects`.

    Attributes:
        views: The images that were shown, in the order of the arguments.
        failures: Mapping from the path of each other image to a one-line error.
        notes: Notes for the user: the component that `auto` selected, changes that were made when an image was read,
            and warnings on range images.
    """

    views: tuple[ObjectView, ...]
    failures: Mapping[Path, str]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return views and failures as JSON."""
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
    range_unit_m: float = MILLIMETRE,
    range_missing: Sequence[int] = (),
    range_kind: RangeKind | str | None = None,
    fov_deg: float | None = None,
    elevation_deg: float | None = None,
    camera: Camera | None = None,
    progress: Progress | None = None,
) -> ObjectViews:
    """Detect objects in images and write a picture of each to the folder `output`, as NAME.objects.png.

    Without `fov_deg` and `camera`, the images are equirectangular panoramas (width = 2 x height). If a manifest.json
    lists an image, the other parts of its frame are opened too. An image that cannot be shown does not affect the
    others.

    Args:
        images: Paths of the images.
        output: Folder for the pictures.
        detector: Name of the detector; None: the default detector.
        overrides: Settings of ShowConfig, "key.path=value" each.
        range_image: 16-bit range image, for a single image.
        range_unit_m: Metres per step of the range image.
        range_missing: Values of the range image that mean an unknown range, in addition to 0.
        range_kind: "ray": range along the ray, the default for panoramas; "z": z-depth of a photograph, the default for
            photographs; "cube": z-depth of the stitched cube faces of a panorama.
        fov_deg: Horizontal field of view of photographs, in degrees; None for panoramas.
        elevation_deg: Angle by which the camera of the photographs looks up, in degrees.
        camera: Camera of photographs, instead of `fov_deg` and `elevation_deg`.
        progress: Called with the name of the step, the number of images done and their total number.

    Raises:
        SalframeError: A name or setting is invalid, or a component cannot run.
    """
    paths, output = [Path(image) for image in images], Path(output)
    range_image = None if range_image is None else Path(range_image)
    _check(paths, output, range_image, fov_deg, elevation_deg, camera)
    are_photographs = fov_deg is not None or camera is not None
    default_kind = RangeKind.Z if are_photographs else RangeKind.RAY
    encoding = RangeEncoding(range_unit_m, tuple(range_missing), range_kind or default_kind)
    content = _nest(detector, overrides)
    stages: dict[frozenset[str], _Stages] = {}  # by the parts of an image, on which `auto` depends
    views, failures = [], {}
    notes: dict[str, None] = {}
    for done, image in enumerate(paths):
        if progress:
            progress("show-objects", done, len(paths))
        try:
            picture = output / (image.stem + SUFFIX)
            _check_picture(picture)
            if are_photographs:
                shot = open_photograph(
                    image,
                    range_image,
                    camera=camera,
                    fov_deg=fov_deg,
                    elevation_deg=elevation_deg or 0.0,
                    encoding=encoding,
                )
            else:
                shot = open_panorama(image, range_image, encoding)
            provides = shot.panorama.provides
            if provides not in stages:
                choice = Choice(image.name, partial(frozenset, provides))
                stages[provides] = _Stages(validate(ShowConfig, content, "", choice))
                notes |= dict.fromkeys(choice.notes)
            notes |= dict.fromkeys(f"{image.name}: {note}" for note in shot.panorama.notes)
            notes |= {f"warning: {note}": None for note in _range_notes(image, shot, encoding)}
            views.append(_show(image, picture, shot, stages[provides]))
        except SETUP_ERRORS:
            raise
        except Exception as error:
            failures[image] = describe_error(error)
    if progress:
        progress("show-objects", len(paths), len(paths))
    return ObjectViews(tuple(views), failures, tuple(notes))


def _check(
    images: Sequence[Path],
    output: Path,
    range_image: Path | None,
    fov_deg: float | None,
    elevation_deg: float | None,
    camera: Camera | None,
) -> None:
    """Check the arguments of `show_objects`.

    Raises:
        ConfigError: The arguments are invalid.
    """
    if not images:
        raise ConfigError("received no image, expected at least one")
    if range_image is not None and len(images) != 1:
        raise ConfigError(f"received {len(images)} images with --range, expected one image")
    if elevation_deg is not None and fov_deg is None:
        raise ConfigError(
            "received --elevation without --fov: add --fov DEG, the horizontal field of view of the photographs"
        )
    if camera is not None and fov_deg is not None:
        raise ConfigError("received both --camera and --fov, expected only one of them")
    if output.exists() and not output.is_dir():
        raise ConfigError(f"{output} is a file, expected a folder for the pictures")
    stem, count = Counter(image.stem for image in images).most_common(1)[0]
    if count > 1:
        raise ConfigError(
            f"{count} images would be drawn to the same file {stem}{SUFFIX}: draw them one by one, each to its own "
            f"folder (-o)"
        )


def _nest(detector: str | None, overrides: Sequence[str]) -> dict[str, Any]:
    """Return settings of a ShowConfig as nested mappings."""
    content: dict[str, Any] = {} if detector is None else {"detector": detector}
    for override in overrides:
        content = merge(content, nest(*parse_override(override)))
    return content


def _range_notes(image: Path, shot: Shot, encoding: RangeEncoding) -> list[str]:
    """Return warnings on a range image: ranges that seem to have a wrong unit, and values that seem to mean an unknown
    range."""
    panorama = replace(shot.panorama, id=image.name)
    missing = missing_note([panorama]) if shot.depth_steps is None else missing_depth_note(shot, encoding)
    return [note for note in (units_note([panorama]), missing) if note]


class _Stages:
    """The detector, and the stages that build the saliency graph of the detected objects."""

    def __init__(self, config: ShowConfig) -> None:
        self._detector: Detector = registry().build("detector", config.detector)
        self._saliency: SaliencyModel = registry().build("saliency", config.saliency)
        self._graph = config.graph
        changed = [
            f"{setting.key}={Path(str(setting.value)).name}"
            for setting in list_settings(config.detector)
            if setting.value != setting.default
        ]
        self.detector = f"{config.detector.kind} ({', '.join(changed)})" if changed else config.detector.kind

    def detect(self, panorama: Panorama) -> tuple[Detections, float]:
        """Return the objects of a panorama, and the computing time in seconds.

        Raises:
            InputMissing: The panorama lacks an input of the detector.
            InvalidAnswer: The detector did not return Detections.
        """
        missing = self._detector.needs - panorama.provides
        if missing:
            hint = " (--range FILE)" if missing == {"range"} else ""
            raise InputMissing(
                f"the detector {self._detector.name!r} needs {name_parts(missing)}{hint}, which the image "
                f"{panorama.id} does not have: choose another detector (--detector)"
            )
        start = time.perf_counter()
        detections = self._detector.detect(panorama)
        seconds = time.perf_counter() - start
        if not isinstance(detections, Detections):
            raise InvalidAnswer(
                f"the function `detect` of the detector {self._detector.name!r} returned {type(detections).__name__}, "
                "expected Detections"
            )
        return detections, seconds

    def link(self, detections: Detections) -> tuple[np.ndarray | None, SaliencyGraph | None]:
        """Return the saliency of the objects, and their saliency graph; (None, None) if no position is known."""
        if not np.isfinite(detections.centroid_m).all(1).any():
            return None, None
        saliency = self._saliency.score(detections)
        return saliency, build_graph(detections, saliency, self._graph)


def _show(image: Path, picture: Path, shot: Shot, stages: _Stages) -> ObjectView:
    detections, seconds = stages.detect(shot.panorama)
    saliency, graph = stages.link(detections)
    title = f"{image.name}    {stages.detector}: {len(detections)} objects in {seconds:.2f} s"
    rendered = draw_objects(shot.rgb, detections, saliency=saliency, graph=graph, camera=shot.camera, title=title)
    _write_picture(picture, rendered)
    return ObjectView(image, picture, stages.detector, detections, saliency, seconds)


def _check_picture(path: Path) -> None:
    """Check that a picture may be written to a path.

    Raises:
        DataError: A file exists there that `show_objects` did not write.
    """
    if path.exists() and image_notes(path).get(MARK[0]) != MARK[1]:
        raise DataError(f"{path} exists and was not written by show-objects: remove it, or choose another folder (-o)")


def _write_picture(path: Path, rendered: np.ndarray) -> None:
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    mark = PngInfo()
    mark.add_text(*MARK)
    try:
        with atomic_path(path) as temporary:
            Image.fromarray(rendered).save(temporary, "PNG", pnginfo=mark)
    except OSError as error:
        raise DataError(f"cannot write {path}: {error.strerror or error}") from None


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
