"""A segmentation network whose answers are known in closed form: a class is a colour, and a pixel's logits fall with
the squared distance of its colour from each of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

onnx = pytest.importorskip("onnx")

COLOURS = {
    "wall": (128, 128, 128),
    "armchair": (255, 0, 0),
    "plant": (0, 255, 0),
    "tv": (0, 0, 255),
    "windowpane": (255, 255, 0),
}
SIDE_PX = 96
SHARPNESS = 1e-3
CARD = {
    "network": "colours",
    "licence": "Apache-2.0",
    "data": "none",
    "data_terms": "none",
    "input": {"layout": "nchw", "size_px": [SIDE_PX, SIDE_PX], "channels": "rgb"},
    "output": {"name": "logits", "layout": "nchw", "values": "logits"},
    "labels": list(COLOURS),
    "structure": ["wall"],
    "fixed": {"windowpane": "window"},
    "objects": {"armchair": "armchair", "plant": "plant", "tv": "television"},
}


def kernel() -> tuple[np.ndarray, np.ndarray]:
    """Weights (C, 3) and biases (C,): 2 c x - |c|^2 is |x|^2 - |x - c|^2, and |x|^2 is the same for all classes."""
    colour = np.float32(list(COLOURS.values()))
    return 2 * SHARPNESS * colour, -SHARPNESS * (colour**2).sum(1)


def write_network(path: Path, batch: int | str = 1) -> Path:
    """The network, with its card beside it."""
    from onnx import TensorProto, helper, numpy_helper

    weights, biases = kernel()
    kept = [numpy_helper.from_array(weights[:, :, None, None], "weights"), numpy_helper.from_array(biases, "biases")]
    views = helper.make_tensor_value_info("views", TensorProto.FLOAT, [batch, 3, SIDE_PX, SIDE_PX])
    given = helper.make_tensor_value_info("classes", TensorProto.INT64, None)
    nodes = [
        helper.make_node("Conv", ["views", "weights", "biases"], ["logits"]),
        helper.make_node("ArgMax", ["logits"], ["classes"], axis=1),
    ]
    graph = helper.make_graph(nodes, "colours", [views], [given], kept)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), path)
    write_card(path)
    return path


def write_card(path: Path, **changes) -> Path:
    """The card beside a network, with some of its entries changed."""
    card = path.with_suffix(".yaml")
    card.write_text(yaml.safe_dump({**CARD, **changes}, sort_keys=False))
    return card
