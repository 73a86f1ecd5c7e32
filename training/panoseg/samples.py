"""Training samples: a panorama with random rotation, mirroring and noise, and the target of the network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from salframe_panoseg.classes import HEIGHT, network_input
from salframe_panoseg.detector import from_panorama
from torch.utils.data import Dataset

from salframe.panoramas.geometry import equirectangular_rays
from training.panoseg.panoramas import LabelledPanorama, read_panorama

MIRRORED, HOLED = 0.5, 0.5
"""Probability that a sample is mirrored, and that its range has holes."""
WHOLE, BAND, FIRST_ROWS = 0.15, 160, (32, 64)
"""Probability that a batch has whole panoramas. Other batches have a band of BAND rows, which starts at one of
FIRST_ROWS, because few objects are near the poles."""


def target(panorama: LabelledPanorama, index: Mapping[str, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return class_id (H, W) int64 and vote_m (3, H, W) float32, NaN without an object, of a panorama at network
    resolution."""
    classes = np.zeros(max(panorama.labels, default=0) + 1, np.int64)
    centre_m = np.full((len(classes), 3), np.nan)
    for instance, label in panorama.labels.items():
        classes[instance], centre_m[instance] = index[label], panorama.centre_m[instance]
    points_m = equirectangular_rays(HEIGHT) * panorama.range_m[..., None]
    return classes[panorama.instance_id], from_panorama(centre_m[panorama.instance_id] - points_m).astype(np.float32)


def degrade(rgb: np.ndarray, range_m: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return colour with random exposure, tint, contrast and noise, and range with random scale, noise and holes."""
    light = (rgb / np.float32(255)) ** rng.uniform(0.7, 1.4) * rng.uniform(0.6, 1.4) * rng.uniform(0.88, 1.12, 3)
    light = light + rng.normal(0, rng.uniform(0, 0.03), light.shape)
    degraded_m = range_m * rng.normal(1, 0.02) * (1 + rng.normal(0, rng.uniform(0, 0.02), range_m.shape))
    if rng.random() < HOLED:
        for _ in range(rng.integers(1, 12)):
            row, column, height, width = rng.integers((0, 0, 4, 4), (HEIGHT, 2 * HEIGHT, 48, 48))
            degraded_m[row : row + height, column : column + width] = np.nan
    return (light.clip(0, 1) * 255).astype(np.uint8), degraded_m.astype(np.float32)


class Samples(Dataset):
    """Random samples. Sample i depends only on the seed and i, so a resumed run is identical to one that was not
    interrupted. A sample is a whole panorama or a band of its image rows, the same band for all samples of a batch.

    `shares` (V,) float64 with sum 1 are the probabilities of the panoramas.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        shares: np.ndarray,
        labels: Sequence[str],
        seed: int,
        batch: int,
        count: int,
        start: int = 0,
    ) -> None:
        self._paths, self._shares, self._seed = list(paths), shares, seed
        self._index = {label: i for i, label in enumerate(labels, 1)}
        self._batch, self._start, self._count = batch, start, count

    def __len__(self) -> int:
        return self._count - self._start

    def __getitem__(self, item: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the input (6, rows, 2H), class_id (rows/2, H) int64, and vote_m (3, rows/2, H), NaN without an object.

        The number of rows is H or BAND.
        """
        rng = np.random.default_rng((self._seed, self._start + item))
        panorama = read_panorama(self._paths[rng.choice(len(self._paths), p=self._shares)])
        class_id, vote_m = target(panorama, self._index)
        image = network_input(*degrade(panorama.rgb, panorama.range_m, rng))
        turn = int(rng.integers(2 * HEIGHT))
        image, class_id, vote_m = (np.roll(array, turn, -1) for array in (image, class_id, vote_m))
        if rng.random() < MIRRORED:
            image, class_id, vote_m = (
                image[..., ::-1],
                class_id[..., ::-1],
                vote_m[..., ::-1] * np.array([1, -1, 1], np.float32)[:, None, None],
            )
        image, class_id, vote_m = (array[..., self._rows(item), :] for array in (image, class_id, vote_m))
        return (
            np.ascontiguousarray(image),
            np.ascontiguousarray(class_id[::2, ::2]),
            np.ascontiguousarray(vote_m[:, ::2, ::2]),
        )

    def _rows(self, item: int) -> slice:
        rng = np.random.default_rng((self._seed, 1, (self._start + item) // self._batch))
        if rng.random() < WHOLE:
            return slice(None)
        first = int(rng.choice(FIRST_ROWS))
        return slice(first, first + BAND)
