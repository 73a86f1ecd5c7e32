"""Model cards: input, output and classes of a segmentation network, in YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from salframe.framework.config import read_yaml
from salframe.framework.errors import WeightsError
from salframe.framework.files.hashes import file_sha256
from salframe.framework.validation import Settings, validate
from salframe.graphs.score_calibration import ScoreCalibration

SHIPPED = Path(__file__).with_name("cards")

Layout = Literal["nchw", "nhwc"]
"""Order of a tensor's axes. n: images, c: channels or classes, h: rows, w: columns."""


class Input(Settings):
    """Input of the network. A colour value from 0 to 255 becomes (colour * scale - mean) / std.

    `size_px` is the width and the height of the input. `name` is not needed if the file has one input.
    """

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
            raise ValueError(
                "the model card sets scale, mean or std with the input dtype uint8, expected none of them: remove them"
            )
        return self


class Output(Settings):
    """Output of the network: a score for each class and pixel, at any resolution.

    Integer outputs are converted to floats with the quantization of the TensorFlow Lite file. `name` may be any tensor
    of the file, including intermediate tensors; null: the first output of the file.
    """

    name: str | None = None
    layout: Layout
    values: Literal["probabilities", "logits"]


class Card(Settings):
    """Model card of a segmentation network: the content of a YAML file that describes its input, output and classes.

    Each label of `labels` must be in exactly one of `structure`, `fixed` and `objects`. These three may contain other
    labels too, so that several cards can use the same lists.

    Attributes:
        network: Name of the network.
        licence: Licence of the weights.
        data: Training data.
        data_terms: Terms of use of the training data.
        sha256: Hash of the network's file. salframe uses it to find the shipped card of a file.
        input: Input of the network.
        output: Output of the network.
        labels: Labels of the network's classes, in the order of its output.
        structure: Labels that are not objects, such as walls.
        fixed: Mapping from the labels of objects that are part of the building to names in salframe's vocabulary.
        objects: Mapping from the labels of all other objects to names in salframe's vocabulary.
        calibration: Conversion of probabilities to scores.
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
    calibration: ScoreCalibration = ScoreCalibration()

    @model_validator(mode="after")
    def _every_label_has_one_meaning(self) -> Card:
        for label in self.labels:
            kinds = [
                kind for kind in ("structure", "fixed", "objects") if label in getattr(self, kind)
            ]  # a label may occur twice in `labels`: two classes with the same name
            if len(kinds) != 1:
                sections = " and ".join(kinds) or "no section"
                raise ValueError(
                    f"the label {label!r} is in {sections}, expected each label in exactly one of the sections "
                    "structure, fixed and objects"
                )
        return self

    def name_of(self, label: str) -> str | None:
        """Return the name that salframe's vocabulary has for a label of the network; None if the label is structure,
        such as a wall."""
        return self.fixed.get(label) or self.objects.get(label)


def read_card(path: Path) -> Card:
    """Read a model card from a YAML file. Raises ConfigError if the content is not valid."""
    return validate(Card, read_yaml(path), f"{path}:")


def card_beside(model: Path) -> Path | None:
    """Return the path of the model card beside a network's file: the same name with .yaml; None if there is none."""
    path = model.with_suffix(".yaml")
    return path if path.is_file() else None


def shipped_card(model: Path) -> Card:
    """Return the model card that salframe ships for a network file, found by the SHA-256 of the file.

    Raises WeightsError if there is none.
    """
    sha256 = file_sha256(model)
    for path in sorted(SHIPPED.glob("*.yaml")):
        card = read_card(path)
        if card.sha256 == sha256:
            return card
    raise WeightsError(
        f"{model} (sha256 {sha256[:12]}...) has no model card (a YAML file that describes the network), expected "
        f"{model.with_suffix('.yaml')}: write this file, or set detector.card=PATH (see `salframe docs segments`)"
    )
