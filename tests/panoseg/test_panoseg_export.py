"""The exported network, run by onnxruntime, against the one in torch."""

from __future__ import annotations

import json

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the network is exported by torch: salframe[training]")
pytest.importorskip("onnxscript", reason="the network is exported by torch: salframe[training]")

from salframe_panoseg.classes import CHANNELS, HEIGHT  # noqa: E402
from salframe_panoseg.detector import OUTPUTS  # noqa: E402

from salframe.framework.files.hashes import file_sha256  # noqa: E402
from salframe.framework.onnx import open_model  # noqa: E402
from training.panoseg.export import DOUBT, doubled, export  # noqa: E402
from training.panoseg.network import PanoSeg  # noqa: E402

LABELS = ["bed", "chair", "sofa"]


@pytest.mark.slow
def test_it_answers_as_in_torch_and_takes_the_weights_of_training_back(tmp_path):
    torch.manual_seed(0)
    network, weights = PanoSeg(4), torch.tensor([0.1, 0.5, 3.0, 1.0])
    torch.nn.init.normal_(network.classify.weight, std=20.0)
    torch.save({"network": network.state_dict(), "weights": weights}, tmp_path / "checkpoint.pt")
    path = export(tmp_path / "checkpoint.pt", tmp_path / "panoseg.onnx", {"labels": LABELS})
    assert json.loads((tmp_path / "panoseg.json").read_text()) == {"labels": LABELS, "sha256": file_sha256(path)}
    image = torch.randn(1, CHANNELS, HEIGHT, 2 * HEIGHT)
    class_id, score, vote_m = open_model(path, [tuple(image.shape)], OUTPUTS).run(image.numpy())
    with torch.inference_mode():
        logits, votes = network.eval()(image)
    # What the network learnt are p(class) * weight; of that, p(class) is left.
    posterior = (logits.double().softmax(1) / weights[:, None, None]).float()
    posterior /= posterior.sum(1, keepdim=True)
    # Structure only where it is DOUBT times as probable as any object.
    lenient = posterior / torch.tensor([DOUBT, 1, 1, 1])[:, None, None]
    expected_score = posterior.gather(1, lenient.argmax(1, keepdim=True))[0, 0]
    assert (np.abs(score[0, ::2, ::2] - expected_score.numpy()) < 1e-4).mean() > 0.999
    np.testing.assert_allclose(vote_m, doubled(votes), atol=1e-4)
    expected = doubled(lenient.log()).argmax(1)[0].numpy()
    assert (class_id[0] == expected).mean() > 0.999
    assert len(np.unique(class_id)) > 1
