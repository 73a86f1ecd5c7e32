"""Panoramas with signs at known directions: text drawn on the view of a pinhole camera, mapped to the sphere."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import Panorama

WALL_M = 2.5


def with_signs(signs: dict[float, str], height: int = 768, range_m: bool = True) -> Panorama:
    """A gray cylinder of radius WALL_M with a plate with a string at each azimuth (degrees) on the horizon."""
    rays = equirectangular_rays(height).astype(np.float64)
    rgb = np.full((height, 2 * height, 3), 190, np.uint8)
    azimuth = np.degrees(np.arctan2(rays[..., 1], rays[..., 0]))
    rise_m = WALL_M * rays[..., 2] / np.hypot(rays[..., 0], rays[..., 1])
    for at, text in signs.items():
        plate = Image.new("RGB", (800, 240), (250, 250, 250))
        ImageDraw.Draw(plate).text((400, 120), text, (10, 10, 10), ImageFont.load_default(150), anchor="mm")
        along_m = -np.radians((azimuth - at + 180) % 360 - 180) * WALL_M
        inside = (np.abs(along_m) < 0.66) & (np.abs(rise_m) < 0.2)
        column = ((along_m[inside] + 0.66) / 1.32 * 799).astype(int)
        row = ((0.2 - rise_m[inside]) / 0.4 * 239).astype(int)
        rgb[inside] = np.asarray(plate)[row, column]
    ranges = (WALL_M / np.hypot(rays[..., 0], rays[..., 1])).astype(np.float32)
    return Panorama("signs", rgb=rgb, range_m=ranges if range_m else None)
