"""Measure the service: overhead, time under load, lost requests, malformed requests, and memory.

    python tests/benchmarks/serving.py [--data house-42] [--folder FOLDER] [--requests 1000] [--memory-requests 20000]
        [--clients 8] [--output FILE.json]

The map is built with the detector panoseg in FOLDER, if it is not there. The queries are those of the dataset: as
panoramas with range (JPEG and 16-bit PNG), and as the detections of panoseg in them (JSON). The overhead of a request
is its time at the client without the field `seconds` of its answer. Run it on an idle machine.
"""

from __future__ import annotations

import argparse
import json
import re
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import psutil

from salframe.framework.components.registry import registry
from salframe.panoramas.images import write_color, write_range
from salframe.panoramas.opening import find_dataset
from salframe.topology.building_map import build_map

NUM_QUERIES = 32
"""Number of different queries."""
NUM_MALFORMED = 300
MAX_OBJECTS = 32
"""Maximum number of detections of a query, about 4 kB."""
SETTLE = 500
"""Number of requests before the memory is measured first."""


@dataclass(frozen=True)
class Call:
    """A request: its body, the type of the body, and the true place; None where it is malformed."""

    body: bytes
    content_type: str
    place: str | None
    path: str = "/localize"
    method: str = "POST"


def make_queries(data: str) -> tuple[list[Call], list[Call]]:
    """Return queries as detections, and the same queries as panoramas."""
    dataset = find_dataset(data)
    (fold,) = dataset.folds()
    frames = fold.queries[:: max(1, len(fold.queries) // NUM_QUERIES)][:NUM_QUERIES]
    detector = registry().build("detector", registry().get("detector", "panoseg").Config(kind="panoseg"))
    detections, panoramas = [], []
    with TemporaryDirectory() as folder:
        for frame in frames:
            panorama, place = frame.load(), dataset.truth(frame.id).place
            found = detector.detect(panorama)
            order = np.argsort(-found.scores)[:MAX_OBJECTS]
            objects = [
                {
                    "label": found.labels[i],
                    "score": round(float(found.scores[i]), 3),
                    "centroid_m": found.centroid_m[i].round(3).tolist(),
                    "size_m": found.size_m[i].round(3).tolist(),
                    "yaw_deg": round(float(np.degrees(found.yaw_rad[i])), 1),
                }
                for i in order
                if np.isfinite(found.centroid_m[i]).all()
            ]
            detections.append(Call(json.dumps({"detections": objects}).encode(), "application/json", place))
            image, range_image = Path(folder) / "a.jpg", Path(folder) / "a.png"
            write_color(image, panorama.rgb)
            write_range(range_image, panorama.range_m)
            panoramas.append(form({"image": image.read_bytes(), "range": range_image.read_bytes()}, {}, place))
    return detections, panoramas


def form(files: dict[str, bytes], fields: dict[str, str], place: str | None) -> Call:
    """Return a multipart request."""
    parts = [
        f'--x\r\nContent-Disposition: form-data; name="{name}"; filename="{name}"\r\n\r\n'.encode() + content + b"\r\n"
        for name, content in files.items()
    ]
    parts += [
        f'--x\r\nContent-Disposition: form-data; name="{name}"\r\n\r\n{value}\r\n'.encode()
        for name, value in fields.items()
    ]
    return Call(b"".join(parts) + b"--x--\r\n", "multipart/form-data; boundary=x", place)


def malformed(good: Call, panorama: Call) -> list[Call]:
    """Return NUM_MALFORMED malformed requests of many kinds: half bodies, types, values, bombs, paths."""
    rng = np.random.default_rng(0)
    calls = [
        *(Call(good.body, kind, None) for kind in ("text/plain", "", "application/xml", "multipart/form-data")),
        *(Call(b"[" * n, "application/json", None) for n in (1, 1000, 900_000)),
        Call(b"x" * 2_000_000, "application/json", None),
        *(Call(b"", "", None, path, "GET") for path in ("/none", "/page/..%2f..%2fetc/passwd", "/sessions/x")),
        Call(b"", "", None, "/localize", "DELETE"),
        form({"image": b"\x89PNG\r\n\x1a\n" + bytes(100)}, {}, None),
        form({"image": b"GIF89a"}, {}, None),
        form({"image": b"x"}, {"range_unit_m": "-1"}, None),
        form({"image": b"x"}, {"camera": "{}"}, None),
        form({"other": b"x"}, {}, None),
    ]
    while len(calls) < NUM_MALFORMED:
        body = bytearray(good.body)
        if len(calls) % 3 == 0:  # a panorama that was cut
            cut = int(rng.integers(200, len(panorama.body) // 2))
            calls.append(Call(panorama.body[:cut], panorama.content_type, None))
        elif len(calls) % 3 == 1:  # JSON that was cut
            calls.append(Call(bytes(body[: int(rng.integers(1, len(body) - 2))]), good.content_type, None))
        else:  # a number that is none
            text = good.body.decode().replace(
                '"score": ', f'"score": {rng.choice(["NaN", "-", "9", "null", "[]"])}, "x": '
            )
            calls.append(Call(text.encode(), good.content_type, None))
    return calls


@contextmanager
def service(folder: Path) -> Iterator[tuple[int, psutil.Process]]:
    """Yield the port and the process of `salframe serve`."""
    command = [sys.executable, "-c", "from salframe.cli import main; main()", "serve", str(folder), "--port", "0"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        lines = ""
        while (match := re.search(r"serving .* at http://127.0.0.1:(\d+)", lines)) is None:
            line = process.stderr.readline()
            if not line:
                sys.exit(f"the service did not start: {lines}")
            lines += line
        yield int(match[1]), psutil.Process(process.pid)
    finally:
        process.terminate()
        process.wait(60)


def send(connection: HTTPConnection, call: Call) -> tuple[int, bytes, float]:
    """Return status, body and time in seconds of a request."""
    start = time.perf_counter()
    connection.request(call.method, call.path, call.body, {"Content-Type": call.content_type})
    response = connection.getresponse()
    content = response.read()
    return response.status, content, time.perf_counter() - start


def load(port: int, calls: Sequence[Call], total: int, num_clients: int) -> dict[str, Any]:
    """Send requests by several clients at a time, and return statuses, times and the share of right places."""
    numbers, lock = count(), threading.Lock()
    statuses: Counter[str] = Counter()
    seconds: list[float] = []
    right: list[bool] = []

    def work() -> None:
        connection = HTTPConnection("127.0.0.1", port, timeout=120)
        while (number := next(numbers)) < total:
            call = calls[number % len(calls)]
            try:
                status, content, time_s = send(connection, call)
            except OSError as error:
                connection.close()
                with lock:
                    statuses[type(error).__name__] += 1
                continue
            places = json.loads(content).get("places") if status == 200 else None
            with lock:
                statuses[str(status)] += 1
                seconds.append(time_s)
                right.append(bool(places) and places[0]["place"] == call.place)

    threads = [threading.Thread(target=work) for _ in range(num_clients)]
    start = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wall_s = time.perf_counter() - start
    p50, p95, p99 = np.percentile(seconds, (50, 95, 99)) * 1e3
    return {
        "requests": total,
        "statuses": dict(statuses),
        "p50_ms": p50,
        "p95_ms": p95,
        "p99_ms": p99,
        "requests_per_s": total / wall_s,
        "right_place": float(np.mean(right)),
    }


def measure_overhead(port: int, calls: Sequence[Call], total: int) -> dict[str, Any]:
    """Send requests one at a time, and return the time at the client, the time of the method and their difference."""
    connection = HTTPConnection("127.0.0.1", port, timeout=120)
    rows = []
    for number in range(total):
        status, content, time_s = send(connection, calls[number % len(calls)])
        assert status == 200, content
        rows.append((time_s, json.loads(content)["seconds"]))
    client_ms, method_ms = np.array(rows).T * 1e3
    overhead_ms = client_ms - method_ms
    return {
        "requests": total,
        "body_bytes": float(np.mean([len(call.body) for call in calls])),
        "client_p50_ms": float(np.median(client_ms)),
        "method_p50_ms": float(np.median(method_ms)),
        "overhead_p50_ms": float(np.median(overhead_ms)),
        "overhead_p95_ms": float(np.percentile(overhead_ms, 95)),
    }


def measure_malformed(port: int, good: Call, panorama: Call) -> dict[str, Any]:
    """Send malformed requests, many sessions, and half and slow requests. Each must receive an error in one line, and
    the good request after it the right answer."""
    statuses: Counter[int] = Counter()
    wrong, not_localized = [], 0
    connection = HTTPConnection("127.0.0.1", port, timeout=120)
    expected = json.loads(send(connection, good)[1])["places"][0]
    calls = malformed(good, panorama)
    for call in calls:
        status, content, _ = send(connection, call)
        statuses[status] += 1
        if not (400 <= status < 500 or status == 503) or b"\n" in content or b"Traceback" in content:
            wrong.append((status, content[:200].decode("utf-8", "replace")))
        not_localized += json.loads(send(connection, good)[1])["places"][0] != expected
    halves = []
    for number in range(50):  # clients that stop in the middle of a request
        half = socket.create_connection(("127.0.0.1", port))
        half.sendall(f"POST /localize HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9{number}\r\n".encode())
        halves.append(half)
    not_localized += json.loads(send(connection, good)[1])["places"][0] != expected
    for half in halves:
        half.close()
    sessions = Counter(send(connection, Call(b"", "", None, "/sessions"))[0] for _ in range(10_000))
    not_localized += json.loads(send(connection, good)[1])["places"][0] != expected
    return {
        "malformed": len(calls),
        "statuses": dict(statuses),
        "wrong": wrong,
        "sessions": dict(sessions),
        "good_requests_with_another_answer": not_localized,
    }


def measure_memory(
    port: int, process: psutil.Process, calls: Sequence[Call], total: int, num_clients: int
) -> dict[str, Any]:
    """Return the memory of the service before and after many requests."""
    load(port, calls, SETTLE, num_clients)
    before = process.memory_info().rss
    result = load(port, calls, total, num_clients)
    after = process.memory_info().rss
    return {
        "requests": total,
        "statuses": result["statuses"],
        "before_mb": before / 1e6,
        "after_mb": after / 1e6,
        "requests_per_s": result["requests_per_s"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="house-42", help="dataset")
    parser.add_argument("--folder", type=Path, default=Path("build/serving"), help="folder of the map")
    parser.add_argument("--requests", type=int, default=1000)
    parser.add_argument("--memory-requests", type=int, default=20_000)
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--output", type=Path, help="JSON file for the results")
    options = parser.parse_args()
    folder = options.folder / f"{options.data}.map"
    if not (folder / "map.json").exists():
        build_map(options.data, folder, overrides=["detector.kind=panoseg"], tell=print)
    detections, panoramas = make_queries(options.data)
    results: dict[str, Any] = {"data": options.data, "queries": len(detections), "clients": options.clients}
    with service(folder) as (port, process):
        steps: list[tuple[str, Callable[[], dict[str, Any]]]] = [
            ("one at a time, detections", lambda: measure_overhead(port, detections, options.requests)),
            ("at a time, detections", lambda: load(port, detections, options.requests, options.clients)),
            ("at a time, panoramas", lambda: load(port, panoramas, options.requests, options.clients)),
            ("malformed", lambda: measure_malformed(port, detections[0], panoramas[0])),
            ("memory", lambda: measure_memory(port, process, detections, options.memory_requests, options.clients)),
        ]
        for name, measure in steps:
            results[name] = measure()
            print(name, json.dumps(results[name]), flush=True)
    if options.output is not None:
        options.output.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
