import numpy as np
from scipy import ndimage

from salframe.graphs.pixels import connected_parts, without_strays


def test_parts_are_those_of_scipy_where_no_seam_is_crossed():
    rng = np.random.default_rng(0)
    usable = ndimage.gaussian_filter(rng.normal(size=(32, 64)), 1.5) > 0.02
    usable[:, 0] = False
    labels, number = ndimage.label(usable, np.ones((3, 3)))
    part = connected_parts(usable, lambda first, second: np.ones(len(first), bool))
    assert number > 3
    assert len(set(zip(part.tolist(), labels[usable].tolist(), strict=True))) == part.max() + 1 == number


def test_the_seam_joins_and_pixels_that_are_not_alike_part():
    usable = np.zeros((8, 16), bool)
    usable[3, [0, 1, 15]] = True
    usable[[2, 4], 2] = True  # diagonal neighbours
    everything = connected_parts(usable, lambda first, second: np.ones(len(first), bool))
    assert set(everything.tolist()) == {0}
    value = np.zeros(128)
    value[3 * 16 + 1] = 5
    part = connected_parts(usable, lambda first, second: value[first] == value[second])
    assert len(set(part.tolist())) == 4  # the seam's pair, the odd one, and the two beside it


def test_nothing_usable_has_no_parts():
    assert connected_parts(np.zeros((4, 8), bool), lambda first, second: first == second).shape == (0,)


def test_strays_go_and_a_long_object_stays_whole():
    rng = np.random.default_rng(0)
    sofa = rng.uniform((-1, -0.4, 0), (1, 0.4, 0.8), (400, 3))
    strays = rng.uniform((3, 3, 0), (4, 4, 1), (20, 3))
    kept = without_strays(np.concatenate([sofa, strays]))
    np.testing.assert_array_equal(kept, sofa)
