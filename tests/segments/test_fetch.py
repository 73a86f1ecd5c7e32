"""`salframe weights fetch ade20k` from a server on the loopback, and the detector without further settings."""

import hashlib
import importlib.util
import threading
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from colour_network import COLOURS
from command_line import run
from salframe_segments import card, detector

from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.errors import RequirementMissing, WeightsError
from salframe.framework.files.weights import Link, WeightsFile
from salframe.panoramas.panorama import Panorama


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *arguments):
        pass


@pytest.fixture
def folder(tmp_path):
    """What the server serves."""
    folder = tmp_path / "served"
    folder.mkdir()
    return folder


@pytest.fixture
def address(folder):
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


@pytest.fixture
def published(folder, address, tmp_path, monkeypatch):
    """The weights `ade20k`, in the place of whose file the server has the network of known answers."""
    from tflite_network import write_tflite

    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    content = write_tflite(folder / "network.tflite", quantized=True).read_bytes()
    sha256 = hashlib.sha256(content).hexdigest()
    file = WeightsFile(detector.NETWORKS["ade20k"].files[0].name, sha256, len(content))
    source = Link((f"{address}/gone.tflite", f"{address}/network.tflite?lite-format=tflite"))
    weights = replace(detector.NETWORKS["ade20k"], files=(file,), source=source)
    monkeypatch.setitem(detector.NETWORKS, "ade20k", weights)
    monkeypatch.setattr(detector.SegmentsDetector, "weights", (weights,))
    shipped = tmp_path / "cards"
    shipped.mkdir()
    written = (folder / "network.yaml").read_text()
    (shipped / "colours.yaml").write_text(f"{written}\nsha256: {sha256}\n")
    monkeypatch.setattr(card, "SHIPPED", shipped)
    return weights


def test_fetched_weights_make_the_detector_work_without_settings(published):
    pytest.importorskip("ai_edge_litert")
    config = configure("detector", "segments", {})
    with pytest.raises(WeightsError, match=r"is missing .*; download it with: salframe weights fetch ade20k"):
        registry().build("detector", config)
    printed = run("weights", "fetch", "ade20k")
    assert printed.code == 0
    assert "ade20k: Apache-2.0; trained on ADE20K, whose images are for research and non-commercial use" in printed.err
    assert printed.out.strip() == str(published.directory / published.files[0].name)
    rgb = np.full((256, 512, 3), COLOURS["wall"], np.uint8)
    rgb[110:150, 230:290] = COLOURS["plant"]
    assert registry().build("detector", config).detect(Panorama("room", rgb=rgb)).labels == ("plant",)


def test_what_was_served_instead_is_refused(published, folder):
    (folder / "network.tflite").write_bytes(b"<html>moved</html>")
    with pytest.raises(WeightsError, match=f"expected {published.files[0].sha256}"):
        published.fetch()


def test_without_the_extra_one_line_says_so_and_onnx_needs_none(published, monkeypatch, tmp_path):
    from colour_network import write_network

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "ai_edge_litert" else find(name))
    published.fetch()
    with pytest.raises(RequirementMissing) as caught:
        detector.SegmentsDetector()
    assert (
        str(caught.value)
        == "segments needs the Python package ai_edge_litert, which is not installed: pip install 'salframe[tflite]'"
    )
    own = write_network(tmp_path / "own.onnx")
    assert detector.SegmentsDetector(configure("detector", "segments", {"model": str(own)})).config.card
