"""The localizer `clip-rooms`: what kind of room it is, told by CLIP (Radford et al. 2021) from prompts alone."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.components.identity import UserFile
from salframe.framework.errors import WeightsMissing
from salframe.framework.files.weights import Download, NetworkWeights, WeightsFile
from salframe.framework.onnx import open_model
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.localizer import Description, Localizer
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
"""Of CLIP's input, in grey levels."""
LOGIT_SCALE = 100.0
"""What CLIP learned to multiply cosines by."""


class ClipRooms(Localizer):
    """Room types told by CLIP from views, places ranked by how alike their room types are; gives a place and no pose.

    After the scene perceiver of March-in-Chat (Qiao et al. 2023), which asks CLIP for the type of a room and the
    objects in it and has no map; making a localizer of its room types is our reading. Each view's probabilities of the
    room types, softmax(100 cos(view, prompt)), are averaged over the views, p; a reference frame with q scores the
    Bhattacharyya coefficient sum_t sqrt(p_t q_t). Equal scores keep the order of the map. The types are those in the
    names of the map's scenes, "kitchen-01" is a kitchen, unless `room_types` names others.
    """

    name = "clip-rooms"
    version = "1"
    needs = frozenset({"rgb"})
    requires = ("tokenizers",)
    extra = "salframe[clip]"
    weights = (CLIP_VIT_B32,)

    class Config(ComponentConfig):
        checkpoint: UserFile | None = Field(
            None, description="local folder with a CLIP's files, named as the fetched ones, instead of those"
        )
        room_types: tuple[str, ...] | None = match_only(
            None, min_length=1, description="words for the rooms; null: those in the map's place names"
        )
        prompt: str = match_only(
            "a photo of a {}", pattern=r"\{\}", description="what CLIP compares a view with; {} is the room type"
        )
        views: int = Field(12, ge=1, le=72, description="perspective views around the panorama")
        hfov_deg: float = Field(90.0, gt=0, lt=150, description="field of view of each view")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._image_path, self._text_path, self._tokenizer_path = CLIP_VIT_B32.paths(self.config.checkpoint)
        self._image_model = open_model(self._image_path, [(None, 3, SIZE_PX, SIZE_PX)])
        self._text_model = open_model(self._text_path)
        self._tokenizer = _read_tokenizer(self._tokenizer_path)
        self._rig = ViewRig(self.config.views, SIZE_PX, SIZE_PX, np.deg2rad(self.config.hfov_deg))
        self._known: dict[str, np.ndarray] = {}

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """None where the user's checkpoint takes their place."""
        return cls.weights if config.checkpoint is None else ()

    def describe(self, panorama: Panorama) -> Description:
        """embeddings (V, D) float16: CLIP's of each view, of unit length; zeros for a view that lies for the greater
        part in what was not seen."""
        views, seen = cut_views(panorama, self._rig)
        embeddings = _unit(self._image_model.run(as_batch(views, MEAN, STD))[0], self._image_path)
        return {"embeddings": (embeddings * seen[:, None]).astype(np.float16)}

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        self._map_frames = list(frames)
        types = self.config.room_types or sorted({room_type(frame.place) for frame in frames if frame.kind == "scene"})
        types = types or sorted({room_type(frame.place) for frame in frames})
        self._prompts = np.concatenate([self._embed_text(self.config.prompt.format(word)) for word in types])
        self._map_shares = np.stack([self._share(description) for description in descriptions])

    def match(self, description: Description) -> Localization:
        if not description["embeddings"].any():
            return Localization((), None, LocalizationStatus.NO_FEATURES)
        scores = np.sqrt(self._map_shares * self._share(description)).sum(1)
        return Localization(rank_places(self._map_frames, scores), None, LocalizationStatus.NO_POSE)

    def _share(self, description: Description) -> np.ndarray:
        """(T,) float64 probabilities of the room types; zeros where no view was seen."""
        embeddings = description["embeddings"].astype(np.float64)
        seen = embeddings[embeddings.any(1)]
        if not len(seen):
            return np.zeros(len(self._prompts))
        logits = LOGIT_SCALE * seen @ self._prompts.T
        shares = np.exp(logits - logits.max(1, keepdims=True))
        return (shares / shares.sum(1, keepdims=True)).mean(0)

    def _embed_text(self, prompt: str) -> np.ndarray:
        """(1, D) of unit length. Raises WeightsMissing where the text encoder takes something else than a prompt's
        tokens."""
        if prompt not in self._known:
            ids = np.array([self._tokenizer.encode(prompt).ids], np.int64)
            given = {"input_ids": ids, "attention_mask": np.ones_like(ids)}
            names = [tensor.name for tensor in self._text_model.inputs]
            if not set(names) <= set(given):
                raise WeightsMissing(
                    f"{self._text_path} takes {', '.join(names)}, expected input_ids and perhaps attention_mask"
                )
            self._known[prompt] = _unit(self._text_model.run(*(given[name] for name in names))[0], self._text_path)
        return self._known[prompt]


def room_type(place: str) -> str:
    """The words of a place's name, after the last slash and without its number: "dining-room-02" is a "dining room"."""
    name = place.rpartition("/")[2]
    return re.sub(r"[-_ ]+", " ", re.sub(r"[-_ ]*\d+$", "", name)).strip() or name


def _unit(embeddings: np.ndarray, path: Path) -> np.ndarray:
    if embeddings.ndim != 2:
        raise WeightsMissing(f"{path} gives {embeddings.shape}, expected one embedding (N, D) an image or prompt")
    return embeddings / np.maximum(np.linalg.norm(embeddings, axis=1, keepdims=True), 1e-9)


def _read_tokenizer(path: Path) -> Any:
    """The tokenizer of a tokenizer.json. Raises WeightsMissing."""
    from tokenizers import Tokenizer

    try:
        return Tokenizer.from_file(str(path))
    except Exception as error:  # tokenizers raises Exception itself
        raise WeightsMissing(f"{path} is no tokenizer: {' '.join(str(error).split())[:200]}") from None
