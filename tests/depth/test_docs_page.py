"""The code of docs/how-to/roles/range-model.md, run as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from conformance import conforms

from salframe.panoramas.camera_height import camera_height
from salframe.panoramas.panorama import Panorama

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "roles" / "range-model.md"


def test_the_pages_range_model_conforms_and_its_floor_is_where_it_says(tmp_path, monkeypatch):
    code, _ = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "page_range_model.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    from page_range_model import EmptyRoom

    assert conforms(EmptyRoom)
    range_m = EmptyRoom(EmptyRoom.Config(camera_height_m=1.3)).estimate(
        Panorama("a", rgb=np.zeros((64, 128, 3), np.uint8))
    )
    assert camera_height(range_m) == pytest.approx(1.3, rel=0.02)
