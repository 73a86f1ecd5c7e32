"""What was computed once is kept, whole, and no more of it than there is room for."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from salframe.framework.errors import ConfigError
from salframe.framework.files.cache import Cache

ARRAYS = {"points": np.arange(12.0).reshape(4, 3), "labels": np.array(["bed", "lamp"])}


def entry(cache: Cache):
    (path,) = cache.directory.rglob("*.npz")
    return path


def test_what_was_put_is_got(tmp_path):
    cache = Cache(tmp_path)
    assert cache.get({"frame": 1}) is None
    cache.put({"frame": 1}, ARRAYS, 2.5)
    arrays, seconds = cache.get({"frame": 1})
    assert seconds == 2.5
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(arrays[name], array)


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:-1],
        lambda content: b"",
        lambda content: content + b"\0",
        lambda content: content[:100] + bytes([content[100] ^ 1]) + content[101:],
        lambda content: content[::-1],
    ],
)
def test_a_damaged_entry_is_computed_again_and_replaced(tmp_path, damage):
    cache = Cache(tmp_path)
    cache.put("key", ARRAYS, 1.0)
    whole = entry(cache).read_bytes()
    entry(cache).write_bytes(damage(whole))
    assert cache.get("key") is None
    cache.put("key", ARRAYS, 1.0)
    np.testing.assert_array_equal(cache.get("key")[0]["points"], ARRAYS["points"])


def test_an_entry_under_another_key_is_not_believed(tmp_path):
    """A renamed entry is what a collision of hashes would give."""
    cache = Cache(tmp_path)
    cache.put({"frame": 1}, ARRAYS, 1.0)
    renamed = cache._path({"frame": 2})
    renamed.parent.mkdir(exist_ok=True)
    renamed.write_bytes(entry(cache).read_bytes())
    assert cache.get({"frame": 2}) is None
    cache.put({"frame": 2}, {"points": np.ones(3)}, 1.0)
    np.testing.assert_array_equal(cache.get({"frame": 2})[0]["points"], np.ones(3))
    np.testing.assert_array_equal(cache.get({"frame": 1})[0]["points"], ARRAYS["points"])


@pytest.mark.slow
def test_3000_damaged_entries_raise_nothing(tmp_path):
    rng = np.random.default_rng(int(os.environ.get("SALFRAME_TEST_SEEDS", "0").split(",")[0]))
    cache = Cache(tmp_path)
    cache.put("key", ARRAYS, 1.0)
    whole, raised, believed = entry(cache).read_bytes(), 0, 0
    for _ in range(3000):
        content = bytearray(whole)
        if rng.random() < 0.5:
            for at in rng.integers(len(content), size=rng.integers(1, 9)):
                content[at] ^= 1 << rng.integers(8)
        else:
            del content[rng.integers(len(content)) :]
        entry(cache).write_bytes(content)
        try:
            found = cache.get("key")
        except Exception:
            raised += 1
        else:
            believed += found is not None and bytes(content) != whole
    print(f"3000 damaged entries: {raised} raised, {believed} believed")
    assert (raised, believed) == (0, 0)


def test_the_least_recently_used_go_first(tmp_path):
    cache = Cache(tmp_path)
    for number in range(4):
        cache.put(number, ARRAYS, 1.0)
        os.utime(cache._path(number), (number, number))
    size = cache.state().size_bytes // 4
    assert cache.get(0) is not None  # used now, so later than 1, 2 and 3
    full = Cache(tmp_path, limit_bytes=4 * size)
    full.put(4, ARRAYS, 1.0)
    assert [number for number in range(5) if full.get(number) is not None] == [0, 3, 4]
    assert full.state().size_bytes <= 4 * size


def test_entries_of_another_user_stay_and_cost_nothing(tmp_path, monkeypatch):
    """Two users share a folder with the sticky bit: nobody removes the entries of the other."""
    cache = Cache(tmp_path, limit_bytes=2000)
    cache.put({"user": "other"}, ARRAYS, 1.0)
    foreign, unlink = entry(cache), Path.unlink

    def refuse(path, missing_ok=False):
        if path == foreign:
            raise PermissionError(1, "Operation not permitted", str(path))
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", refuse)
    for number in range(9):
        cache.put({"frame": number}, ARRAYS, 1.0)
    assert cache.get({"user": "other"}) is not None
    assert cache.state().size_bytes <= 2000 + foreign.stat().st_size
    cache.clear()
    assert cache.state().entries == 1


def test_the_limit_is_set_by_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE_GB", "0.5")
    assert Cache(tmp_path).limit_bytes == 500_000_000
    for text in ("much", "nan", "-1", "inf"):
        monkeypatch.setenv("SALFRAME_CACHE_GB", text)
        with pytest.raises(ConfigError, match=f"SALFRAME_CACHE_GB is '{text}', expected a number of gigabytes"):
            Cache(tmp_path)


def test_the_command_tells_and_clears(tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    Cache().put("key", ARRAYS, 1.0)
    told = run("cache", "info", "--json").json
    assert (told["entries"], told["size_bytes"]) == (1, entry(Cache()).stat().st_size)
    assert "1 entries" in run("cache", "info").out
    assert "removed 1 entries" in run("cache", "clear").out
    assert run("cache", "info", "--json").json["entries"] == 0
