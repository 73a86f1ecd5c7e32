"""A map that changes while it is served."""

from __future__ import annotations

import shutil
import threading
import time

import httpx
import pytest

from salframe.framework.errors import DataError
from salframe.serving.served_map import MapHolder
from salframe.testing.rooms import ROOMS
from serving.rooms_service import build, detections, serving

BODY = {"detections": detections(ROOMS[0])}


def wait_for(condition, seconds: float = 60.0) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_changed_map_is_opened_without_dropping_a_request(tmp_path):
    folder = build(tmp_path / "a.map")
    answers, stop = [], threading.Event()
    with serving(folder) as running:

        def ask() -> None:
            with httpx.Client(base_url=running.url, timeout=60) as client:
                while not stop.is_set():
                    response = client.post("/localize", json=BODY)
                    answers.append((response.status_code, response.json()["places"][0]["place"]))

        threads = [threading.Thread(target=ask) for _ in range(3)]
        for thread in threads:
            thread.start()
        wait_for(lambda: len(answers) > 20)
        version = running.client.get("/map").headers["etag"]
        build(folder, names={"bedroom": "boudoir"})
        wait_for(lambda: running.maps.num_reloads == 1)
        count = len(answers)
        wait_for(lambda: len(answers) > count + 20)
        stop.set()
        for thread in threads:
            thread.join()
        assert {status for status, _ in answers} == {200}
        assert {place for _, place in answers} == {"bedroom", "boudoir"}
        assert answers[0][1] == "bedroom"
        assert answers[-1][1] == "boudoir"
        assert running.client.get("/map").headers["etag"] != version
        assert "salframe_map_reloads 1.0" in running.client.get("/metrics").text


def test_a_broken_map_leaves_the_previous_version(tmp_path):
    folder = build(tmp_path / "a.map")
    with serving(folder) as running:
        assert running.client.get("/health").json()["status"] == "ok"
        content = (folder / "map.json").read_bytes()
        (folder / "map.json").write_bytes(content[: len(content) // 2])
        wait_for(lambda: running.client.get("/health").json()["status"] == "stale")
        answer = running.client.post("/localize", json=BODY).raise_for_status().json()
        assert answer["places"][0]["place"] == "bedroom"
        shutil.rmtree(folder)
        answer = running.client.post("/localize", json=BODY).raise_for_status().json()
        assert answer["places"][0]["place"] == "bedroom"
        build(folder)
        wait_for(lambda: running.client.get("/health").json()["status"] == "ok")
        assert running.maps.num_reloads == 1


def test_a_folder_without_a_map_is_refused(tmp_path):
    with pytest.raises(DataError, match="contains no map"):
        MapHolder(tmp_path)


def test_a_map_without_topology_has_no_routes(tmp_path):
    with serving(build(tmp_path / "a.map", topology=False)) as running:
        refused = running.client.post("/route", json={"start": {"place": "bedroom"}, "goal": {"place": "kitchen"}})
        assert refused.status_code == 409
        assert refused.json()["detail"].startswith("the map has no topology")
        layers = {f["properties"]["layer"] for f in running.client.get("/map").json()["features"]}
        assert layers == {"place", "object"}
