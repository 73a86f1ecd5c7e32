"""Networks of a few nodes with known outputs, and panoramas whose colour tells the azimuth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from salframe.panoramas.geometry import column_azimuth, pose_yaw
from salframe.panoramas.panorama import Panorama

HEIGHT = 128


@pytest.fixture
def write_network(tmp_path) -> Callable[..., Path]:
    """Writes an ONNX file: one input, float32 images (n, 3, h, w) named x unless said otherwise, and y, which the nodes
    make of it."""
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper, numpy_helper

    def write(
        name: str, nodes: list, shape=("n", 3, "h", "w"), dtype=TensorProto.FLOAT, constants=None, taken="x"
    ) -> Path:
        given = helper.make_tensor_value_info(taken, dtype, shape)
        tensors = [numpy_helper.from_array(value, key) for key, value in (constants or {}).items()]
        made = helper.make_graph(
            nodes, "net", [given], [helper.make_tensor_value_info("y", TensorProto.FLOAT, None)], tensors
        )
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        onnx.save(helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), tmp_path / name)
        return tmp_path / name

    return write


@pytest.fixture
def same_network(write_network) -> Path:
    """A network whose feature map is the image."""
    from onnx import helper

    return write_network("same.onnx", [helper.make_node("Identity", ["x"], ["y"])])


def compass(colours: np.ndarray, T_world_pano: np.ndarray | None = None, valid: np.ndarray | None = None) -> Panorama:
    """A panorama of an endless cylinder: grey 127, and 100 cos or sin of the world azimuth as `colours` (3, 2) mixes
    them."""
    azimuth = column_azimuth(2 * HEIGHT) + (0.0 if T_world_pano is None else pose_yaw(T_world_pano))
    row = 127 + 100 * np.stack([np.cos(azimuth), np.sin(azimuth)], 1) @ colours.T
    return Panorama("compass", np.broadcast_to(np.rint(row), (HEIGHT, 2 * HEIGHT, 3)).astype(np.uint8), valid=valid)
