"""Processes that meet: in one run folder, one cache, one data set, at one server; and what they may not write to."""

from __future__ import annotations

import contextlib
import http.server
import os
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from loopback import serving
from sites import INLINE, ROOMS, Site, SiteResult
from small_plugin import NUMBERS, SMALL_WEIGHTS

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="it forks")
COMPARE = ("compare", "--methods", "reader", *ROOMS, *INLINE)
FETCH = ("weights", "fetch", "small")


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Site:
    return Site(tmp_path_factory.mktemp("at-once"))


def both(site: Site, place: Path, *commands: tuple[str, ...], **environment: str) -> list[SiteResult | None]:
    """What commands say that begin at once in a folder."""
    children = [site.begin(words, place, **environment) for words in commands]
    return [site.end(child) for child in children]


def test_a_run_that_another_process_has_in_hand_is_left_to_it(site):
    place = site.fresh()
    slow = (*COMPARE, "--set", "sleep_s=0.3")
    first = site.begin(slow, place)
    while not any(path.stat().st_size for path in place.glob("runs/*/methods/reader/rows.jsonl")):
        time.sleep(0.01)
    second = site.call(slow, place)
    assert second.code == 2
    message = (
        r"error: another process writes to the folder runs/rooms-\w+: wait until that process ends, "
        r"or give the run another --name\n"
    )
    assert re.fullmatch(message, second.err), second.err
    result = site.end(first)
    assert (result.code, result.json["rows"][0]["accuracy"]) == (0, 1.0)
    assert site.call(slow, place).content == result.content


def test_two_runs_share_a_cache_that_has_room_for_next_to_nothing(site):
    alone = site.call(COMPARE, site.fresh()).json["rows"][0]
    for limit_gb in ("20", "0.000001"):
        results = both(site, site.fresh(), *((*COMPARE, "--name", name) for name in "ab"), SALFRAME_CACHE_GB=limit_gb)
        assert [(result.code, result.json["rows"][0]["accuracy"]) for result in results] == [(0, alone["accuracy"])] * 2


def test_two_processes_render_one_data_set(site):
    place = site.fresh()
    first, second = both(site, place, *[("data", "render", "small")] * 2)
    assert (first.code, first.out) == (second.code, second.out) == (0, first.out)
    assert len(list(place.glob("cache/small/*/frames/*.range.png"))) == 8


@pytest.mark.parametrize("cache", ["/dev/null/cache", "read-only"])
def test_a_cache_that_cannot_be_written_to_costs_no_answer(site, cache):
    place = site.fresh()
    assert site.call(COMPARE, place, SALFRAME_CACHE=cache).json["rows"][0]["accuracy"] == 1.0
    if cache == "read-only" and os.geteuid():
        (place / cache).chmod(0o500)
        assert site.call((*COMPARE, "--name", "b"), place, SALFRAME_CACHE=cache).code == 0


@pytest.fixture
def server() -> Iterator[str]:
    """A slow server on this machine: /whole gives the weights, /cut the half of them, /other as many other bytes."""

    class Answers(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            content = NUMBERS[::-1] if self.path.startswith("/other") else NUMBERS
            self.send_response(200)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            with contextlib.suppress(OSError):
                self.wfile.write(content[: len(content) // 2])
                time.sleep(0.2)
                self.wfile.write(b"" if self.path.startswith("/cut") else content[len(content) // 2 :])

        def log_message(self, *_: object) -> None:
            pass

    with serving(Answers) as address:
        yield address


def test_two_processes_fetch_weights_at_once(site, server):
    place = site.fresh()
    first, second = both(site, place, FETCH, FETCH, **{SMALL_WEIGHTS: f"{server}/whole"})
    assert (first.code, second.code, first.out) == (0, 0, second.out)
    assert Path(first.out.strip()).read_bytes() == NUMBERS
    assert [path.name for path in (place / "cache" / "weights" / "small").iterdir()] == ["small.bin"]


@pytest.mark.parametrize(
    ("path", "message"),
    [("cut", r"ended after 524288 of 1048576 bytes"), ("other", r"has the sha256 hash \w{64}, expected \w{64}")],
)
def test_weights_that_did_not_come_whole_are_one_line(site, server, path, message):
    place = site.fresh()
    result = site.call(FETCH, place, **{SMALL_WEIGHTS: f"{server}/{path}"})
    assert result.code == 2
    assert re.fullmatch(rf"small: MIT\nerror: .*{message}.*\n", result.err), result.err
    assert list((place / "cache" / "weights" / "small").iterdir()) == []


def test_weights_for_a_folder_that_cannot_be_written_to_are_one_line(site):
    result = site.call(FETCH, site.fresh(), SALFRAME_CACHE="/dev/null/cache")
    assert (result.code, result.out) == (2, "")
    assert re.fullmatch(r"small: MIT\nerror: cannot use /dev/null/cache.*: Not a directory\n", result.err), result.err
