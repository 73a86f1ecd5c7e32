"""The range model `onnx-depth`: a monocular depth network on a panorama, whole or in overlapping views."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import UserFile
from salframe.framework.errors import ConfigError, InputMissing, WeightsMissing
from salframe.panoramas.camera_height import camera_height
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_model import RangeModel, from_bright_side
from salframe_depth.alignment import align
from salframe_depth.views import MIN_FOV_DEG, MIN_VIEWS, DepthRig, ViewRays

ALIGNED_ROWS, MERGED_ROWS = 64, 512
"""Rows of the panorama on which views are compared, and the most on which they are merged: 0.35 deg a pixel, about what
views of 518 pixels show."""
FARTHEST_M = 100.0
"""What is farther is taken for unknown: no room is as large."""
UNSEEN = 128
"""Grey that stands for what a partial panorama did not see."""


class OnnxDepth(RangeModel):
    """Any monocular depth network in ONNX: on overlapping views of the panorama that are brought to agree, or on the
    whole panorama at once.

    Tested on networks that the tests make, whose answers are known in closed form; no published network was tried. Each
    view's depth gets the scale, and where the network leaves it open the shift, that make the views agree where they
    overlap; then they are merged with weights that fall to 0 at a view's border. The scale of the whole is the
    network's own where it is metric; with `camera_height_m` it is the floor's, which must then be in sight, or nothing
    is known.
    """

    name = "onnx-depth"
    version = "1"

    class Config(ComponentConfig):
        model: UserFile | None = Field(None, description="path of an ONNX file")
        gives: Literal["inverse", "z-depth", "range", "points"] = Field(
            "inverse",
            description="what the network gives: 1 / depth, depth along the view's axis, range, or points (x, y, z)",
        )
        metric: bool = Field(
            False, description="in metres; otherwise up to scale, and `inverse` and `z-depth` up to a shift too"
        )
        camera_height_m: float | None = Field(
            None, gt=0, description="height of the camera over the floor, which fixes the scale"
        )
        input: Literal["views", "equirectangular"] = Field("views", description="what the network is shown")
        size_px: tuple[int, int] | None = Field(
            None, description="width and height of the network's images; null: as the file says"
        )
        channels: Literal["bgr", "rgb"] = Field("rgb", description="order of the colours")
        scale: float = Field(1 / 255, gt=0, description="a colour from 0 to 255 becomes (colour * scale - mean) / std")
        mean: tuple[float, float, float] = Field((0.485, 0.456, 0.406), description="in the order of `channels`")
        std: tuple[float, float, float] = Field((0.229, 0.224, 0.225), description="in the order of `channels`")
        views: int = Field(MIN_VIEWS, ge=MIN_VIEWS, le=24, description="level views; eight more look down and up")
        fov_deg: float = Field(
            90.0, ge=MIN_FOV_DEG, le=120, description="field of view across the shorter side of a view"
        )

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Raises WeightsMissing where the file is no network, or takes or gives something else than the settings say;
        ConfigError where they say too little, or nothing fixes the scale."""
        from salframe.framework.onnx import open_model

        super().__init__(config)
        chosen = self.config
        if not (chosen.metric or chosen.camera_height_m):
            raise ConfigError(
                f"nothing tells {self.name} how long a metre is: expected metric: true of a network that gives metres, "
                "or camera_height_m, the height of the camera over the floor"
            )
        if chosen.input == "equirectangular" and chosen.gives == "z-depth":
            raise ConfigError(
                f"received gives: z-depth for a whole panorama, which has no axis, expected {self.name} to give "
                "range, inverse or points"
            )
        width, height = chosen.size_px or (None, None)
        self._model = open_model(chosen.model, [(None, 3, height, width)])
        height, width = (
            own or wanted for own, wanted in zip(self._model.inputs[0].shape[2:], (height, width), strict=True)
        )
        if width is None or height is None:
            raise ConfigError(f"{chosen.model} takes images of any size: say which, as size_px: [518, 518]")
        if chosen.input == "equirectangular" and width != 2 * height:
            raise ConfigError(
                f"{chosen.model} takes images of {width} x {height}, expected a width of twice the height"
            )
        self._size_px = width, height
        self._shifts = not chosen.metric and chosen.gives in ("inverse", "z-depth")
        self._look_at(np.full((1, height, width, 3), UNSEEN, np.uint8))

    @classmethod
    def check(cls, config: Any) -> None:
        super().check(config)
        if config.model is None:
            raise WeightsMissing(f"{cls.name} needs a depth network: expected the path of an ONNX file as `model`")
        if not config.model.is_file():
            raise WeightsMissing(f"no file {config.model}: expected the path of an ONNX file")

    @from_bright_side
    def estimate(self, panorama: Panorama) -> np.ndarray:
        import cv2

        if panorama.rgb is None:
            raise InputMissing(f"{panorama.id} has no colour, which the range model {self.name!r} reads")
        image, height = panorama.rgb, len(panorama.rgb)
        if panorama.valid is not None:
            image = np.where(panorama.valid[..., None], image, np.uint8(UNSEEN))
        nearness = self._whole(image) if self.config.input == "equirectangular" else self._merged(image, panorama.valid)
        with np.errstate(divide="ignore", invalid="ignore"):
            range_m = np.where(nearness > 0, 1 / nearness, np.float32(np.nan)).astype(np.float32)
        if self.config.camera_height_m is not None:
            range_m = self._to_height(range_m)
        range_m = np.where(range_m < FARTHEST_M, range_m, np.float32(np.nan))
        return cv2.resize(range_m, (2 * height, height), interpolation=cv2.INTER_NEAREST)

    def _to_height(self, range_m: np.ndarray) -> np.ndarray:
        """The range image scaled so that the floor lies camera_height_m below the camera; where no floor is seen, as
        the network gives it, or unknown where that is not metric."""
        below = camera_height(range_m)
        if below is not None:
            return range_m * np.float32(self.config.camera_height_m / below)
        return range_m if self.config.metric else np.full_like(range_m, np.nan)

    def _whole(self, image: np.ndarray) -> np.ndarray:
        """(h, 2h) float32, 1 / range in the network's scale, by the whole panorama (H, 2H, 3)."""
        import cv2

        shown = cv2.resize(image, self._size_px, interpolation=cv2.INTER_AREA)
        (depth,) = self._look_at(shown[None])
        with np.errstate(divide="ignore", invalid="ignore"):
            return depth if self.config.gives == "inverse" else 1 / depth

    def _merged(self, image: np.ndarray, valid: np.ndarray | None) -> np.ndarray:
        """(h, 2h) float32, 1 / range in the network's scale, by overlapping views of a panorama (H, 2H, 3) of which
        valid (H, 2H) was seen."""
        import cv2

        rig = DepthRig.around(self.config.views, *self._size_px, np.radians(self.config.fov_deg))
        rays = equirectangular_rays(ALIGNED_ROWS)
        looks = [rig.look(view, rays) for view in range(rig.count)]
        seen = np.ones(rays.shape[:2], bool)
        if valid is not None:
            seen = cv2.resize(valid.astype(np.uint8), seen.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        shown = [view for view, look in enumerate(looks) if (seen & (look.weight > 0)).any()]
        rays = equirectangular_rays(min(len(image), MERGED_ROWS))
        total, weights = np.zeros(rays.shape[:2], np.float32), np.zeros(rays.shape[:2], np.float32)
        if not shown:
            return total
        depths = self._look_at(rig.cut(image)[shown])
        terms = [self._terms(looks[view], one) for view, one in zip(shown, depths, strict=True)]
        coefficients = align(np.where(seen[..., None], np.stack(terms), np.nan).reshape(len(shown), seen.size, -1))
        for view, one, coefficient in zip(shown, depths, coefficients, strict=True):
            look = rig.look(view, rays)
            said = self._terms(look, one) @ coefficient.astype(np.float32)
            with np.errstate(divide="ignore", invalid="ignore"):
                nearness = said if self.config.gives == "inverse" else 1 / said
            known = (nearness > 0) & np.isfinite(nearness)
            total[known] += (look.weight * nearness)[known]
            weights[known] += look.weight[known]
        return np.divide(total, weights, where=weights > 0, out=np.zeros_like(total))

    def _terms(self, look: ViewRays, depth: np.ndarray) -> np.ndarray:
        """(h, w, K) what a view's image (any height and width) makes of the range along rays (h, w), or of 1 / range
        where the network gives `inverse`: times the view's scale, and its shift where it has one."""
        value = look.sample(depth)
        if self.config.gives in ("range", "points"):
            return value[..., None]
        along = look.cosine if self.config.gives == "inverse" else 1 / look.cosine
        return np.stack([value * along, along] if self._shifts else [value * along], -1)

    def _look_at(self, images: np.ndarray) -> np.ndarray:
        """(N, h, w) float32 that the network gives for images (N, height, width, 3) uint8 RGB, of points their
        distance."""
        ordered = images[..., ::-1] if self.config.channels == "bgr" else images
        scale, mean, std = (
            np.float32(value).reshape(-1, 1, 1) for value in (self.config.scale, self.config.mean, self.config.std)
        )
        outputs = []
        for image in ordered:  # one at a time: more take memory, and save no time on a CPU
            batch = image.transpose(2, 0, 1)[None].astype(np.float32, order="C")
            outputs.append(self._read(self._model.run((batch * scale - mean) / std)[0]))
        return np.concatenate(outputs)

    def _read(self, output: np.ndarray) -> np.ndarray:
        shape, points = output.shape, self.config.gives == "points"
        if points and len(shape) == 4 and 3 in (shape[1], shape[3]):
            return np.linalg.norm(output, axis=1 if shape[1] == 3 else 3).astype(np.float32)
        if not points and (len(shape) == 3 or (len(shape) == 4 and 1 in (shape[1], shape[3]))):
            image = output if len(shape) == 3 else output[:, 0] if shape[1] == 1 else output[..., 0]
            return image.astype(np.float32, order="C")
        expected = "(1, 3, height, width) of points" if points else "(1, height, width) or (1, 1, height, width)"
        raise WeightsMissing(f"{self.config.model} gives {shape} first, expected {expected}")
