"""What the reports share: templates, colours, the picture of a floor."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from salframe.panoramas.floors import FloorMasks

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f", "#8c6d31")
"""Okabe and Ito's palette, told apart by colour-blind readers; the first for the first method."""


def render_page(template: str, **content: Any) -> str:
    """A template of templates/ filled in; text in it is escaped."""
    loader = FileSystemLoader(Path(__file__).with_name("templates"))
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.get_template(template).render(**content)


def floor_picture(floor: FloorMasks) -> str:
    """The floor as a data URL: floor light, obstacles grey, walls dark, outside white."""
    walked = floor.free | (floor.region > 0)
    inside = cv2.morphologyEx(walked.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    image = np.full((*floor.region.shape, 3), 255, np.uint8)
    image[cv2.dilate(inside, np.ones((5, 5), np.uint8)) > 0] = 90
    image[walked] = (238, 243, 245)
    image[floor.obstacle] = (205, 200, 196)
    return "data:image/png;base64," + base64.b64encode(cv2.imencode(".png", image)[1].tobytes()).decode()
