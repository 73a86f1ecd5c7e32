"""The detector `text`: strings on signs, read in level views of a panorama by the networks of RapidOCR."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, model_validator

from salframe.framework.component import ComponentConfig
from salframe.framework.engines.worker import threads_allowed
from salframe.framework.errors import InputMissing
from salframe.graphs.boxes import detections_where_known
from salframe.graphs.detections import MAX_TEXT, Detections, unit_vectors
from salframe.graphs.detector import Detector
from salframe.graphs.foreground import foreground
from salframe.graphs.turning import from_near_side
from salframe.panoramas.geometry import sample_nearest
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.perspective import ViewRig

TEXT = "text"
"""Label of all objects of this detector."""
ASPECT = 0.625
"""Height of a view relative to its width. With a field of view of 80 deg, a view shows elevations up to 27 deg."""
SAMPLES = 24
"""Number of points along each side of the grid of directions over the area of a string."""


class TextDetector(Detector):
    """Reads texts on signs, posters and door plates in horizontal views, by the networks of RapidOCR.

    Each text is an object with the label `text`. The attribute `text` of the object is the string. Range is optional.
    Without range, the objects have bearings, and their positions are NaN. The networks are part of the package
    `rapidocr`, so nothing is downloaded.
    """

    name = "text"
    version = "1"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb"})
    requires = ("rapidocr",)
    extra = "salframe[text]"

    class Config(ComponentConfig):
        views: int = Field(
            6, ge=3, le=16, description="number of horizontal perspective views that are cut from the panorama"
        )
        fov_deg: float = Field(
            80.0, ge=30, le=120, description="horizontal field of view (degrees) of each perspective view"
        )
        width_px: int = Field(1024, ge=256, le=4096, description="width of each perspective view in pixels")
        min_score: float = Field(0.6, ge=0, le=1, description="minimum confidence score of a string (0 to 1)")
        min_length: int = Field(
            2, ge=1, le=MAX_TEXT, description="minimum number of characters of a string. Shorter strings are left out"
        )

        @model_validator(mode="after")
        def _views_cover_the_horizon(self) -> Any:
            if self.views * self.fov_deg < 360:
                raise ValueError(
                    f"received views={self.views} and fov_deg={self.fov_deg:g}, which together cover "
                    f"{self.views * self.fov_deg:g} deg, expected at least 360 deg: increase views or fov_deg"
                )
            return self

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        width_px = self.config.width_px
        self._rig = ViewRig(
            self.config.views, width_px, round(ASPECT * width_px), float(np.radians(self.config.fov_deg))
        )

    @from_near_side
    def detect(self, panorama: Panorama) -> Detections:
        """See Detector. Raises InputMissing if the panorama has no colour."""
        if panorama.rgb is None:
            raise InputMissing(
                f"{panorama.display_name} has no colour image, which the detector {self.name!r} needs: choose another "
                "detector"
            )
        return self._objects(self._read(panorama.rgb), panorama.range_m)

    def _read(self, rgb: np.ndarray) -> list[tuple[str, float, np.ndarray]]:
        """Return the strings of a panorama (H, 2H, 3).

        Views overlap. If several views show a string, the result of the view with the nearest axis is used.

        Returns:
            For each string: its text, its score, and directions (SAMPLES^2, 3) over its area.
        """
        reader, candidates = _reader(threads_allowed() or -1), []
        for view, image in enumerate(self._rig.cut(rgb)):
            result = reader(np.ascontiguousarray(image[..., ::-1]))
            if result.boxes is None:
                continue
            for corners_px, text, score in zip(result.boxes, result.txts, result.scores, strict=True):
                text = " ".join(text.split())[:MAX_TEXT].rstrip()
                if len(text) >= self.config.min_length and score >= self.config.min_score:
                    offset_px = abs(float(np.mean(corners_px[:, 0])) - self._rig.width_px / 2)
                    rays = self._rig.bearings(view, _grid(np.asarray(corners_px, np.float64)))
                    candidates.append((offset_px, text, min(float(score), 1.0), rays))
        strings: list[tuple[str, float, np.ndarray]] = []
        for _, text, score, rays in sorted(candidates, key=lambda candidate: candidate[0]):
            if not any(_overlap(rays, other) for *_, other in strings):
                strings.append((text, score, rays))
        return strings

    def _objects(self, strings: list[tuple[str, float, np.ndarray]], range_m: np.ndarray | None) -> Detections:
        """Return strings as objects, sorted by elevation, which does not change when the panorama is rotated.

        Args:
            strings: The strings, as `_read` returns them.
            range_m: (H, 2H) range image in metres, which gives the positions; None if it is unknown.
        """
        if not strings:
            return Detections.empty()
        bearing = unit_vectors(np.array([rays.mean(0) for *_, rays in strings]))
        order = np.argsort(-bearing[:, 2], kind="stable")
        strings, bearing = [strings[i] for i in order], bearing[order]
        covered_sr = np.array([_solid_angle(rays) for *_, rays in strings])
        points = None if range_m is None else [_points(rays, range_m) for *_, rays in strings]
        detections = detections_where_known(
            [TEXT] * len(strings),
            np.array([score for _, score, _ in strings]),
            points,
            bearing,
            covered_sr,
            [rays.astype(np.float32) for *_, rays in strings],
        )
        return replace(detections, texts=tuple(text for text, *_ in strings))


@lru_cache(maxsize=1)
def _reader(threads: int) -> Any:
    """Return the networks of RapidOCR, which run in `threads` threads; -1: one thread per core."""
    from rapidocr import RapidOCR

    return RapidOCR(
        params={
            "Global.log_level": "critical",
            "Global.use_cls": False,  # text on walls is not upside down
            "EngineConfig.onnxruntime.intra_op_num_threads": threads,
        }
    )


def _grid(corners_px: np.ndarray) -> np.ndarray:
    """Return points (SAMPLES^2, 2) inside a quadrangle (4, 2), row by row."""
    share = (np.arange(SAMPLES) + 0.5) / SAMPLES
    across, down = (part.ravel()[:, None] for part in np.meshgrid(share, share))
    top = corners_px[0] + (corners_px[1] - corners_px[0]) * across
    bottom = corners_px[3] + (corners_px[2] - corners_px[3]) * across
    return np.asarray(top + (bottom - top) * down)


def _overlap(rays: np.ndarray, others: np.ndarray) -> bool:
    """Return whether the middle of one of two strings lies within the angular radius of the other string."""
    middle, other = unit_vectors(np.stack([rays.mean(0), others.mean(0)]))
    return bool(middle @ other > min((rays @ middle).min(), (others @ other).min()))


def _solid_angle(rays: np.ndarray) -> float:
    """Return the solid angle in steradians of directions (SAMPLES^2, 3) over a quadrangle."""
    grid = rays.reshape(SAMPLES, SAMPLES, 3)
    cells = np.cross(np.diff(grid, axis=1)[:-1], np.diff(grid, axis=0)[:, :-1])
    return float(np.linalg.norm(cells, axis=-1).sum() * (SAMPLES / (SAMPLES - 1)) ** 2)


def _points(rays: np.ndarray, range_m: np.ndarray) -> np.ndarray:
    """Return the points (n, 3) float32 in metres of a text's surface in the directions `rays`, without the points in
    front of and behind the surface."""
    sampled_m = sample_nearest(range_m, rays)
    rows = foreground(sampled_m, np.full(len(rays), _solid_angle(rays) / len(rays)))
    return (rays[rows] * sampled_m[rows, None]).astype(np.float32)
