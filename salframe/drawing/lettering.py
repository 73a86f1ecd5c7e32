"""Names on a picture that keep clear of each other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from salframe.drawing.canvas import INK, PAPER, Colour, font, stroke

SPOTS = 800
"""So many places for a name are tried, the nearest first."""


@dataclass(frozen=True)
class Name:
    """Text in a box (left, top, right, bottom) of a colour, and the point that a line leads to, if any."""

    text: str
    box: np.ndarray
    colour: Colour
    leads_to: np.ndarray | None


@dataclass
class Lettering:
    """Names for a picture of width x height pixels, in letters of this size; boxes in `taken` stay free."""

    width: int
    height: int
    points: int
    taken: list[np.ndarray] = field(default_factory=list)
    names: list[Name] = field(default_factory=list)

    def put(self, text: str, colour: Colour, around: np.ndarray, at: np.ndarray) -> None:
        """Name what lies in the box `around` (left, top, right, bottom), a point of which is `at` (x, y).

        On that point if the name is the smaller one or the box is that point, else beside the box, else as near as
        there is room, with a line to the point.
        """
        size = self.measure(text)
        spots = list(self._spots(size, around, at))
        boxes = np.array([self._inside(spot, size) for spot in spots])
        covered = np.zeros(len(boxes))
        for other in self.taken:
            sides = np.minimum(boxes[:, 2:], other[2:]) - np.maximum(boxes[:, :2], other[:2])
            covered += np.maximum(sides, 0).prod(1)
        box = boxes[int(np.argmin(covered))]
        gap = np.maximum(np.maximum(box[:2] - around[2:], around[:2] - box[2:]), 0).max()
        self.names.append(Name(text, box, colour, at if gap > self.points else None))
        self.taken.append(box)

    def measure(self, text: str) -> np.ndarray:
        """Width and height of a name's box."""
        return np.array([font(self.points).getbbox(text)[2] + 0.7 * self.points, 1.45 * self.points], float)

    def draw(self, picture: np.ndarray) -> np.ndarray:
        """A picture (height, width, 3) uint8, a copy, with the names on it."""
        from PIL import Image, ImageDraw

        picture = picture.copy()
        for name in self.names:
            if name.leads_to is not None:
                line = np.stack([name.box.reshape(2, 2).mean(0), name.leads_to])
                stroke(picture, line, PAPER, 0.3 * self.points)
                stroke(picture, line, name.colour, 0.12 * self.points)
        image = Image.fromarray(picture)
        draw = ImageDraw.Draw(image)
        for name in self.names:
            draw.rounded_rectangle(name.box.round().tolist(), 0.3 * self.points, name.colour)
            text = INK if np.dot(name.colour, (0.299, 0.587, 0.114)) > 150 else PAPER
            draw.text(name.box.reshape(2, 2).mean(0).tolist(), name.text, text, font(self.points), "mm")
        return np.array(image)

    def _spots(self, size: np.ndarray, around: np.ndarray, at: np.ndarray) -> Iterable[np.ndarray]:
        """Middles of boxes of this size, the best first."""
        width, height = size / 2
        left, top, right, bottom = around
        if (around[2:] == around[:2]).all():
            yield at
        if (around[2:] - around[:2] > size * (1.1, 1.6)).all():
            yield at
            for rows, columns in product((0, -2.1, 2.1, -4.2, 4.2), (0, -1.2, 1.2)):
                spot = at + np.array([columns * width, rows * height])
                if (spot > around[:2]).all() and (spot < around[2:]).all():
                    yield spot
        gap = 0.2 * self.points
        yield np.array([at[0], top - height - gap])
        yield np.array([at[0], bottom + height + gap])
        yield np.array([right + width + gap, at[1]])
        yield np.array([left - width - gap, at[1]])
        grid = np.meshgrid(np.arange(width, self.width, width), np.arange(height, self.height, height))
        anywhere = np.stack(grid, -1).reshape(-1, 2)
        yield from anywhere[np.argsort(np.hypot(*(anywhere - at).T), kind="stable")[:SPOTS]]

    def _inside(self, middle: np.ndarray, size: np.ndarray) -> np.ndarray:
        """The box of this size about a middle, moved into the picture."""
        low = np.clip(middle - size / 2, 1, np.maximum((self.width, self.height) - size - 1, 1))
        return np.concatenate([low, low + size])
