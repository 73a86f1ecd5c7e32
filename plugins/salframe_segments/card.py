"""Model cards: what a segmentation network takes, gives and knows, in YAML."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from salframe.framework.config import read_yaml
from salframe.framework.errors import WeightsMissing
from salframe.framework.files.hashes import file_sha256
from salframe.framework.validation import Settings, validate

SHIPPED = Path(__file__).with_name("cards")

Layout = Literal["nchw", "nhwc"]
"""Order of a tensor's axes: images, channels or classes, rows, columns."""


class Input(Settings):
    """What the network takes. A colour from 0 to 255 becomes (colour * scale - mean) / std; size_px: width, height."""

    name: str | None = None
    layout: Layout
    size_px: tuple[int, int]
    dtype: Literal["float32", "uint8"] = "float32"
    channels: Literal["rgb", "bgr"] = "rgb"
    scale: float = Field(1.0, gt=0)
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @model_validator(mode="after")
    def _bytes_stay(self) -> Input:
        if self.dtype == "uint8" and (self.scale, self.mean, self.std) != (1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)):
            raise ValueError("a network that takes uint8 takes colours as they are: leave out scale, mean and std")
        return self


class Output(Settings):
    """What it gives, in any resolution: a score for each class and pixel. Integers are brought back to numbers by the
    quantization that a TensorFlow Lite file states. `name` may be any tensor of the file, an inner one too; null: the
    first that the file declares."""

    name: str | None = None
    layout: Layout
    values: Literal["probabilities", "logits"]


class Calibration(Settings):
    """An object's score as the probability that it is what it is called: the logistic function of slope * logit(p) +
    offset, where p is the mean probability of its class. As declared: p itself."""

    slope: float = Field(1.0, gt=0)
    offset: float = 0.0

    def score(self, probability: float) -> float:
        """The score of an object whose class has this mean probability, both from 0 to 1."""
        p = min(max(probability, 1e-6), 1 - 1e-6)
        return 1 / (1 + math.exp(-self.slope * math.log(p / (1 - p)) - self.offset))


class Card(Settings):
    """A network: what it is called, its licence, what it was trained on and on what terms; the sha256 of its file, by
    which a shipped card is found; what goes in and comes out; its classes.

    labels: the network's own, in its order, each one in one of: structure, no object; fixed and objects, network label
    -> name in salframe's vocabulary, of what is part of the building and what is not. These may say more than `labels`
    has, so that cards can share them.
    """

    network: str
    licence: str
    data: str
    data_terms: str
    sha256: str | None = Field(None, pattern="^[0-9a-f]{64}$")
    input: Input
    output: Output
    labels: tuple[str, ...] = Field(min_length=2)
    structure: tuple[str, ...]
    fixed: dict[str, str]
    objects: dict[str, str]
    calibration: Calibration = Calibration()

    @model_validator(mode="after")
    def _every_label_has_one_meaning(self) -> Card:
        for label in self.labels:
            kinds = [
                kind for kind in ("structure", "fixed", "objects") if label in getattr(self, kind)
            ]  # a label that stands twice in `labels` is fine: two classes of one name
            if len(kinds) != 1:
                where = " and ".join(kinds) or "none"
                raise ValueError(f"the label {label!r} is in {where} of structure, fixed and objects, expected one")
        return self

    def name_of(self, label: str) -> str | None:
        """What a class is called in the graph; None where it is structure."""
        return self.fixed.get(label) or self.objects.get(label)


def read_card(path: Path) -> Card:
    """A card. Raises ConfigError, in one line, on whatever does not fit."""
    return validate(Card, read_yaml(path), f"{path}:")


def card_beside(model: Path) -> Path | None:
    """The card that lies beside a network's file, by the same name; None where there is none."""
    path = model.with_suffix(".yaml")
    return path if path.is_file() else None


def shipped_card(model: Path) -> Card:
    """The card that comes with salframe for this very file. Raises WeightsMissing where there is none."""
    sha256 = file_sha256(model)
    for path in sorted(SHIPPED.glob("*.yaml")):
        card = read_card(path)
        if card.sha256 == sha256:
            return card
    raise WeightsMissing(
        f"no model card for {model}: salframe ships none for its sha256 {sha256[:12]}..., and there is no "
        f"{model.with_suffix('.yaml')}; write one (docs/how-to/segments.md) or name one: detector.card=PATH"
    )
