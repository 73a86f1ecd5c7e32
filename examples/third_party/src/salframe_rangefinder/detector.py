"""A detector without a network: objects in front of the walls, labelled by height."""

import numpy as np
from pydantic import Field
from scipy import ndimage

import salframe
from salframe.panoramas.geometry import row_elevation


class HeightBands(salframe.Detector):
    """Regions of the range image in front of floor, ceiling and walls, labelled as low, middle or tall objects."""

    name = "height-bands"
    version = "1"
    needs = frozenset({"range"})

    class Config(salframe.ComponentConfig):
        margin_m: float = Field(0.3, gt=0, description="minimum distance of an object from floor, ceiling and wall")
        min_pixels: int = Field(100, ge=1, description="minimum number of pixels of an object")
        names: salframe.UserFile | None = Field(
            None, description="text file with the labels of low, middle and tall objects, one per line"
        )

    def detect(self, panorama):
        names = ["low object", "middle object", "tall object"]
        if self.config.names is not None:
            names = self.config.names.read_text().splitlines()
        if len(names) != 3:
            raise salframe.ConfigError(f"{self.config.names}: number of lines is {len(names)}, expected 3 labels")
        range_m, margin_m = np.nan_to_num(panorama.range_m), self.config.margin_m
        elevation_rad = row_elevation(len(range_m))[:, None]
        height_m, reach_m = range_m * np.sin(elevation_rad), range_m * np.cos(elevation_rad)
        floor_m, ceiling_m = np.percentile(height_m, [1, 99])
        stands_out = (
            (height_m > floor_m + margin_m) & (height_m < ceiling_m - margin_m) & (reach_m < reach_m.max(0) - margin_m)
        )
        regions, _ = ndimage.label(stands_out & (range_m > 0))
        for left, right in zip(regions[:, 0], regions[:, -1], strict=True):
            if left and right:  # the left and right edge of a panorama are adjacent
                regions[regions == right] = left
        large = np.flatnonzero(np.bincount(regions[regions > 0]) >= self.config.min_pixels)
        masks = [regions == region for region in large]
        labels = [names[np.digitize(height_m[mask].max() - floor_m, (0.8, 1.4))] for mask in masks]
        points_m = [salframe.equirectangular_rays(len(range_m))[mask] * range_m[mask, None] for mask in masks]
        return salframe.detections_from_points(labels, np.ones(len(masks)), points_m)
