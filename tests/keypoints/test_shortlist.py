from __future__ import annotations

import numpy as np
from salframe_image.image_network import ImageNetwork
from salframe_keypoints.shortlist import NetworkDescriptors, Vlad


def unit(rng, *shape):
    vectors = rng.normal(size=shape).astype(np.float32)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_vlad_is_the_normalised_sum_of_residuals():
    words = np.array([[1, 0], [0, 1]], np.float32)
    vlad = Vlad([words], 2)  # with as many features as words, the features are the words
    np.testing.assert_array_equal(vlad.words, words)
    pooled = vlad.pool(np.array([[0.8, 0.6], [0.6, 0.8], [0.8, -0.6]], np.float32))
    first, second = np.array([0.8 + 0.8 - 2, 0.6 - 0.6]), np.array([0.6, 0.8 - 1])
    expected = np.concatenate([first / np.linalg.norm(first), second / np.linalg.norm(second)]) / np.sqrt(2)
    np.testing.assert_allclose(pooled, expected, atol=1e-6)


def test_the_vocabulary_is_the_same_each_time_and_empty_views_are_zero():
    features = [unit(np.random.default_rng(seed), 300, 16) for seed in range(4)]
    first, second = Vlad(features, 8), Vlad(features, 8)
    np.testing.assert_array_equal(first.words, second.words)
    assert not first.pool(np.zeros((0, 16), np.float32)).any()
    assert np.isclose(np.linalg.norm(first.pool(features[0])), 1)


class MeanColour(ImageNetwork):
    """An image network of 8 x 8 pixels whose features are the mean colour."""

    name = "mean-colour"
    version = "1"
    size_px = 8

    def embed(self, views):
        return views.mean((1, 2), dtype=np.float32)


def test_descriptors_of_a_network_are_of_unit_length_and_zero_where_nothing_was_seen():
    """Six views are 60 deg apart, the first ahead. If only the front half is valid, three views are empty."""
    rgb = np.zeros((64, 128, 3), np.uint8)
    rgb[:] = 30, 40, 0
    made = NetworkDescriptors(MeanColour(), 6, np.radians(60))
    whole = made.describe(rgb, None)["global"]
    assert whole.dtype == np.float16
    np.testing.assert_allclose(whole, [[0.6, 0.8, 0]] * 6, atol=1e-3)
    ahead = np.zeros((64, 128), bool)
    ahead[:, 32:96] = True  # azimuths of -90 to 90 deg: the views at 0, 60 and 300
    partial = made.describe(rgb, ahead)["global"]
    assert (partial.any(1)).tolist() == [True, True, False, False, False, True]
    pool, of_map = made.learn([{"global": whole}, {"global": partial}])
    assert of_map.shape == (2, 6, 3)
    np.testing.assert_array_equal(pool({"global": partial}), of_map[1])
