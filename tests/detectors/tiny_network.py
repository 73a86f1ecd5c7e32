"""A detection network whose answers are known in closed form: a class is a colour, its box the extent of that colour in
the image."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")

COLOURS = {"red": (255, 0, 0), "green": (0, 255, 0), "blue": (0, 0, 255)}
SIDE_PX = 128


def write_network(path: Path, side_px: int | None = SIDE_PX, batch: int | str = "n", near: float = 60.0) -> Path:
    """The network in YOLOv5's form for RGB images from 0 to 255: (B, 3, side, side) to (B, 3, 5 + 3), one box a colour.

    A pixel has a colour where no channel is off by `near`; the score is 1 where any pixel has.
    """
    from onnx import TensorProto, helper, numpy_helper

    side = side_px or SIDE_PX
    edge = np.arange(side, dtype=np.float32)
    constants = {
        "near": np.float32([near]),
        "side": np.float32([side]),
        "half": np.float32([0.5]),
        "left": edge.reshape(1, 1, 1, -1),
        "right": edge.reshape(1, 1, 1, -1) + 1,
        "top": edge.reshape(1, 1, -1, 1),
        "bottom": edge.reshape(1, 1, -1, 1) + 1,
        "row": np.int64([0, 1, 8]),
    }
    nodes, rows = [], []

    def node(kind, *inputs, **attributes):
        name = f"v{len(nodes)}"
        nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def most(value):
        return node("ReduceMax", value, axes=[1, 2, 3], keepdims=1)

    for number, (name, colour) in enumerate(COLOURS.items()):
        constants[name] = np.float32(colour).reshape(1, 3, 1, 1)
        constants[f"{name} class"] = np.eye(3, dtype=np.float32)[number].reshape(1, 3, 1, 1)
        off = node("ReduceMax", node("Abs", node("Sub", "images", name)), axes=[1], keepdims=1)
        has = node("Cast", node("Less", off, "near"), to=TensorProto.FLOAT)
        score = most(has)
        # The first edge with the colour: side - max(has * (side - edge)).
        first = [node("Sub", "side", most(node("Mul", has, node("Sub", "side", axis)))) for axis in ("left", "top")]
        last = [most(node("Mul", has, axis)) for axis in ("right", "bottom")]
        centre = [node("Mul", node("Add", a, b), "half") for a, b in zip(first, last, strict=True)]
        size = [node("Sub", b, a) for a, b in zip(first, last, strict=True)]
        rows.append(
            node("Reshape", node("Concat", *centre, *size, score, node("Mul", score, f"{name} class"), axis=1), "row")
        )
    nodes.append(helper.make_node("Concat", rows, ["output"], axis=1))
    images = helper.make_tensor_value_info("images", TensorProto.FLOAT, [batch, 3, side_px or "h", side_px or "w"])
    given = helper.make_tensor_value_info("output", TensorProto.FLOAT, None)
    kept = [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "colours", [images], [given], kept)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), path)
    return path


def settings(path: Path, **more) -> dict:
    """What the detector `onnx` must be told about it."""
    return {"model": str(path), "decoder": "yolov5", "labels": tuple(COLOURS), "channels": "rgb", **more}
