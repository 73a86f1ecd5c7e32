"""Rooms whose colour holds their range, and depth networks that read it: what each view's answer ought to be is known.

The sum of a pixel's colours is linear in the logarithm of its range, so that views may interpolate it. What is not
metric gets a scale and a shift of its own in each view, by how far that view sees on the mean.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from salframe.panoramas.panorama import Panorama
from salframe.testing.rooms import FurnishedRoom, look, stand

onnx = pytest.importorskip("onnx")

NEAR_M, FAR_M = 0.2, 12.0
STEPS = 3 * 255
SIDE_PX = 128
FOV_DEG = 90.0
PLAIN = {"scale": 1.0, "mean": (0.0, 0.0, 0.0), "std": (1.0, 1.0, 1.0)}
"""Settings of a network that takes colours from 0 to 255."""


def painted(room: FurnishedRoom) -> Panorama:
    """What a camera in the middle of the room sees, its range painted."""
    return paint(look(room, room.name, stand(room), {"rgb", "range"}))


def paint(panorama: Panorama) -> Panorama:
    """The panorama with its range as its colour, in steps of 0.54 %."""
    share = np.log(panorama.range_m / NEAR_M) / np.log(FAR_M / NEAR_M)
    level = np.round(np.clip(share, 0, 1) * STEPS).astype(int)
    rgb = np.stack([(level + part) // 3 for part in range(3)], -1).astype(np.uint8)
    return replace(panorama, rgb=rgb)


def write_network(
    path: Path,
    gives: str = "inverse",
    *,
    size_px: tuple[int, int] = (SIDE_PX, SIDE_PX),
    fov_deg: float = FOV_DEG,
    times: float = 1.0,
    spread: float = 0.0,
    shift: float = 0.0,
    layout: str = "channel",
) -> Path:
    """A network for RGB images from 0 to 255, (1, 3, height, width), that gives what `gives` says in views of this
    field of view across the shorter side, or in an equirectangular image, which has range along the ray alone.

    What it gives is multiplied by `times` and by the exponential of `spread` x, and `shift` x is added, where x is the
    view's mean logarithm of range, 0 at 2 m. layout: of the output, channel (1, 1, h, w), none (1, h, w).
    """
    from onnx import TensorProto, helper, numpy_helper

    width, height = size_px
    focal = min(size_px) / 2 / np.tan(np.radians(fov_deg) / 2)
    y, x = np.mgrid[:height, :width].astype(np.float32) + 0.5
    ray = np.stack([(x - width / 2) / focal, (y - height / 2) / focal, np.ones_like(x)])
    ray /= np.linalg.norm(ray, axis=0)
    along = {"inverse": 1 / ray[2], "z-depth": ray[2], "range": np.ones_like(x), "points": ray}[gives]
    if width == 2 * height:
        along = np.ones_like(x)
    constants = {
        "rate": np.float32([np.log(FAR_M / NEAR_M) / STEPS * 3]),
        "near": np.float32([np.log(NEAR_M)]),
        "middle": np.float32([np.log(2.0)]),
        "sign": np.float32([-1 if gives == "inverse" else 1]),
        "along": along.astype(np.float32).reshape(1, -1, height, width) * np.float32(times),
        "spread": np.float32([spread]),
        "shift": np.float32([shift]),
    }
    nodes = []

    def node(kind, *inputs, **attributes):
        name = "depth" if attributes.pop("last", False) else f"v{len(nodes)}"
        nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    level = node("ReduceMean", "image", axes=[1], keepdims=1)
    log = node("Add", node("Mul", level, "rate"), "near")
    far = node("Sub", node("ReduceMean", log, axes=[1, 2, 3], keepdims=1), "middle")
    true = node("Mul", node("Exp", node("Mul", log, "sign")), "along")
    scaled = node("Mul", true, node("Exp", node("Mul", far, "spread")))
    moved = node("Add", scaled, node("Mul", far, "shift"), last=layout == "channel")
    if layout == "none":
        node("Squeeze", moved, "channel", last=True)
        constants["channel"] = np.int64([1])
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, height, width])
    depth = helper.make_tensor_value_info("depth", TensorProto.FLOAT, None)
    kept = [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "painted", [image], [depth], kept)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), path)
    return path
