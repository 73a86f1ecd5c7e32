"""Files that are never half written."""

from __future__ import annotations

import os

import pytest

from salframe.framework.files.writing import atomic_path, share_file


@pytest.mark.parametrize("linked", [True, False])
def test_a_shared_file_is_found_under_both_paths(tmp_path, monkeypatch, linked):
    """As a link, or where there can be none as a copy; neither replaces what is there."""
    if not linked:

        def refuse(source, target):
            raise OSError(18, "Invalid cross-device link")

        monkeypatch.setattr(os, "link", refuse)
    source, target = tmp_path / "a.png", tmp_path / "shared" / "b.png"
    source.write_bytes(b"frame")
    share_file(source, target)
    assert target.read_bytes() == b"frame"
    assert target.samefile(source) == linked
    assert os.listdir(tmp_path / "shared") == ["b.png"]
    other = tmp_path / "c.png"
    other.write_bytes(b"another")
    share_file(source, other)
    assert other.read_bytes() == b"another"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no /dev/full")
def test_a_full_disk_names_the_file_that_it_has_no_room_for(tmp_path):
    with (
        pytest.raises(OSError, match=r"No space left on device: '.*a\.json'"),
        atomic_path(tmp_path / "a.json"),
        open("/dev/full", "w") as full,
    ):
        full.write("{}")
    assert list(tmp_path.iterdir()) == []
