"""Range from monocular depth networks: alignment of overlapping views, and scale from the height of the camera."""

from __future__ import annotations

from abc import abstractmethod
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import ConfigError, InputMissing
from salframe.panoramas.camera_height import camera_height
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_model import RangeModel, from_bright_side
from salframe_depth.alignment import align
from salframe_depth.views import MIN_FOV_DEG, MIN_VIEWS, DepthRig, ViewRays

Quantity = Literal["inverse", "z-depth", "range", "points"]
"""Output of a depth network. inverse: 1 / depth; z-depth: depth along the view's axis; range: distance along the ray;
points: points (x, y, z)."""
ALIGNED_ROWS, MERGED_ROWS = 64, 512
"""Number of rows of the panorama on which views are aligned, and maximum number of rows of the panorama on which views
are merged. With 512 rows, a pixel has 0.35 deg, which is about the resolution of a view of 518 pixels."""
MAX_RANGE_M = 100.0
"""Maximum range in metres. Larger ranges are replaced by NaN, because no room is that large."""
UNSEEN = 128
"""Grey value of the pixels that a partial panorama does not cover."""


class DepthConfig(ComponentConfig):
    """Settings of all monocular depth networks."""

    camera_height_m: float | None = Field(
        None,
        gt=0,
        description="height (m) of the camera above the floor, which determines the scale of the ranges; null: "
        "unknown, so the output of the network must be in metres",
    )
    views: int = Field(
        MIN_VIEWS,
        ge=MIN_VIEWS,
        le=24,
        description="number of horizontal perspective views that are cut from the panorama, in addition to eight "
        "tilted views",
    )
    fov_deg: float = Field(
        90.0,
        ge=MIN_FOV_DEG,
        le=120,
        description="field of view (degrees) across the shorter side of each perspective view",
    )


class MonocularDepth(RangeModel):
    """Base class of range models that run a depth network for single images on overlapping views of a panorama.

    A subclass must set the attributes before the first estimate.

    Attributes:
        quantity: Quantity that the network outputs.
        metric: Whether the output is in metres. If not, the scale of the output is unknown. For `inverse` and
            `z-depth`, a shift is then unknown too.
        size_px: Width and height of the network's input.
    """

    quantity: Quantity
    metric: bool
    size_px: tuple[int, int]

    @abstractmethod
    def _run_network(self, images: np.ndarray) -> np.ndarray:
        """Run the network on images (N, height, width, 3) uint8 RGB, and return its output (N, h, w) float32.

        If the network returns points, the output is their distance from the camera.
        """

    def _check_scale(self, metric_network: str) -> None:
        """Raise ConfigError if neither the network nor the settings give a metric scale.

        Args:
            metric_network: What a user must do to have a metric network, an imperative for the error message.
        """
        if not (self.metric or self.config.camera_height_m):
            raise ConfigError(
                f"the scale of the range model {self.name!r} is unknown, expected ranges in metres: "
                f"{metric_network}, or set camera_height_m to the height of the camera above the floor in metres"
            )

    @from_bright_side
    def estimate(self, panorama: Panorama) -> np.ndarray:
        import cv2

        if panorama.rgb is None:
            raise InputMissing(
                f"{panorama.display_name} has no colour image, which the range model {self.name!r} needs"
            )
        image, height = panorama.rgb, len(panorama.rgb)
        if panorama.valid is not None:
            image = np.where(panorama.valid[..., None], image, np.uint8(UNSEEN))
        nearness = self._estimate_nearness(image, panorama.valid)
        with np.errstate(divide="ignore", invalid="ignore"):
            range_m = np.where(nearness > 0, 1 / nearness, np.float32(np.nan)).astype(np.float32)
        if self.config.camera_height_m is not None:
            range_m = self._scale_to_floor(range_m)
        range_m = np.where(range_m < MAX_RANGE_M, range_m, np.float32(np.nan))
        return cv2.resize(range_m, (2 * height, height), interpolation=cv2.INTER_NEAREST)

    def _scale_to_floor(self, range_m: np.ndarray) -> np.ndarray:
        """Scale a range image so that the floor is camera_height_m below the camera.

        If no floor is visible, the ranges of a metric network are not changed. All other ranges become unknown (NaN).
        """
        height_m = camera_height(range_m)
        if height_m is not None:
            return range_m * np.float32(self.config.camera_height_m / height_m)
        return range_m if self.metric else np.full_like(range_m, np.nan)

    def _estimate_nearness(self, image: np.ndarray, valid: np.ndarray | None) -> np.ndarray:
        """Estimate 1 / range (h, 2h) float32, in the network's scale, from overlapping views.

        Args:
            image: Panorama (H, 2H, 3).
            valid: Pixels (H, 2H) that the panorama covers; None: all.
        """
        import cv2

        rig = DepthRig.around(self.config.views, *self.size_px, np.radians(self.config.fov_deg))
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
                nearness = values if self.quantity == "inverse" else 1 / values
            known = (nearness > 0) & np.isfinite(nearness)
            total[known] += (rays_in_view.weight * nearness)[known]
            weights[known] += rays_in_view.weight[known]
        return np.divide(total, weights, where=weights > 0, out=np.zeros_like(total))

    def _terms(self, rays_in_view: ViewRays, depth: np.ndarray) -> np.ndarray:
        """Return the terms (h, w, K) whose weighted sum is the range along the rays, or 1 / range for `inverse`.

        The weight of the first term is the scale of the view. The weight of the second term, if any, is its shift.

        Args:
            rays_in_view: Rays (h, w) in the view.
            depth: Network output for the view, of any height and width.
        """
        value = rays_in_view.sample(depth)
        if self.quantity in ("range", "points"):
            return value[..., None]
        along = rays_in_view.cosine if self.quantity == "inverse" else 1 / rays_in_view.cosine
        return np.stack([value * along, along] if not self.metric else [value * along], -1)
