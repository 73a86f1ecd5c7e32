"""Published networks on perspective views: the tasks of the networks, and the conversion of their outputs to
detections."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from enum import Enum
from functools import cache
from typing import Any

import numpy as np

from salframe.framework.errors import ConfigError
from salframe.framework.pretrained import PretrainedModel
from salframe.graphs.image_detections import ImageDetections
from salframe_segments.network_labels import graph_name

PROMPT = "a photo of a {}"
"""Text that OWL-ViT and OWLv2 were trained with (Minderer et al., arXiv 2205.06230)."""


MASK_PROBABILITY, MIN_VISIBLE = 0.5, 0.8
"""Minimum probability of a mask at its pixels, and minimum share of the pixels of a mask that no other mask covers."""


class NetworkTask(Enum):
    """Task that a network solves, which determines the format of its output."""

    SEMANTIC = "semantic segmentation"
    PANOPTIC = "panoptic segmentation"
    DETECTION = "object detection"
    ZERO_SHOT = "zero-shot object detection"


ZERO_SHOT_ARCHITECTURES = (
    "OwlViTForObjectDetection",
    "Owlv2ForObjectDetection",
    "GroundingDinoForObjectDetection",
    "MMGroundingDinoForObjectDetection",
)


@cache
def tasks() -> dict[str, NetworkTask]:
    """Return the task of each network that a detector can use. The keys are class names in `transformers`."""
    from transformers.models.auto import modeling_auto as auto

    mappings = (
        (NetworkTask.DETECTION, auto.MODEL_FOR_OBJECT_DETECTION_MAPPING_NAMES),
        (NetworkTask.PANOPTIC, auto.MODEL_FOR_UNIVERSAL_SEGMENTATION_MAPPING_NAMES),
        (NetworkTask.SEMANTIC, auto.MODEL_FOR_SEMANTIC_SEGMENTATION_MAPPING_NAMES),
    )
    return {
        **{architecture: task for task, mapping in mappings for architecture in mapping.values()},
        **dict.fromkeys(ZERO_SHOT_ARCHITECTURES, NetworkTask.ZERO_SHOT),
    }


def class_probabilities(model: PretrainedModel, views: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the class probabilities (h, w, C) float32 of each view (V, height, width, 3) by a semantic network."""
    for batch in model.batches(views):
        logits = model.run(model.prepare(batch)).logits
        yield from logits.softmax(1).permute(0, 2, 3, 1).numpy()


class ViewModel(ABC):
    """A network that detects objects in perspective views.

    Attributes:
        names: Names of the objects in the graph.
    """

    names: tuple[str, ...]

    def __init__(self, model: PretrainedModel, min_score: float) -> None:
        self._model, self._min_score = model, min_score

    def detect(self, views: np.ndarray) -> list[ImageDetections]:
        """Return the detections in each view (V, height, width, 3) uint8 RGB. Labels are indices into `names`."""
        return [detections for batch in self._model.batches(views) for detections in self._detect_batch(batch)]

    @abstractmethod
    def _detect_batch(self, views: np.ndarray) -> list[ImageDetections]:
        """Return the detections in each view of a batch, in one run of the network."""


class _ClosedSetModel(ViewModel):
    """A network with a fixed list of classes. Detections of structure (such as walls) are left out."""

    def __init__(self, model: PretrainedModel, min_score: float) -> None:
        super().__init__(model, min_score)
        name_by_class = [graph_name(label) for label in model.labels()]
        self.names = tuple(dict.fromkeys(name for name in name_by_class if name))
        index = {name: number for number, name in enumerate(self.names)}
        self._name_index = np.array([-1 if name is None else index[name] for name in name_by_class])

    def _objects(
        self, boxes: np.ndarray, scores: np.ndarray, classes: np.ndarray, masks: np.ndarray | None = None
    ) -> ImageDetections:
        """Return the detections that are objects.

        Args:
            boxes: Boxes (n, 4) within the view.
            scores: Scores (n,).
            classes: The network's classes (n,) int.
            masks: Masks (n, height, width) bool; None if only boxes are known.
        """
        known = (classes >= 0) & (classes < len(self._name_index))  # some networks have outputs without a label
        label = np.where(known, self._name_index[np.where(known, classes, 0)], -1)
        return ImageDetections(boxes, scores, label, masks).take(np.flatnonzero(label >= 0))


