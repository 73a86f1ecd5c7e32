"""The localizer `clip-rooms`: zero-shot room types by CLIP (Radford et al. 2021)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.components.identity import UserFile
from salframe.framework.errors import WeightsError
from salframe.framework.files.weights import Download, NetworkWeights, WeightsFile
from salframe.framework.onnx import open_model
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.localizer import Description, LevelledConfig, Localizer
from salframe.localization.ranking import rank_places
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.perspective import ViewRig
from salframe_image.network_input import as_batch, cut_views

CLIP_VIT_B32 = NetworkWeights(
    "clip-vit-b32",
    "MIT",
    (
        WeightsFile(
            "onnx/vision_model.onnx", "fd6e1402a588279d1723c7534d4bcba5bc0b14b47dfab0e46f8c47b8270d7d40", 351_685_709
        ),
        WeightsFile(
            "onnx/text_model.onnx", "3f6571f5bad13a97c469c1622e1cfc4d9aef78b79fdbfcff804ca357bfada8cc", 254_058_553
        ),
        WeightsFile("tokenizer.json", "f7f3b7af117d467b58374797691a6438d3e6b9e9cef800dfd5dced7f697a90cd", 2_224_119),
    ),
    Download(("https://huggingface.co/Xenova/clip-vit-base-patch32/resolve/d15189d7028b43f1d3e65039190477f6af591c2a",)),
)
SIZE_PX = 224
MEAN, STD = (122.77, 116.75, 104.09), (68.50, 66.63, 70.32)
"""Mean and standard deviation of CLIP's input (red, green, blue), in grey levels from 0 to 255."""
LOGIT_SCALE = 100.0
"""Learned scale of CLIP's cosine similarities."""


