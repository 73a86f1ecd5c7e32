"""Synthetic maps of any size: the same under its seed, and no scene known by its labels alone."""

import itertools
from collections import Counter

import numpy as np
import pytest

from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.synthetic_map import SyntheticMap
from salframe.testing.expectations import same

LABELS = ("bed", "sofa", "chair", "table", "lamp", "plant", "tv", "desk", "picture", "cabinet")


def room(seed):
    """A room of 12 objects."""
    rng = np.random.default_rng(seed)
    shares = rng.dirichlet(np.ones(12))
    centroid, size = rng.normal(0, 2, (12, 3)), rng.uniform(0.3, 2, (12, 3))
    edges = np.column_stack(np.triu_indices(12, 1))[::3]
    return SaliencyGraph(tuple(rng.choice(LABELS, 12)), np.ones(12), shares, centroid, size, np.zeros(12), edges)


ROOMS = tuple(map(room, range(8)))


@pytest.fixture(scope="module")
def synthetic_map():
    return SyntheticMap(3, ROOMS)


def test_a_scene_is_the_same_however_it_is_made(synthetic_map):
    streamed = next(itertools.islice(synthetic_map.scenes(50), 40, None))
    assert same(streamed, synthetic_map.scene(40))
    assert same(SyntheticMap(3, ROOMS).scene(40), synthetic_map.scene(40))
    assert not same(SyntheticMap(4, ROOMS).scene(40), synthetic_map.scene(40))


def test_a_query_lacks_and_renames_some_of_its_scene(synthetic_map):
    kept = renamed = whole = 0
    for number in range(200):
        scene, query = synthetic_map.scene(number), synthetic_map.query(number)
        whole, kept = whole + len(scene), kept + len(query)
        renamed += len(query) - _shared(query, scene)
    assert 0.75 < kept / whole < 0.85
    assert 0.03 < renamed / kept < 0.07


def _shared(query, scene):
    """How many names both have."""
    return (Counter(query.labels) & Counter(scene.labels)).total()


def test_labels_alone_saturate(synthetic_map):
    """Of 40 scenes of one room several are as like a query by their names as its own is: of many, too many."""
    rooms, ahead = len(synthetic_map.rooms), []
    for number in range(20):
        query = synthetic_map.query(number)
        jaccard = []
        for scene in (synthetic_map.scene(number + rooms * copy) for copy in range(40)):
            shared = _shared(query, scene)
            jaccard.append(shared / (len(query) + len(scene) - shared))
        ahead.append(sum(value >= jaccard[0] for value in jaccard[1:]))
    assert np.mean(ahead) > 2
