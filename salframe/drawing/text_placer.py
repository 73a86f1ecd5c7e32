"""Place names on a picture without overlaps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from salframe.drawing.canvas import INK, PAPER, Colour, font, stroke

MAX_SPOTS = 800
"""Maximum number of positions in the picture that are tried for a name, nearest positions first."""


@dataclass(frozen=True)
class TextBox:
    """Text in a coloured box.

    Attributes:
        text: The text.
        box: (4,), left, top, right, bottom in pixels.
        colour: Colour of the box.
        leads_to: (2,), point (x, y) to which a line is drawn from the box; None: no line.
    """

    text: str
    box: np.ndarray
    colour: Colour
    leads_to: np.ndarray | None


@dataclass
class TextPlacer:
    """Names for a picture.

    Attributes:
        width: Width of the picture in pixels.
        height: Height of the picture in pixels.
        points: Font size.
        taken: Boxes (left, top, right, bottom) that new names should not cover.
        text_boxes: The placed names.
    """

    width: int
    height: int
    points: int
    taken: list[np.ndarray] = field(default_factory=list)
    text_boxes: list[TextBox] = field(default_factory=list)

    def put(self, text: str, colour: Colour, around: np.ndarray, at: np.ndarray) -> None:
        """Place the name of an object.

        If the name fits into the box of the object, or this box is a point, the name is centred on the point `at`.
        Otherwise the name is placed beside the box. If there is no room, it is placed as near as possible, and a line
        connects it with the object.

        Args:
            text: The name.
            colour: Colour of the box behind the name.
            around: Box of the object (left, top, right, bottom).
            at: A point (x, y) of the object.
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
        self.text_boxes.append(TextBox(text, box, colour, at if gap > self.points else None))
        self.taken.append(box)

    def measure(self, text: str) -> np.ndarray:
        """Return the width and height (2,) of the box behind a name, in pixels."""
        return np.array([font(self.points).getbbox(text)[2] + 0.7 * self.points, 1.45 * self.points], float)

    def draw(self, picture: np.ndarray) -> np.ndarray:
        """Return a copy of a picture (height, width, 3) uint8 with the names on it."""
        from PIL import Image, ImageDraw

        picture = picture.copy()
        for text_box in self.text_boxes:
            if text_box.leads_to is not None:
                line = np.stack([text_box.box.reshape(2, 2).mean(0), text_box.leads_to])
                stroke(picture, line, PAPER, 0.3 * self.points)
                stroke(picture, line, text_box.colour, 0.12 * self.points)
        image = Image.fromarray(picture)
        draw = ImageDraw.Draw(image)
        for text_box in self.text_boxes:
            draw.rounded_rectangle(text_box.box.round().tolist(), 0.3 * self.points, text_box.colour)
            text = INK if np.dot(text_box.colour, (0.299, 0.587, 0.114)) > 150 else PAPER
            draw.text(text_box.box.reshape(2, 2).mean(0).tolist(), text_box.text, text, font(self.points), "mm")
        return np.array(image)

    def _spots(self, size: np.ndarray, around: np.ndarray, at: np.ndarray) -> Iterable[np.ndarray]:
        """Yield possible centres (x, y) for the box behind a name, best first. Arguments are those of `put`, and the
        size (2,) of the box."""
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
        yield from anywhere[np.argsort(np.hypot(*(anywhere - at).T), kind="stable")[:MAX_SPOTS]]

    def _inside(self, middle: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Return the box (left, top, right, bottom) with this centre and size. If necessary, it is moved into the
        picture."""
        low = np.clip(middle - size / 2, 1, np.maximum((self.width, self.height) - size - 1, 1))
        return np.concatenate([low, low + size])
