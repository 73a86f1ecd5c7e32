from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from salframe.framework.components.registry import registry


@pytest.fixture
def interruptible():
    """SIGINT raises KeyboardInterrupt here, even where a shell has started the tests in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """The components of fake_plugin and the engines alone, an empty cache, and tmp_path as the working directory."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,salframe_engines")
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.chdir(tmp_path)
    registry.cache_clear()
    yield
    registry.cache_clear()


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