class BoxModel(_ClosedSetModel):
    """An object detection network with a fixed list of classes. Examples are DETR and RT-DETR."""

    def _detect_batch(self, views: np.ndarray) -> list[ImageDetections]:
        output = self._model.run(self._model.prepare(views))
        results = self._model.image_processor.post_process_object_detection(
            output, threshold=self._min_score, target_sizes=_sizes(views)
        )
        return [self._objects(*_boxes(result, views), result["labels"].numpy()) for result in results]


class SegmentModel(_ClosedSetModel):
    """Panoptic, instance and universal segmentation: objects with masks, such as from Mask2Former and OneFormer."""

    def _detect_batch(self, views: np.ndarray) -> list[ImageDetections]:
        inputs = self._model.prepare(views)
        if self._model.config.model_type == "oneformer":
            inputs["task_inputs"] = self._task_tokens(len(views))
        output = self._model.run(inputs)
        has_queries = "class_queries_logits" in output
        logits = output["class_queries_logits" if has_queries else "logits"]
        masks = output["masks_queries_logits" if has_queries else "pred_masks"]
        return [self._segments(*pair, views.shape[1:3]) for pair in zip(logits, masks, strict=True)]

    def _task_tokens(self, count: int) -> Any:
        """Return OneFormer's task text as tokens (count, tokens), padded with zeros as in OneFormer's own processor."""
        tokens = self._model.tokenizer(
            ["the task is panoptic"] * count,
            padding="max_length",
            max_length=self._model.config.task_seq_len,
            truncation=True,
            return_tensors="pt",
        )
        return tokens["input_ids"] * tokens["attention_mask"]

    def _segments(self, logits: Any, mask_logits: Any, size: tuple[int, int]) -> ImageDetections:
        """Return the segments of a view by the panoptic inference of MaskFormer (Cheng et al., NeurIPS 2021, 3.4).

        A pixel belongs to the query of the network with the largest product of score and mask probability, if this mask
        probability is at least 0.5. A query is left out if other masks cover most of its mask. The function of
        `transformers` differs: it also assigns pixels that are in no mask, and leaves out all scores below 0.5.

        Args:
            logits: Class logits (queries, C + 1). The last class stands for no object.
            mask_logits: Mask logits (queries, h, w).
            size: Height and width of the view.
        """
        from torch.nn.functional import interpolate

        scores, classes = logits.softmax(-1).max(-1)
        is_valid = (classes < logits.shape[-1] - 1) & (scores >= self._min_score)
        scores, classes = scores[is_valid].numpy().astype(float), classes[is_valid].numpy()
        if not len(scores):
            return self._objects(np.zeros((0, 4)), scores, classes, np.zeros((0, *size), bool))
        probability = interpolate(mask_logits[is_valid][None], size, mode="bilinear")[0].sigmoid().numpy()
        owner = (scores[:, None, None] * probability).argmax(0)
        is_inside = probability >= MASK_PROBABILITY
        masks = is_inside & (owner == np.arange(len(scores))[:, None, None])
        visible, area = masks.sum((1, 2)), is_inside.sum((1, 2))
        shown = np.flatnonzero((visible > 0) & (visible > MIN_VISIBLE * area))
        masks = masks[shown]
        rows, columns = masks.any(axis=2), masks.any(axis=1)
        height, width = size
        boxes = np.stack(
            [columns.argmax(1), rows.argmax(1), width - columns[:, ::-1].argmax(1), height - rows[:, ::-1].argmax(1)],
            -1,
        )
        return self._objects(boxes.astype(float), scores[shown], classes[shown], masks)


class PromptedModel(ViewModel):
    """Zero-shot detection with one text for each label: OWL-ViT and OWLv2."""

    def __init__(self, model: PretrainedModel, min_score: float, labels: Sequence[str]) -> None:
        super().__init__(model, min_score)
        self.names = tuple(labels)
        self._tokens = dict(
            model.tokenizer(
                [PROMPT.format(label) for label in labels],
                padding="max_length",
                max_length=model.config.text_config.max_position_embeddings,
                truncation=True,
                return_tensors="pt",
            )
        )

    def _detect_batch(self, views: np.ndarray) -> list[ImageDetections]:
        tokens = {name: self._tokens[name].repeat(len(views), 1) for name in ("input_ids", "attention_mask")}
        output = self._model.run({**self._model.prepare(views), **tokens})
        results = self._model.image_processor.post_process_object_detection(
            output, threshold=self._min_score, target_sizes=_sizes(views)
        )
        return [ImageDetections(*_boxes(result, views), result["labels"].numpy()) for result in results]


