"""ServiceLimits, malformed requests and errors: each costs only its own answer."""

from __future__ import annotations

import concurrent.futures
import io
import json
import socket
import struct
import time
import zlib

import httpx
import numpy as np
import pytest

from salframe.testing.rooms import ROOMS
from serving.rooms_service import TRUTHS, detections, png, serving, upload


def check_problem(response: httpx.Response) -> str:
    """The detail of an error, which is one sentence without a path of the host."""
    assert 400 <= response.status_code < 500 or response.status_code == 503, response.text
    assert response.headers["content-type"] == "application/problem+json"
    problem = response.json()
    assert set(problem) == {"type", "title", "status", "detail"}
    assert problem["status"] == response.status_code
    assert "\n" not in problem["detail"]
    for path in ("/tmp", "/work", "/home", "salframe-", "Traceback", ".py"):
        assert path not in problem["detail"]
    return problem["detail"]


def check_right(running) -> None:
    """The next good query is localized."""
    answer = running.client.post("/localize", json={"detections": detections(ROOMS[0])}).json()
    assert answer["places"][0]["place"] == "bedroom"


def bomb(width: int, height: int) -> bytes:
    """A PNG of few bytes whose header declares many pixels."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")
    )


GOOD = {name: (part[0], part[1].getvalue(), part[2]) for name, part in upload("bedroom").items()}
IMAGE = GOOD["image"][1]
THING = {"label": "bed", "centroid_m": [1, 1, 0], "size_m": [1, 1, 1]}
NOT_JSON = [
    b"",
    b"{",
    b"[",
    b"\xff\xfe",
    b'{"detections": NaN}',
    b"[" * 100_000,
    b'{"a": 1' + b"0" * 5000 + b"}",
    b"nul",
]
WRONG_JSON = [
    *([], {}, None, 1, "x", {"detections": None}, {"detections": {}}, {"detections": [1]}, {"detections": [{}]}),
    {"detections": [{**THING, "label": ""}]},
    {"detections": [{**THING, "label": 5}]},
    {"detections": [{**THING, "label": "x" * 1000}]},
    {"detections": [{**THING, "score": 2}]},
    {"detections": [{**THING, "score": "high"}]},
    {"detections": [{**THING, "centroid_m": [1, 1]}]},
    {"detections": [{**THING, "centroid_m": [1, 1, 1e300]}]},
    {"detections": [{**THING, "size_m": [1, 1, -1]}]},
    {"detections": [{**THING, "size_m": None}]},
    {"detections": [{**THING, "azimuth_deg": 3, "elevation_deg": 3}]},
    {"detections": [{"label": "bed", "azimuth_deg": 3}]},
    {"detections": [{**THING, "path": "/etc/passwd"}]},
    {"detections": [], "picture": "../../etc/passwd"},
]
WRONG_FILES = [
    {"image": ("x.png", b"", "image/png")},
    {"image": ("x.png", b"text", "image/png")},
    {"image": ("../../../etc/passwd", IMAGE[:50], "image/png")},
    {"image": ("x.png", IMAGE[: len(IMAGE) // 2], "image/png")},
    {"image": ("x.gif", b"GIF89a" + bytes(50), "image/gif")},
    {"image": ("x.svg", b"<svg onload='alert(1)'/>", "image/svg+xml")},
    {"image": ("x.png", png(np.zeros((30, 50, 3), np.uint8)), "image/png")},
    {"image": GOOD["image"]},  # the detector needs range
    {"range": GOOD["range"]},
    {"range": GOOD["image"], "image": GOOD["image"]},
    {"image": GOOD["image"], "range": ("b.png", png(np.zeros((10, 20), np.uint16)), "image/png")},
    {"image": ("bomb.png", bomb(30000, 15000), "image/png")},
    {"image": ("bomb.png", bomb(200_000, 100_000), "image/png")},
    {"other": GOOD["image"]},
]
WRONG_FIELDS = [
    *({"range_unit_m": value} for value in ("0", "-1", "x", "1e999", "nan", "")),
    *({"range_kind": value} for value in ("z", "x", "")),
    *({"range_missing": value} for value in ("5", "[-1]", '["a"]', "[", "[1.5]", str([1] * 1000))),
    *({"fov_deg": value} for value in ("0", "900", "x", "-5")),
    *({"camera": value} for value in ("{}", "[]", "x", '{"width": 1}', "/etc/passwd")),
    {"fov_deg": "90", "camera": "{}"},
    {"unknown": "1"},
    {"image": "text"},
    {"range_unit_m": "x" * 100_000},
]


def test_malformed_requests_get_one_sentence(service):
    """About 80 kinds of malformed requests, each in several places."""
    num_requests = 0
    session = service.client.post("/sessions").json()["id"]
    targets = ("/localize", "/route", f"/sessions/{session}/observations")
    for target in targets:
        for content in NOT_JSON:
            headers = {"Content-Type": "application/json"}
            detail = check_problem(service.client.post(target, content=content, headers=headers))
            assert len(detail) < 700
            num_requests += 1
        for body in WRONG_JSON:
            check_problem(service.client.post(target, json=body))
            num_requests += 1
        for kind in ("text/plain", "application/xml", "", "multipart/form-data", "application/x-www-form-urlencoded"):
            check_problem(service.client.post(target, content=b"x=1", headers={"Content-Type": kind}))
            num_requests += 1
    for target in (targets[0], targets[2]):
        for files in WRONG_FILES:
            check_problem(service.client.post(target, files=files, data={"t_s": "1"} if "sessions" in target else {}))
            num_requests += 1
        for fields in WRONG_FIELDS:
            files = {} if "image" in fields else GOOD
            data = {**fields, **({"t_s": "1"} if "sessions" in target else {})}
            check_problem(service.client.post(target, files=files or None, data=data))
            num_requests += 1
    for time_s in ("", "x", "nan", "inf", "1e300"):
        check_problem(service.client.post(targets[2], files=GOOD, data={"t_s": time_s}))
    for motion in ("{}", '{"x_m": 1e9}', '{"x_m": "a"}', "[]", "x"):
        check_problem(service.client.post(targets[2], files=GOOD, data={"t_s": "1", "odometry": motion}))
    for path in ("/none", "/localize/x", "/sessions", "/map", "/page/none.js", "/%00", "/page/%2e%2e/app.py", "//map"):
        check_problem(service.client.request("PUT", path))
        num_requests += 1
    for path in ("/..%2f..%2fetc/passwd", "/page/..%2f..%2fapp.py", "/sessions/..%2f..", "/page/%2e%2e/%2e%2e/app.py"):
        check_problem(service.client.get(path))
        num_requests += 1
    assert num_requests > 170
    assert service.client.get(f"/sessions/{session}").json()["observations"] == 0
    check_right(service)


def raw(port: int, content: bytes, *, wait_s: float = 20) -> bytes:
    """Send bytes on a connection, and return what comes back until it closes."""
    with socket.create_connection(("127.0.0.1", port), timeout=wait_s) as connection:
        connection.sendall(content)
        received = b""
        while chunk := connection.recv(65536):
            received += chunk
        return received


def test_requests_that_are_no_http(service):
    for content in (
        b"\x00\x01\x02\r\n\r\n",
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00",
    ):
        answer = raw(service.port, content + b"\r\n\r\n")
        assert b" 40" in answer.partition(b"\r\n")[0]
    headers = b"".join(b"X-%d: %s\r\n" % (i, b"a" * 1000) for i in range(100))
    assert b" 400 " in raw(service.port, b"GET / HTTP/1.1\r\nHost: localhost\r\n" + headers)
    check_right(service)


@pytest.fixture
def small(rooms_map):
    """A service with small limits."""
    limits = {"headers_s": 0.5, "body_s": 0.5, "max_body_bytes": 200_000, "max_json_bytes": 20_000}
    with serving(rooms_map, max_sessions=3, max_objects=50, max_pixels=100_000, idle_s=4.0, **limits) as running:
        yield running


def test_large_bodies_are_refused(small):
    assert small.client.post("/localize", json={"x": "a" * 30_000}).status_code == 413
    declared = small.client.post("/localize", files={"image": ("a.png", bytes(300_000), "image/png")})
    assert declared.status_code == 413
    assert "200000" in check_problem(declared)

    def chunks():
        for _ in range(100):
            yield bytes(10_000)

    headers = {"Content-Type": "multipart/form-data; boundary=x"}
    assert small.client.post("/localize", content=chunks(), headers=headers).status_code in (400, 413)
    detail = check_problem(small.client.post("/localize", json={"detections": [THING] * 60}))
    assert "60 detections, expected at most 50" in detail
    image = {"image": ("a.png", png(np.zeros((300, 600, 3), np.uint8)), "image/png")}
    assert "600 x 300" in check_problem(small.client.post("/localize", files=image))
    packed = small.client.post("/localize", content=b"x", headers={"Content-Encoding": "gzip"})
    assert packed.status_code == 415
    check_right(small)


def test_slow_senders_are_cut_off(small, caplog):
    head = (
        b"POST /localize HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 5000\r\n\r\n{"
    )
    start = time.monotonic()
    answer = raw(small.port, head)
    assert b" 408 " in answer.partition(b"\r\n")[0]
    assert b"did not arrive within the time limit of 0.5 s" in answer
    assert raw(small.port, b"GET / HTTP/1.1\r\nHost: loc") == b""
    assert raw(small.port, b"") == b""
    assert time.monotonic() - start < 15
    with socket.create_connection(("127.0.0.1", small.port)) as half:
        half.sendall(head)
    check_right(small)
    assert "Traceback" not in caplog.text


def test_sessions_are_limited_and_end_when_idle(small):
    ids = [small.client.post("/sessions").json()["id"] for _ in range(3)]
    refused = [small.client.post("/sessions") for _ in range(50)]
    assert {response.status_code for response in refused} == {503}
    assert int(refused[0].headers["retry-after"]) >= 1
    check_problem(refused[0])
    time.sleep(4.2)
    assert small.client.get(f"/sessions/{ids[0]}").status_code == 404
    assert small.client.post("/sessions").status_code == 201


def test_a_full_queue_answers_503(rooms_map, monkeypatch):
    from salframe.serving import app

    real = app.localize_view

    def slow(*arguments, **named):
        time.sleep(0.4)
        return real(*arguments, **named)

    monkeypatch.setattr(app, "localize_view", slow)
    body = json.dumps({"detections": detections(ROOMS[0])}).encode()
    with serving(rooms_map, max_queue=2) as running, concurrent.futures.ThreadPoolExecutor(12) as threads:

        def post(_: int) -> httpx.Response:
            return httpx.post(
                f"{running.url}/localize", content=body, headers={"Content-Type": "application/json"}, timeout=30
            )

        responses = list(threads.map(post, range(12)))
        statuses = [response.status_code for response in responses]
        assert statuses.count(200) >= 4  # two work, two wait
        assert statuses.count(503) >= 4
        assert statuses.count(200) + statuses.count(503) == 12
        for response in responses:
            if response.status_code == 503:
                assert int(response.headers["retry-after"]) >= 1
                check_problem(response)
        check_right(running)


def test_a_request_that_takes_too_long_answers_503(rooms_map, monkeypatch):
    from salframe.serving import app

    real = app.localize_view
    monkeypatch.setattr(app, "localize_view", lambda *a, **k: (time.sleep(1.5), real(*a, **k))[1])
    with serving(rooms_map, work_s=0.3) as running:
        start = time.monotonic()
        slow = running.client.post("/localize", json={"detections": []})
        assert time.monotonic() - start < 1.2
        assert slow.status_code == 503
        assert "longer than 0.3 s" in check_problem(slow)
        monkeypatch.setattr(app, "localize_view", real)
        time.sleep(1.5)
        check_right(running)


def test_an_unexpected_error_shows_nothing_of_the_host(rooms_map, monkeypatch, caplog):
    """The connection remains open for the next request, and the log has the error once."""
    from salframe.serving import app

    def broken(*arguments, **named):
        raise RuntimeError("secret of /home/user/file.txt")

    with serving(rooms_map) as running:
        with monkeypatch.context() as patch:
            patch.setattr(app, "localize_view", broken)
            failed = running.client.post("/localize", json={"detections": []})
        assert failed.status_code == 500
        assert "secret" not in failed.text
        assert failed.json()["status"] == 500
        check_right(running)
    assert caplog.text.count("RuntimeError: secret") == 1


def test_names_of_files_and_labels_have_no_effect(service):
    """Names of uploads are not used, and labels come back as they were sent."""
    image, steps = GOOD["image"], GOOD["range"]
    files = {"image": ("../../evil/\x00<script>.png", image[1], "text/html"), "range": ("/etc/shadow", *steps[1:])}
    answer = service.client.post("/localize", files=files).raise_for_status().json()
    assert answer["places"][0]["place"] == "bedroom"
    label = "<img src=x onerror=alert(1)>"
    body = {"detections": [*detections(ROOMS[0]), {**THING, "label": label}]}
    answer = service.client.post("/localize?objects=true", json=body)
    assert answer.headers["content-type"] == "application/json"
    assert label in [thing["label"] for thing in answer.json()["objects"]]


def test_photographs_have_a_camera(service):
    """A photograph of the panorama's front, 90 degrees wide, with its depth along the optical axis."""
    from salframe.panoramas.camera import Camera
    from salframe.panoramas.photograph import see_panorama
    from serving.rooms_service import QUERIES

    panorama = QUERIES["lounge"].load()
    camera = Camera.of_field_of_view(240, 180, 120)
    rgb = see_panorama(camera, panorama.rgb)
    depth_m = see_panorama(camera, panorama.range_m) * camera.rays()[..., 0]
    files = {
        "image": ("a.png", io.BytesIO(png(rgb)), "image/png"),
        "range": ("b.png", io.BytesIO(png(np.round(depth_m * 1000).astype(np.uint16))), "image/png"),
    }
    answer = service.client.post("/localize?objects=true", files=files, data={"fov_deg": "120"}).raise_for_status()
    content = answer.json()
    assert content["places"][0]["place"] == "lounge"
    for thing in content["objects"]:
        assert abs(thing["azimuth_deg"]) < 75
    mounted = {
        "width": 240,
        "height": 180,
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "distortion_model": "none",
        "distortion": [],
        "T_base_camera": [[0, 0, 1, 0.5], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]],
    }
    files = {name: (part[0], part[1].getvalue(), part[2]) for name, part in files.items()}
    on_robot = service.client.post("/localize", files=files, data={"camera": json.dumps(mounted)}).json()
    if content["pose"] is not None:  # the base is half a metre behind the camera
        yaw = np.radians(content["pose"]["yaw_deg"])
        assert on_robot["pose"]["x_m"] == pytest.approx(content["pose"]["x_m"] - 0.5 * np.cos(yaw), abs=1e-6)
        truth = TRUTHS["lounge"].T_world_pano[:2, 3]
        assert np.hypot(*(np.array([content["pose"]["x_m"], content["pose"]["y_m"]]) - truth)) < 0.3


def test_uploads_are_limited(rooms_map):
    """A client that sends its image slowly takes the only place for uploads; JSON is still answered."""
    head = "POST /localize HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; boundary=x\r\n"
    with serving(rooms_map, max_uploads=1) as running:
        with socket.create_connection(("127.0.0.1", running.port)) as slow:
            slow.sendall(f"{head}Content-Length: 9999\r\n\r\n--x\r\n".encode())
            end = time.monotonic() + 30
            while (refused := running.client.post("/localize", files=GOOD)).status_code == 200:
                assert time.monotonic() < end
            assert refused.status_code == 503
            assert refused.headers["retry-after"] == "1"
            check_problem(refused)
            check_right(running)
        while running.client.post("/localize", files=GOOD).status_code != 200:
            assert time.monotonic() < end
