"""Global descriptors of views, pooled from local ones over a vocabulary of the map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

SAMPLE = 20_000
ITERATIONS = 15


class Vlad:
    """VLAD (Jegou et al. 2010) with residuals normalised a word and then together (Arandjelovic and Zisserman 2013)."""

    def __init__(self, features: Sequence[np.ndarray], words: int) -> None:
        """Learn `words` by k-means on a seeded sample of the local features (N, D) float32 of the map's views."""
        from scipy.cluster.vq import kmeans2

        stacked = np.concatenate(features)
        rng = np.random.default_rng(0)
        sample = stacked[np.sort(rng.permutation(len(stacked))[:SAMPLE])]
        start = sample[np.sort(rng.permutation(len(sample))[:words])]
        self.words = (
            kmeans2(sample, start, iter=ITERATIONS, minit="matrix", missing="warn")[0] if len(sample) > words else start
        )

    def pool(self, features: np.ndarray) -> np.ndarray:
        """(words * D,) float32 of unit length for local features (N, D); zeros where there is none."""
        pooled = np.zeros_like(self.words)
        if len(features) and len(self.words):
            word = (features @ self.words.T - (self.words**2).sum(1) / 2).argmax(1)
            np.add.at(pooled, word, features - self.words[word])
            pooled /= np.maximum(np.linalg.norm(pooled, axis=1, keepdims=True), 1e-9)
        return pooled.ravel() / max(np.linalg.norm(pooled), 1e-9)
