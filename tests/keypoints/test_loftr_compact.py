"""The LoFTR shipped with salframe: equal to kornia's module, better than chance, and without torch."""

from __future__ import annotations

import shutil
import subprocess
import sys

import cv2
import numpy as np
import pytest
from salframe_keypoints.localizer import Keypoints
from salframe_keypoints.loftr_compact import ARCHITECTURE, FILES, FOLDER, STATE, LoftrCompact, mutual_maxima

from salframe.framework.errors import ConfigError, WeightsError
from salframe.panoramas.perspective import ViewRig

SIZE_PX = 320, 240
HOMOGRAPHY = np.array([[0.94, -0.17, 38.0], [0.14, 0.98, -22.0], [1e-4, -5e-5, 1.0]])
"""Homography from the first to the second image: rotation of 9 degrees, translation of 40 pixels, slight tilt."""


@pytest.fixture(scope="module")
def images(rooms):
    """Return (2, 240, 320, 3): a view of a room, and the view warped by HOMOGRAPHY and darkened."""
    view = ViewRig(6, *SIZE_PX, np.deg2rad(90)).cut(rooms[0].panorama("a", np.eye(4)).rgb)[0]
    centred = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])  # OpenCV has pixel centres at integers
    warped = cv2.warpPerspective(view, centred @ HOMOGRAPHY @ np.linalg.inv(centred), SIZE_PX)
    return np.stack([view, (0.6 * warped).astype(np.uint8)])


def precision(matcher, images) -> tuple[float, int]:
    """Return the share of matches within 3 pixels of their position by HOMOGRAPHY, and the number of matches."""
    reference, query = matcher.extract(images)
    points, cells = matcher.match(query, reference)
    true = cv2.perspectiveTransform(reference.points_px[None].astype(np.float64), HOMOGRAPHY)[0][cells]
    return float((np.linalg.norm(points - true, axis=1) <= 3).mean()) if len(cells) else 0.0, len(cells)


def test_matches_are_those_of_kornias_module_with_the_same_weights(images, make_matcher):
    in_kornia = make_matcher("loftr", SIZE_PX, checkpoint=FOLDER / STATE, architecture=ARCHITECTURE)
    compact = make_matcher("loftr-compact", SIZE_PX)
    reference, query = compact.extract(images)
    (points, cells), (expected, expected_cells) = (each.match(query, reference) for each in (compact, in_kornia))
    assert len(cells) > 100
    assert np.isin(cells, expected_cells).mean() > 0.995  # a confidence may round to the other side of the threshold
    assert np.isin(expected_cells, cells).mean() > 0.995
    both = np.intersect1d(cells, expected_cells)
    np.testing.assert_allclose(points[np.isin(cells, both)], expected[np.isin(expected_cells, both)], atol=0.01)


def test_matches_lie_where_a_homography_puts_them(images, make_matcher):
    share, count = precision(make_matcher("loftr-compact", SIZE_PX), images)
    assert count > 200
    assert share > 0.9


def test_that_is_the_weights_doing(images, make_matcher, tmp_path):
    torch = pytest.importorskip("torch")
    state = torch.load(FOLDER / STATE, weights_only=True)
    generator = torch.Generator().manual_seed(0)
    shuffled = {
        name: value.flatten()[torch.randperm(value.numel(), generator=generator)].view(value.shape)
        for name, value in state.items()
    }
    torch.save(shuffled, tmp_path / "shuffled.pt")
    broken = make_matcher("loftr", SIZE_PX, checkpoint=tmp_path / "shuffled.pt", architecture=ARCHITECTURE)
    share, count = precision(broken, images)
    assert share * count < 20


def test_it_runs_without_torch():
    code = (
        "import sys, numpy as np; sys.modules['torch'] = sys.modules['kornia'] = None\n"
        "from salframe_keypoints.loftr_compact import LoftrCompact\n"
        "matcher = LoftrCompact()\n"
        "matcher.prepare(160, 120)\n"
        "a, b = matcher.extract(np.random.default_rng(0).integers(0, 255, (2, 120, 160, 3), np.uint8))\n"
        "print(matcher.match(a, a)[0].shape[1])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "2\n"


def test_views_without_texture_have_no_match(make_matcher):
    matcher = make_matcher("loftr-compact", SIZE_PX, pooled="sift")
    first, second = matcher.extract(np.full((2, 240, 320, 3), 127, np.uint8))
    points, cells = matcher.match(first, second)
    assert points.shape == (len(cells), 2)
    assert matcher.describe(first).shape == (0, 128)


def test_its_tokens_are_local_descriptors_of_unit_length_one_a_cell(make_matcher):
    matcher = make_matcher("loftr-compact", SIZE_PX)
    view, other = matcher.extract(np.random.default_rng(0).integers(0, 255, (2, 240, 320, 3), np.uint8))
    tokens = matcher.describe(view)
    assert tokens.shape == (len(view.points_px), 64)
    assert tokens.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(tokens, axis=1), 1, atol=1e-5)
    assert not np.allclose(tokens, matcher.describe(other), atol=0.1)


def test_mutual_maxima_are_greatest_in_row_and_column():
    confidence = np.array([[0.9, 0.3, 0.0], [0.8, 0.1, 0.2], [0.0, 0.5, 0.4], [0.1, 0.0, 0.15]])
    rows, columns, values = mutual_maxima(confidence, 0.2)
    assert (rows.tolist(), columns.tolist(), values.tolist()) == ([0, 2], [0, 1], [0.9, 0.5])


@pytest.mark.parametrize("name", FILES)
def test_a_truncated_file_is_one_clear_line(name, tmp_path, monkeypatch):
    shutil.copytree(FOLDER, tmp_path / "weights" / "loftr-compact")
    path = tmp_path / "weights" / "loftr-compact" / name
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(WeightsError, match=rf"{name} is not an ONNX network: .*"):  # the user's own: by its layout
        LoftrCompact(LoftrCompact.Config(checkpoint=path.parent))
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    with pytest.raises(
        WeightsError, match=rf"{name} has the sha256 hash [0-9a-f]{{64}}, expected [0-9a-f]{{64}}; "
    ):  # ours: by its hash
        Keypoints(Keypoints.Config(features="loftr-compact"))


def test_a_network_of_another_layout_is_one_clear_line(tmp_path):
    shutil.copytree(FOLDER, tmp_path / "own")
    shutil.copy(tmp_path / "own" / FILES[1], tmp_path / "own" / FILES[0])
    with pytest.raises(
        WeightsError, match=r"features\.onnx has the inputs first float32 .*, expected float32 \(1, 1, \*, \*\)"
    ):
        LoftrCompact(LoftrCompact.Config(checkpoint=tmp_path / "own"))


@pytest.mark.parametrize("size", [(324, 240), (320, 520)])
def test_views_of_another_kind_of_size_are_one_clear_line(size, make_matcher):
    with pytest.raises(ConfigError, match=rf"height_px are {size[0]} and {size[1]}, expected multiples of 8 up to 512"):
        make_matcher("loftr-compact", size)


def test_what_is_shipped_is_small():
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 8e6
