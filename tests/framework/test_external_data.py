"""ONNX networks whose tensors are in other files: read beside the network, part of its identity, never outside."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.framework.component import Component, ComponentConfig
from salframe.framework.components.identity import SingleFile, UserFile, content_sha256, identity
from salframe.framework.errors import ConfigError, WeightsError
from salframe.framework.files.hashes import file_sha256
from salframe.framework.files.onnx_files import external_files
from salframe.framework.onnx import open_model

onnx = pytest.importorskip("onnx")


def write(path, bias=2.0, location="net.bin", inner=False):
    """A network y = x + bias, whose bias is in another file; inner: in the branch of an If."""
    from onnx import TensorProto, helper, numpy_helper

    x, y = (helper.make_tensor_value_info(name, TensorProto.FLOAT, ("n", 300)) for name in "xy")
    tensor = numpy_helper.from_array(np.full((300,), bias, np.float32), "bias")
    nodes, tensors = [helper.make_node("Add", ["x", "bias"], ["y"])], [tensor]
    if inner:
        branch = helper.make_graph(nodes, "branch", [], [y], tensors)
        nodes = [helper.make_node("If", ["yes"], ["y"], then_branch=branch, else_branch=branch)]
        tensors = [numpy_helper.from_array(np.array(True), "yes")]
    graph = helper.make_graph(nodes, "net", [x], [y], tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save_model(model, str(path), save_as_external_data=True, location="net.bin", size_threshold=100)
    if location != "net.bin":
        content = path.read_bytes()
        model = onnx.load_from_string(content)
        for entry in model.graph.initializer[0].external_data:
            entry.value = location if entry.key == "location" else entry.value
        path.write_bytes(model.SerializeToString())
    return path


def result(path):
    return open_model(path).run(np.zeros((1, 300), np.float32))[0][0, 0]


@pytest.mark.parametrize("inner", [False, True])
def test_tensors_are_read_beside_the_network(tmp_path, monkeypatch, inner):
    (tmp_path / "a").mkdir()
    path = write(tmp_path / "a" / "net.onnx", inner=inner)
    write(tmp_path / "net.onnx", bias=9.0)
    monkeypatch.chdir(tmp_path)  # where another net.bin lies
    assert external_files(path) == (tmp_path / "a" / "net.bin",)
    assert result(path) == 2


@pytest.mark.parametrize("inner", [False, True])
def test_they_are_part_of_the_identity(tmp_path, inner):
    path = write(tmp_path / "net.onnx", inner=inner)
    before, own = content_sha256(path), file_sha256(path)
    (tmp_path / "net.bin").write_bytes(np.full(900, 5, np.float32).tobytes())
    assert file_sha256(path) == own
    assert content_sha256(path) != before
    assert result(path) == 5


@pytest.mark.parametrize("location", ["../net.bin", "/etc/hostname", "a/../../net.bin", "C:\\net.bin", "..\\net.bin"])
def test_a_location_outside_the_folder_is_refused(tmp_path, location):
    path = write(tmp_path / "net.onnx", location=location)
    with pytest.raises(WeightsError, match=r"net\.onnx stores weights in .*, outside the folder of the network"):
        open_model(path)
    with pytest.raises(ConfigError, match="outside the folder of the network"):
        content_sha256(path)


def test_a_link_that_leaves_the_folder_is_refused(tmp_path):
    (tmp_path / "a").mkdir()
    path = write(tmp_path / "a" / "net.onnx")
    (tmp_path / "a" / "net.bin").rename(tmp_path / "far.bin")
    (tmp_path / "a" / "net.bin").symlink_to(tmp_path / "far.bin")
    with pytest.raises(WeightsError, match="outside the folder of the network"):
        open_model(path)


def test_a_missing_file_is_named(tmp_path):
    path = write(tmp_path / "net.onnx")
    (tmp_path / "net.bin").unlink()
    with pytest.raises(WeightsError, match=r"stores weights in 'net\.bin', but this file is missing"):
        open_model(path)


def test_another_suffix_would_hide_the_file_from_the_identity(tmp_path):
    path = write(tmp_path / "net.onnx").rename(tmp_path / "net.weights")
    with pytest.raises(WeightsError, match=r"its file name must end in \.onnx"):
        open_model(path)


class Reader(Component):
    role = "external-data-test"
    name = "reader"
    version = "1"

    class Config(ComponentConfig):
        model: SingleFile | None = None
        folder: UserFile | None = None


def test_a_folder_is_no_file(tmp_path):
    with pytest.raises(ConfigError, match=r"is a folder, expected a file"):
        identity(Reader.Config(model=tmp_path))


def test_a_folder_of_too_many_files_is_refused_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr("salframe.framework.components.identity.MAX_FOLDER_FILES", 3)
    for number in range(5):
        (tmp_path / f"{number}.txt").write_text("a")
    with pytest.raises(ConfigError, match="contains more than 3 files or 4 GiB"):
        identity(Reader.Config(folder=tmp_path))


def test_a_folder_of_huge_files_is_refused_before_they_are_read(tmp_path):
    with (tmp_path / "huge.bin").open("wb") as file:
        file.truncate(5 << 30)  # takes no space
    with pytest.raises(ConfigError, match="contains more than 10000 files or 4 GiB"):
        content_sha256(tmp_path)
