"""Segmentation networks with a common interface, which takes views and returns class probabilities."""

from __future__ import annotations

import os
import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.engines.worker import threads_allowed
from salframe.framework.errors import WeightsError
from salframe.framework.files.reading import read_network
from salframe_segments.card import Card, Layout

TFLITE = ".tflite"


class SegmentationNetwork(ABC):
    """A network and its model card, ready to run; created by `open_network`."""

    def __init__(self, path: Path, card: Card) -> None:
        self.path, self.card = path, card

    @abstractmethod
    def raw(self, image: np.ndarray) -> np.ndarray:
        """Run the network on a batch of one image, which has the layout and the dtype of the network's input.

        Returns:
            Output in the layout that the model card states, float32.
        """

    def probabilities(self, views: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the class probabilities of each view, at the network's output resolution.

        Args:
            views: Views (V, height, width, 3) uint8 RGB, of the size in the model card.

        Yields:
            Probabilities (h, w, C) float32.

        Raises:
            WeightsError: The network's output does not match its model card.
        """
        output = self.card.output
        for view in views:  # one by one, since most networks have a fixed batch size of 1
            scores = _channels_last(self.raw(self._as_input(view[None])), output.layout)
            if scores.ndim != 4 or scores.shape[-1] != len(self.card.labels):
                raise WeightsError(
                    f"{self.path} returned an output of shape {' x '.join(map(str, scores.shape))} (channels last), "
                    f"expected 4 axes and {len(self.card.labels)} channels, the number of labels in the model card"
                )
            yield _softmax(scores[0]) if output.values == "logits" else scores[0]

    def _as_input(self, views: np.ndarray) -> np.ndarray:
        expected = self.card.input
        images = views[..., ::-1] if expected.channels == "bgr" else views
        if expected.dtype == "float32":
            images = images.astype(np.float32)
            images *= np.float32(expected.scale)
            images -= np.array(expected.mean, np.float32)
            images /= np.array(expected.std, np.float32)
        return np.ascontiguousarray(images.transpose(0, 3, 1, 2) if expected.layout == "nchw" else images)


class OnnxNetwork(SegmentationNetwork):
    """A network that onnxruntime runs."""

    def __init__(self, path: Path, card: Card) -> None:
        from salframe.framework.onnx import open_model

        super().__init__(path, card)
        expected, (width, height) = card.input, card.input.size_px
        shape = (None, 3, height, width) if expected.layout == "nchw" else (None, height, width, 3)
        outputs = () if card.output.name is None else (card.output.name,)
        self._model = open_model(path, [shape], outputs, expected.dtype)

    def raw(self, image: np.ndarray) -> np.ndarray:
        scores = self._model.run(image)[0]
        if scores.dtype.kind != "f":
            raise WeightsError(
                f"the output of {self.path} has the type {scores.dtype}, expected class scores as floats: set "
                "output.name in the model card to the name of the tensor with the scores"
            )
        return np.asarray(scores, np.float32)


class TfliteNetwork(SegmentationNetwork):
    """A network that LiteRT, the runtime of TensorFlow Lite, runs."""

    def __init__(self, path: Path, card: Card) -> None:
        from ai_edge_litert.interpreter import Interpreter

        super().__init__(path, card)
        content = bytearray(read_network(path))
        try:
            if card.output.name is not None:
                _truncate_after(content, card.output.name)
            self._interpreter = Interpreter(
                model_content=bytes(content), num_threads=threads_allowed() or os.cpu_count()
            )
            self._interpreter.allocate_tensors()
        except _NoTensor:
            raise WeightsError(
                f"the network {path} has no tensor {card.output.name!r}: set output.name in the model card to the "
                "name of the tensor with the scores, or remove the key output.name"
            ) from None
        except Exception as error:  # the runtime raises ValueError, RuntimeError, and struct.error on other files
            raise WeightsError(
                f"{path} is not a valid TensorFlow Lite network: {' '.join(str(error).split())[:200]}"
            ) from None
        inputs = self._interpreter.get_input_details()
        self._output = self._interpreter.get_output_details()[0]
        width, height = card.input.size_px
        shape = (1, 3, height, width) if card.input.layout == "nchw" else (1, height, width, 3)
        received = [(_dtype(details), tuple(map(int, details["shape"]))) for details in inputs]
        if received != [(card.input.dtype, shape)]:
            raise WeightsError(
                f"the network {path} takes {_format_tensors(received)} as input, "
                f"expected {_format_tensors([(card.input.dtype, shape)])} because of the model card: correct `input` "
                "in the model card"
            )
        if self._output["dtype"] is not np.float32 and not self._output["quantization"][0]:
            raise WeightsError(
                f"the output of {path} has the type {_dtype(self._output)} without quantization parameters, so it "
                "contains no class scores: set output.name in the model card to the name of the tensor with the scores"
            )
        self._input = inputs[0]["index"]

    def raw(self, image: np.ndarray) -> np.ndarray:
        self._interpreter.set_tensor(self._input, image)
        self._interpreter.invoke()
        scores = self._interpreter.get_tensor(self._output["index"])
        if scores.dtype == np.float32:
            return scores
        scale, zero = self._output["quantization"]
        return (scores.astype(np.float32) - np.float32(zero)) * np.float32(scale)


def open_network(path: Path, card: Card) -> SegmentationNetwork:
    """Open a network with the runtime for the suffix of its file.

    Raises WeightsError if the network does not match its model card.
    """
    return (TfliteNetwork if path.suffix == TFLITE else OnnxNetwork)(path, card)


class _NoTensor(Exception):
    """A network has no tensor of the requested name."""


def _truncate_after(content: bytearray, name: str) -> None:
    """Make a tensor the only output of a TensorFlow Lite file, and remove all later operators.

    Raises:
        _NoTensor: No operator computes a tensor of this name.
    """
    from ai_edge_litert import schema_py_generated as schema

    graph = schema.Model.GetRootAs(content).Subgraphs(0)
    tensors = [i for i in range(graph.TensorsLength()) if graph.Tensors(i).Name() == name.encode()]
    operators = range(graph.OperatorsLength())
    last = [i for i in operators if tensors and tensors[0] in graph.Operators(i).OutputsAsNumpy()]
    if not last:
        raise _NoTensor
    graph.OutputsAsNumpy()[:] = tensors[0]
    # A vector is stored as its length and its elements. Operators are stored in execution order.
    length_at = graph._tab.Vector(graph._tab.Offset(OPERATORS_SLOT)) - 4
    struct.pack_into("<I", content, length_at, last[0] + 1)


OPERATORS_SLOT = 10
"""Offset of the field `operators` in the table of a subgraph; it is the fourth field in schema.fbs."""


def _channels_last(scores: np.ndarray, layout: Layout) -> np.ndarray:
    return scores.transpose(0, 2, 3, 1) if layout == "nchw" and scores.ndim == 4 else scores


def _softmax(logits: np.ndarray) -> np.ndarray:
    exponentials = np.exp(logits - logits.max(-1, keepdims=True))
    return exponentials / exponentials.sum(-1, keepdims=True)


def _dtype(details: Any) -> str:
    return np.dtype(details["dtype"]).name


def _format_tensors(tensors: list[tuple[str, tuple[int, ...]]]) -> str:
    return ", ".join(f"{dtype} ({', '.join(map(str, shape))})" for dtype, shape in tensors)