class ClipRooms(Localizer):
    """Compares the room types of query and reference frames, by CLIP. It gives a place and no pose.

    CLIP compares each perspective view with a text (`prompt`) for each room type, as in March-in-Chat (Qiao et al.
    2023). The probabilities of the room types of a view are softmax(100 c), where c contains the cosine similarities of
    the view and the texts. The score of a reference frame is the sum of sqrt(p_t q_t) over the room types t
    (Bhattacharyya coefficient):

    - p_t: mean probability of the room type t over the views of the query
    - q_t: the same mean over the views of the reference frame
    """

    name = "clip-rooms"
    version = "1"
    needs = frozenset({"rgb"})
    column_step: ClassVar[int | None] = None  # views of a rotated panorama show other parts of it
    requires = ("tokenizers",)
    extra = "salframe[clip]"
    weights = (CLIP_VIT_B32,)

    class Config(LevelledConfig):
        checkpoint: UserFile | None = Field(
            None,
            description="path of a folder with the files of CLIP, with the same names as the files that `salframe "
            "weights fetch` downloads; null: the downloaded files",
        )
        room_types: tuple[str, ...] | None = match_only(
            None,
            min_length=1,
            description="list of the room types, such as [kitchen, bedroom]; null: the room types in the place names "
            "of the map. For example, the place `kitchen-01` is a kitchen",
        )
        prompt: str = match_only(
            "a photo of a {}",
            pattern=r"\{\}",
            description="text that CLIP compares with each view; {} stands for the room type",
        )
        views: int = Field(
            12,
            ge=1,
            le=72,
            description="number of horizontal perspective views that are cut from the panorama, evenly spaced in "
            "azimuth",
        )
        hfov_deg: float = Field(
            90.0,
            gt=0,
            lt=150,
            description="horizontal and vertical field of view (degrees) of each perspective view, which is square",
        )

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._image_path, self._text_path, self._tokenizer_path = CLIP_VIT_B32.paths(self.config.checkpoint)
        self._image_model = open_model(self._image_path, [(None, 3, SIZE_PX, SIZE_PX)])
        self._text_model = open_model(self._text_path)
        self._tokenizer = _read_tokenizer(self._tokenizer_path)
        self._rig = ViewRig(self.config.views, SIZE_PX, SIZE_PX, np.deg2rad(self.config.hfov_deg))
        self._prompt_embeddings: dict[str, np.ndarray] = {}

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """Return the downloaded weights; none if the user's checkpoint replaces them."""
        return cls.weights if config.checkpoint is None else ()

    def describe(self, panorama: Panorama) -> Description:
        """Return `embeddings` (V, D) float16, CLIP's unit-length embedding of each view.

        The row of a view is zero if less than half of its pixels are valid.
        """
        views, valid = cut_views(panorama, self._rig)
        embeddings = _unit(self._image_model.run(as_batch(views, MEAN, STD))[0], self._image_path)
        return {"embeddings": (embeddings * valid[:, None]).astype(np.float16)}

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        self._frames = list(frames)
        types = self.config.room_types or sorted({room_type(frame.place) for frame in frames if frame.kind == "scene"})
        types = types or sorted({room_type(frame.place) for frame in frames})
        self._prompts = np.concatenate([self._embed_text(self.config.prompt.format(word)) for word in types])
        self._map_shares = np.stack([self._share(description) for description in descriptions])

    def match(self, description: Description) -> Localization:
        if not description["embeddings"].any():
            return Localization((), None, LocalizationStatus.NO_FEATURES)
        scores = np.sqrt(self._map_shares * self._share(description)).sum(1)
        return Localization(rank_places(self._frames, scores), None, LocalizationStatus.NO_POSE)

    def _share(self, description: Description) -> np.ndarray:
        """Return the probabilities (T,) float64 of the room types, averaged over the valid views; zeros if no view is
        valid."""
        embeddings = description["embeddings"].astype(np.float64)
        valid = embeddings[embeddings.any(1)]
        if not len(valid):
            return np.zeros(len(self._prompts))
        logits = LOGIT_SCALE * valid @ self._prompts.T
        shares = np.exp(logits - logits.max(1, keepdims=True))
        return (shares / shares.sum(1, keepdims=True)).mean(0)

    def _embed_text(self, prompt: str) -> np.ndarray:
        """Return the (1, D) unit-length embedding of a prompt.

        Raises:
            WeightsError: The text encoder has inputs other than the tokens of a prompt and their mask.
        """
        if prompt not in self._prompt_embeddings:
            ids = np.array([self._tokenizer.encode(prompt).ids], np.int64)
            inputs = {"input_ids": ids, "attention_mask": np.ones_like(ids)}
            names = [tensor.name for tensor in self._text_model.inputs]
            if not set(names) <= set(inputs):
                raise WeightsError(
                    f"the text network {self._text_path} has the input tensors {', '.join(names)}; expected input_ids, "
                    "and optionally attention_mask"
                )
            self._prompt_embeddings[prompt] = _unit(
                self._text_model.run(*(inputs[name] for name in names))[0], self._text_path
            )
        return self._prompt_embeddings[prompt]


def room_type(place: str) -> str:
    """Return the room type in a place name: "dining room" for "house/dining-room-02"."""
    name = place.rpartition("/")[2]
    return re.sub(r"[-_ ]+", " ", re.sub(r"[-_ ]*\d+$", "", name)).strip() or name


def _unit(embeddings: np.ndarray, path: Path) -> np.ndarray:
    if embeddings.ndim != 2:
        raise WeightsError(
            f"the network {path} returned an array of shape {embeddings.shape}; expected shape (N, D), one vector for "
            "each image or text"
        )
    return embeddings / np.maximum(np.linalg.norm(embeddings, axis=1, keepdims=True), 1e-9)


def _read_tokenizer(path: Path) -> Any:
    """Return the tokenizer of a file tokenizer.json. Raises WeightsError if the file is not a tokenizer."""
    from tokenizers import Tokenizer

    try:
        return Tokenizer.from_file(str(path))
    except Exception as error:  # tokenizers raises Exception itself
        raise WeightsError(
            f"{path} is not a tokenizer file (tokenizer.json of CLIP): {' '.join(str(error).split())[:200]}"
        ) from None
