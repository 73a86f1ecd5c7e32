"""What two views of 320 x 240 cost `loftr-compact`, by onnxruntime and by kornia's module with the same weights. `make
benchmark`."""

import numpy as np
import pytest
from salframe_keypoints.loftr import Loftr
from salframe_keypoints.loftr_compact import ARCHITECTURE, FOLDER, LOFTR_COMPACT, STATE, Network
from scipy.ndimage import gaussian_filter

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def images():
    """(2, 240, 320) uint8: a texture, and the same 16 pixels aside."""
    texture = gaussian_filter(np.random.default_rng(0).normal(size=(240, 336)), 2)
    gray = np.clip(127 + 60 * texture / texture.std(), 0, 255).astype(np.uint8)
    return np.stack([gray[:, :320], gray[:, 16:]])


def test_a_pair_in_kornia(benchmark, images):
    pytest.importorskip("kornia")
    matcher = Loftr(Loftr.Config(checkpoint=FOLDER / STATE, architecture=ARCHITECTURE))
    matcher.prepare(320, 240)
    first, second = matcher.extract(np.repeat(images[..., None], 3, axis=3))
    points, _ = benchmark(matcher.match, second, first)
    assert len(points) > 100


def test_a_pair_by_onnxruntime(benchmark, images):
    network = Network(LOFTR_COMPACT.paths())
    cells, _, _ = benchmark(lambda: network.match(*map(network.features, images)))
    assert len(cells) > 100


def test_a_pair_whose_views_are_known(benchmark, images):
    """Most of a query: its views are matched with each reference frame, and their features are cached."""
    network = Network(LOFTR_COMPACT.paths())
    first, second = map(network.features, images)
    cells, _, _ = benchmark(network.match, first, second)
    assert len(cells) > 100