class GroundedModel(ViewModel):
    """Zero-shot detection with all labels in one text: Grounding DINO. A long list of labels needs several runs."""

    def __init__(self, model: PretrainedModel, min_score: float, labels: Sequence[str]) -> None:
        """Split the labels into texts that the network can take. Raises ConfigError if one label is too long."""
        super().__init__(model, min_score)
        self.names = tuple(labels)
        self._texts: list[tuple[dict[str, Any], np.ndarray]] = []
        first = 0
        while first < len(labels):
            last = len(labels)
            while (text := self._tokenize(first, last)) is None:
                last -= 1
                if last == first:
                    raise ConfigError(
                        f"the setting labels has the label {labels[first]!r}, which is too long for the network in "
                        f"{model.folder}: shorten the label"
                    )
            self._texts.append(text)
            first = last

    def _tokenize(self, first: int, last: int) -> tuple[dict[str, Any], np.ndarray] | None:
        """Return the tokens of the text with the labels first to last - 1, and the label index of each token.

        The label index of a token between labels is -1. Return None if the text has too many tokens for the network.
        """
        texts = [f"{name.lower()}. " for name in self.names[first:last]]
        tokens = self._model.tokenizer(
            "".join(texts).strip(), return_tensors="pt", return_token_type_ids=True, return_offsets_mapping=True
        )
        spans = tokens.pop("offset_mapping")[0].numpy()
        if len(spans) > self._model.config.max_text_len:
            return None
        ends = np.cumsum([len(text) for text in texts])
        number = np.searchsorted(ends, spans[:, 0], side="right")
        return dict(tokens), np.where(spans[:, 1] > spans[:, 0], first + number, -1)

    def _detect_batch(self, views: np.ndarray) -> list[ImageDetections]:
        pixels, parts = self._model.prepare(views), []
        for tokens, label_of_token in self._texts:
            text = {name: value.repeat(len(views), 1) for name, value in tokens.items()}
            output = self._model.run({**pixels, **text})
            parts.append(self._read(output, views, label_of_token))
        return [_concatenate([part[view] for part in parts]) for view in range(len(views))]

    def _read(self, output: Any, views: np.ndarray, label_of_token: np.ndarray) -> list[ImageDetections]:
        """Return the detections of one text. A box gets the label of its best token."""
        results = self._model.image_processor.post_process_object_detection(
            output, threshold=self._min_score, target_sizes=_sizes(views)
        )
        detections = []
        for result in results:
            label = label_of_token[result["labels"].numpy()]
            boxes = ImageDetections(*_boxes(result, views), label)
            detections.append(boxes.take(np.flatnonzero(label >= 0)))
        return detections


def open_view_model(model: PretrainedModel, min_score: float, labels: Sequence[str]) -> ViewModel:
    """Return the ViewModel for the architecture of a network. Zero-shot networks search for `labels`."""
    task = tasks()[model.architecture]
    if task is NetworkTask.ZERO_SHOT:
        zero_shot = PromptedModel if model.architecture.startswith("Owl") else GroundedModel
        return zero_shot(model, min_score, labels)
    return (SegmentModel if task is NetworkTask.PANOPTIC else BoxModel)(model, min_score)


def _sizes(views: np.ndarray) -> list[tuple[int, int]]:
    """Return the height and width of each view, as the library expects them."""
    return [(view.shape[0], view.shape[1]) for view in views]


def _boxes(result: dict[str, Any], views: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the boxes (n, 4), clipped to the view, and their scores (n,)."""
    height, width = views.shape[1:3]
    boxes = np.clip(result["boxes"].numpy().astype(float), 0, [width, height] * 2)
    return boxes, result["scores"].numpy().astype(float)


def _concatenate(parts: Sequence[ImageDetections]) -> ImageDetections:
    """Concatenate the detections of several runs on one view. Masks are left out."""
    return ImageDetections(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("box_px", "score", "label"))
    )
