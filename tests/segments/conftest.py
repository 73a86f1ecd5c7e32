from __future__ import annotations

import pytest


@pytest.fixture(scope="session")
def models(tmp_path_factory):
    """Return a function that saves a tiny model once and returns its folder."""
    import tiny_models as tiny

    seeds = {tiny.detr_panoptic: 3}  # with this seed, the network gives objects; with 0 it gives none
    root, saved = tmp_path_factory.mktemp("models"), {}

    def folder(make):
        if make not in saved:
            saved[make] = tiny.random_weights(make, root / make.__name__, seeds.get(make, 0))
        return saved[make]

    return folder
