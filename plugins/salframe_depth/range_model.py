"""The range model `onnx-depth`: a monocular depth network on a panorama, whole or in overlapping views."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import SingleFile
from salframe.framework.errors import ConfigError, InputMissing, WeightsError
from salframe.panoramas.camera_height import camera_height
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_model import RangeModel, from_bright_side
from salframe_depth.alignment import align
from salframe_depth.views import MIN_FOV_DEG, MIN_VIEWS, DepthRig, ViewRays

ALIGNED_ROWS, MERGED_ROWS = 64, 512
"""Rows of the panorama on which views are aligned, and maximum number of rows on which they are merged: 0.35 deg per
pixel, about the resolution of views of 518 pixels."""
MAX_RANGE_M = 100.0
"""Maximum range in metres. Larger ranges are set to unknown, since no room is that large."""
UNSEEN = 128
"""Grey value of the pixels that a partial panorama does not cover."""


class OnnxDepth(RangeModel):
    """Any monocular depth network in ONNX, on overlapping views that are aligned, or on the whole panorama.

    No published network was tested. The depth of each view is scaled, and shifted if the shift of the network is
    unknown, so that views agree where they overlap. The views are then merged with weights that fall to 0 at a view's
    border. With `camera_height_m`, the ranges are scaled so that the floor has this distance from the camera. If no
    floor is visible, a metric network keeps its scale, and otherwise no range is known.
    """

    name = "onnx-depth"
    version = "1"

    class Config(ComponentConfig):
        model: SingleFile | None = Field(None, description="path of the network, an ONNX file (required)")
        gives: Literal["inverse", "z-depth", "range", "points"] = Field(
            "inverse",
            description="quantity that the network outputs. inverse: 1 / depth; z-depth: depth along the view's axis; "
            "range: distance along the ray; points: points (x, y, z)",
        )
        metric: bool = Field(
            False,
            description="true: the output of the network is in metres; false: the output has an unknown scale and, if "
            "it is 1 / depth or z-depth, also an unknown shift",
        )
        camera_height_m: float | None = Field(
            None,
            gt=0,
            description="height of the camera above the floor (m), from which the scale of the ranges is computed; "
            "null: the network gives metres",
        )
        input: Literal["views", "equirectangular"] = Field(
            "views", description="input of the network. views: perspective views; equirectangular: the whole panorama"
        )
        size_px: tuple[int, int] | None = Field(
            None, description="width and height of the network's input (pixels); null: read from the file"
        )
        channels: Literal["bgr", "rgb"] = Field(
            "rgb", description="order of the colour channels of the network's input"
        )
        scale: float = Field(
            1 / 255,
            gt=0,
            description="factor that multiplies colours (0 to 255) before normalisation: (colour * scale - mean) / std",
        )
        mean: tuple[float, float, float] = Field(
            (0.485, 0.456, 0.406),
            description="mean of each colour channel, subtracted from the scaled colours, in the order of `channels`",
        )
        std: tuple[float, float, float] = Field(
            (0.229, 0.224, 0.225),
            description="standard deviation of each colour channel, by which the colours are divided, in the order of "
            "`channels`",
        )
        views: int = Field(
            MIN_VIEWS,
            ge=MIN_VIEWS,
            le=24,
            description="number of horizontal perspective views cut from the panorama, in addition to eight tilted "
            "ones",
        )
        fov_deg: float = Field(
            90.0,
            ge=MIN_FOV_DEG,
            le=120,
            description="field of view across the shorter side of each perspective view (degrees)",
        )

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Open the network and run it once.

        Raises:
            WeightsError: The file is not a network, or its input or output does not match the settings.
            ConfigError: The settings are incomplete, or do not determine the scale.
        """
        from salframe.framework.onnx import open_model

        super().__init__(config)
        settings = self.config
        if not (settings.metric or settings.camera_height_m):
            raise ConfigError(
                f"the range model {self.name!r} has no metric scale, expected metric: true for a network that gives "
                "metres, or camera_height_m, the height of the camera above the floor"
            )
        if settings.input == "equirectangular" and settings.gives == "z-depth":
            raise ConfigError(
                f"the range model {self.name!r} has gives: z-depth with input: equirectangular, expected gives: "
                "range, inverse or points, because a panorama has no optical axis"
            )
        width, height = settings.size_px or (None, None)
        self._model = open_model(settings.model, [(None, 3, height, width)])
        height, width = (
            file_size or setting
            for file_size, setting in zip(self._model.inputs[0].shape[2:], (height, width), strict=True)
        )
        if width is None or height is None:
            raise ConfigError(
                f"{settings.model} accepts images of any size, expected the size as a setting, such as "
                "size_px: [518, 518]"
            )
        if settings.input == "equirectangular" and width != 2 * height:
            raise ConfigError(
                f"{settings.model} takes images of {width} x {height}, expected width = 2 x height (equirectangular)"
            )
        self._size_px = width, height
        self._shifts = not settings.metric and settings.gives in ("inverse", "z-depth")
        self._run_network(np.full((1, height, width, 3), UNSEEN, np.uint8))

    @classmethod
    def check(cls, config: Any) -> None:
        super().check(config)
        if config.model is None:
            raise WeightsError(
                f"the range model {cls.name!r} has no network, expected the path of an ONNX file as `model`",
                "model=PATH",
            )
        if not config.model.is_file():
            raise WeightsError(f"no file {config.model}, expected the path of an ONNX file")

    @from_bright_side
    def estimate(self, panorama: Panorama) -> np.ndarray:
        import cv2

        if panorama.rgb is None:
            raise InputMissing(f"{panorama.id} has no colour, which the range model {self.name!r} needs")
        image, height = panorama.rgb, len(panorama.rgb)
        if panorama.valid is not None:
            image = np.where(panorama.valid[..., None], image, np.uint8(UNSEEN))
        nearness = (
            self._estimate_from_panorama(image)
            if self.config.input == "equirectangular"
            else self._estimate_from_views(image, panorama.valid)
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            range_m = np.where(nearness > 0, 1 / nearness, np.float32(np.nan)).astype(np.float32)
        if self.config.camera_height_m is not None:
            range_m = self._scale_to_floor(range_m)
        range_m = np.where(range_m < MAX_RANGE_M, range_m, np.float32(np.nan))
        return cv2.resize(range_m, (2 * height, height), interpolation=cv2.INTER_NEAREST)

    def _scale_to_floor(self, range_m: np.ndarray) -> np.ndarray:
        """Scale a range image so that the floor is camera_height_m below the camera.

        If no floor is visible, a metric range image is returned unchanged, and any other with all ranges unknown.
        """
        height_m = camera_height(range_m)
        if height_m is not None:
            return range_m * np.float32(self.config.camera_height_m / height_m)
        return range_m if self.config.metric else np.full_like(range_m, np.nan)

    def _estimate_from_panorama(self, image: np.ndarray) -> np.ndarray:
        """Estimate 1 / range (h, 2h) float32, in the network's scale, from the whole panorama (H, 2H, 3)."""
        import cv2

        shown = cv2.resize(image, self._size_px, interpolation=cv2.INTER_AREA)
        (depth,) = self._run_network(shown[None])
        with np.errstate(divide="ignore", invalid="ignore"):
            return depth if self.config.gives == "inverse" else 1 / depth

    def _estimate_from_views(self, image: np.ndarray, valid: np.ndarray | None) -> np.ndarray:
        """Estimate 1 / range (h, 2h) float32, in the network's scale, from overlapping views.

        Args:
            image: Panorama (H, 2H, 3).
            valid: Pixels (H, 2H) that the panorama covers; None: all.
        """
        import cv2

        rig = DepthRig.around(self.config.views, *self._size_px, np.radians(self.config.fov_deg))
        rays = equirectangular_rays(ALIGNED_ROWS)
        view_rays = [rig.project_rays(view, rays) for view in range(rig.count)]
        valid_rays = np.ones(rays.shape[:2], bool)
        if valid is not None:
            valid_rays = cv2.resize(valid.astype(np.uint8), valid_rays.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        visible_views = [
            view for view, rays_in_view in enumerate(view_rays) if (valid_rays & (rays_in_view.weight > 0)).any()
        ]
        rays = equirectangular_rays(min(len(image), MERGED_ROWS))
        total, weights = np.zeros(rays.shape[:2], np.float32), np.zeros(rays.shape[:2], np.float32)
        if not visible_views:
            return total
        depths = self._run_network(rig.cut(image)[visible_views])
        terms = [self._terms(view_rays[view], depth) for view, depth in zip(visible_views, depths, strict=True)]
        coefficients = align(
            np.where(valid_rays[..., None], np.stack(terms), np.nan).reshape(len(visible_views), valid_rays.size, -1)
        )
        for view, depth, coefficient in zip(visible_views, depths, coefficients, strict=True):
            rays_in_view = rig.project_rays(view, rays)
            values = self._terms(rays_in_view, depth) @ coefficient.astype(np.float32)
            with np.errstate(divide="ignore", invalid="ignore"):
                nearness = values if self.config.gives == "inverse" else 1 / values
            known = (nearness > 0) & np.isfinite(nearness)
            total[known] += (rays_in_view.weight * nearness)[known]
            weights[known] += rays_in_view.weight[known]
        return np.divide(total, weights, where=weights > 0, out=np.zeros_like(total))

    def _terms(self, rays_in_view: ViewRays, depth: np.ndarray) -> np.ndarray:
        """Return the terms (h, w, K) whose weighted sum is the range along the rays, or 1 / range for `inverse`.

        The first coefficient is the view's scale, the second its shift if it has one.

        Args:
            rays_in_view: Rays (h, w) in the view.
            depth: Network output for the view, of any height and width.
        """
        value = rays_in_view.sample(depth)
        if self.config.gives in ("range", "points"):
            return value[..., None]
        along = rays_in_view.cosine if self.config.gives == "inverse" else 1 / rays_in_view.cosine
        return np.stack([value * along, along] if self._shifts else [value * along], -1)

    def _run_network(self, images: np.ndarray) -> np.ndarray:
        """Run the network on images (N, height, width, 3) uint8 RGB: (N, h, w) float32; for points, their distance."""
        ordered = images[..., ::-1] if self.config.channels == "bgr" else images
        scale, mean, std = (
            np.float32(value).reshape(-1, 1, 1) for value in (self.config.scale, self.config.mean, self.config.std)
        )
        outputs = []
        for image in ordered:  # one by one: larger batches take more memory and save no time on a CPU
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
        raise WeightsError(f"{self.config.model} gives {shape} as first output, expected {expected}")
