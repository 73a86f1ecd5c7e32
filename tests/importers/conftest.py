from __future__ import annotations

import numpy as np
import pytest
from drawn_home import MARKER, panorama, stands
from foreign_formats import write_cubemaps, write_pictures, write_transforms, write_tum

import salframe


@pytest.fixture(scope="session")
def written(tmp_path_factory):
    """The drawn home in every format, by name."""
    root, home = tmp_path_factory.mktemp("home"), stands()
    return {
        "pictures": write_pictures(root / "pictures", home[:3], home[3:]),
        "perspective": write_transforms(root / "perspective", home),
        "cubemap": write_cubemaps(root / "cubemap", home),
        "tum": write_tum(root / "tum", home),
    }


@pytest.fixture
def import_home(written, tmp_path):
    """Imports the home from a format at 128 rows, and returns the result."""

    def run(format, *settings, source=None, **options):
        height = () if format == "pictures" else ("height=128",)
        camera = ("camera=default",) if format == "tum" else ()
        folder = tmp_path / "imported"
        return salframe.import_data(
            format, source or written[format], folder, settings=(*height, *camera, *settings), **options
        )

    return run


def references(result):
    """The reference frames of an imported folder."""
    (fold,) = salframe.find_dataset(str(result.folder)).folds()
    return fold.references


def differences(frame):
    """Of an imported frame: relative errors of its ranges (K,), those of its colour (K,), and the distance in pixels of
    the red disk from where the closed form puts its centre."""
    imported, (rgb, range_m) = frame.load(), panorama(frame.T_world_pano, 128)
    is_known = np.isfinite(imported.range_m)
    errors = np.abs(imported.range_m / range_m - 1)[is_known]
    colors = np.abs(imported.rgb.astype(int) - rgb).max(-1)[is_known]
    x, y, z = (MARKER - frame.T_world_pano[:3, 3]) @ frame.T_world_pano[:3, :3]
    column = (np.pi - np.arctan2(y, x)) / np.pi * 128
    row = (np.pi / 2 - np.arctan2(z, np.hypot(x, y))) / np.pi * 128
    rows, columns = np.nonzero(imported.rgb[..., 0] > 128)
    if not len(rows):
        return errors, colors, None
    across = (columns + 0.5 - column + 128) % 256 - 128
    return errors, colors, float(np.hypot(across.mean(), (rows + 0.5 - row).mean()))
