from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from salframe.framework.errors import WeightsError
from salframe.framework.onnx import Tensor, open_model

onnx = pytest.importorskip("onnx")
RNG = np.random.default_rng(360)
INNER = "the-doubled-input-" + "x" * 150  # longer than 127 bytes: its length takes two bytes in the file


def write(path: Path, shape=("n", 3, 4, 4), nodes=None) -> Path:
    """A network y = mean over rows and columns of 2 x."""
    from onnx import TensorProto, helper

    nodes = nodes or [
        helper.make_node("Add", ["x", "x"], [INNER]),
        helper.make_node("GlobalAveragePool", [INNER], ["y"]),
    ]
    value = [
        helper.make_tensor_value_info("x", TensorProto.FLOAT, shape),
        helper.make_tensor_value_info("y", TensorProto.FLOAT, None),
    ]
    graph = helper.make_graph(nodes, "net", value[:1], value[1:])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path


def test_a_batch_goes_through(tmp_path):
    model = open_model(write(tmp_path / "net.onnx"), [(None, 3, 4, 4)])
    batch = RNG.standard_normal((5, 3, 4, 4), np.float32)
    (received,) = model.run(batch)
    assert model.inputs == (Tensor("x", "float32", (None, 3, 4, 4)),)
    assert model.outputs == ("y",)
    np.testing.assert_allclose(received[..., 0, 0], 2 * batch.mean((2, 3)), rtol=1e-5, atol=1e-6)


def test_a_network_for_one_image_takes_a_batch_too(tmp_path):
    model = open_model(write(tmp_path / "net.onnx", (1, 3, 4, 4)), [(None, 3, 4, 4)])
    batch = RNG.standard_normal((5, 3, 4, 4), np.float32)
    np.testing.assert_allclose(model.run(batch)[0][..., 0, 0], 2 * batch.mean((2, 3)), rtol=1e-5, atol=1e-6)
    assert model.run(batch[:1])[0].shape == (1, 3, 1, 1)


def test_an_inner_tensor_is_an_output_where_it_is_named(tmp_path):
    model = open_model(write(tmp_path / "net.onnx"), outputs=[INNER, "y"])
    batch = RNG.standard_normal((2, 3, 4, 4), np.float32)
    inner, outer = model.run(batch)
    np.testing.assert_array_equal(inner, 2 * batch)
    assert outer.shape == (2, 3, 1, 1)


def test_a_tensor_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(
        WeightsError, match=r"net\.onnx is not an ONNX network with a tensor feature: .*feature"
    ) as caught:
        open_model(write(tmp_path / "net.onnx"), outputs=["feature"])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"<html>404</html>", None])
def test_a_file_that_is_no_network_is_one_line(tmp_path, content):
    path = tmp_path / "net.onnx"
    whole = write(path).read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if content is None else content)
    with pytest.raises(WeightsError, match=r"net\.onnx is not an ONNX network: .") as caught:
        open_model(path)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(WeightsError, match=r"cannot read .*net\.onnx: No such file"):
        open_model(tmp_path / "net.onnx")


@pytest.mark.parametrize("shape", [("n", 4, 4, 3), ("n", 3, 8, 8), (2, 3, 4, 4), ("n", 3, 4)])
def test_another_layout_names_what_was_received_and_expected(tmp_path, shape):
    received = ", ".join("*" if length == "n" else str(length) for length in shape)
    with pytest.raises(
        WeightsError, match=re.escape(f"has the inputs x float32 ({received}), expected float32 (*, 3, 4, 4)")
    ):
        open_model(
            write(tmp_path / "net.onnx", shape, nodes=[onnx.helper.make_node("Identity", ["x"], ["y"])]),
            [(None, 3, 4, 4)],
        )


def test_another_dtype_or_number_of_inputs_is_refused(tmp_path):
    path = write(tmp_path / "net.onnx")
    with pytest.raises(WeightsError, match=r"has the inputs x float32 \(\*, 3, 4, 4\), expected uint8 \(\*, 3, 4, 4\)"):
        open_model(path, [(None, 3, 4, 4)], dtype="uint8")
    with pytest.raises(WeightsError, match=r"expected float32 \(\*, 3, 4, 4\), float32 \(\*, 3, 4, 4\)"):
        open_model(path, [(None, 3, 4, 4), (None, 3, 4, 4)])


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        (
            [("Sub", ["x", "x"], ["zero"]), ("Div", ["zero", "zero"], ["y"])],
            "returned only NaN or infinity as the output y",
        ),
        (
            [("Concat", ["x", "x"], ["y"], {"axis": 0})],
            r"returned the output y of shape \(4, 3, 4, 4\) for a batch of 2",
        ),
        (
            [("ReduceMax", ["x"], ["y"], {"axes": [0]})],
            r"returned the output y of shape \(1, 3, 4, 4\) for a batch of 2",
        ),
        ([("Tile", ["x", "x"], ["y"])], r"failed on inputs of shape \(2, 3, 4, 4\)|is not an ONNX network"),
    ],
)
def test_an_output_that_is_no_answer_to_the_batch_is_refused(tmp_path, capfd, nodes, message):
    made = [
        onnx.helper.make_node(kind, takes, gives, **(more[0] if more else {})) for kind, takes, gives, *more in nodes
    ]
    with pytest.raises(WeightsError, match=rf"net\.onnx {message}"):
        open_model(write(tmp_path / "net.onnx", nodes=made), [(None, 3, 4, 4)]).run(np.ones((2, 3, 4, 4), np.float32))
    assert capfd.readouterr().err == ""
