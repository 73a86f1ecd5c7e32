"""The command `serve` in a process of its own."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from command_line import run

from salframe.testing.rooms import ROOMS
from serving.rooms_service import PLUGINS, detections

HERE = Path(__file__).parent
BODY = {"detections": detections(ROOMS[0])}


@contextmanager
def command(*arguments: object):
    """The running command and its URL."""
    environment = {**os.environ, "SALFRAME_PLUGINS": PLUGINS}
    environment["PYTHONPATH"] = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        [sys.executable, "-c", "from salframe.cli import main; main()", "serve", *map(str, arguments)],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    lines = []
    try:
        while process.poll() is None:
            lines.append(process.stderr.readline())
            if found := re.search(r"serving .* at (http://\S+)", lines[-1]):
                yield process, found[1], "".join(lines)
                return
        raise AssertionError("".join(lines) + process.stderr.read())
    finally:
        process.kill()
        process.wait()
        process.stderr.close()


def test_sigterm_finishes_requests(rooms_map):
    with command(rooms_map, "--port", 0) as (process, url, _):
        port = int(url.rpartition(":")[2])
        statuses = []

        def ask() -> None:
            with httpx.Client(base_url=url, timeout=60) as client:
                statuses.append(client.post("/localize", json=BODY).status_code)

        body = httpx.Request("POST", url, json=BODY).content
        head = "POST /localize HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        with socket.create_connection(("127.0.0.1", port)) as half:
            half.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body[:10])
            threads = [threading.Thread(target=ask) for _ in range(4)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            process.send_signal(signal.SIGTERM)
            time.sleep(1)
            assert process.poll() is None  # the half request is in progress
            with pytest.raises(httpx.ConnectError):
                httpx.get(url)
            half.sendall(body[10:])
            assert b"200 OK" in half.recv(100)
        assert process.wait(30) == 0
        assert statuses == [200] * 4
        assert process.stderr.read() == ""


def test_another_address_creates_a_token(rooms_map):
    with command(rooms_map, "--host", "0.0.0.0", "--port", 0) as (_, url, printed):
        token = re.search(r"token: (\S+)", printed)[1]
        assert len(token) >= 24
        local = url.replace("0.0.0.0", "127.0.0.1")
        assert httpx.get(f"{local}/map").status_code == 401
        assert httpx.get(f"{local}/map", headers={"Authorization": f"Bearer {token}"}).status_code == 200


def test_wrong_options(rooms_map, tmp_path):
    (tmp_path / "token").write_text("short\n")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        for options, message in (
            ((tmp_path,), "contains no map"),
            ((rooms_map, "--port", 70000), "received --port '70000'"),
            ((rooms_map, "--port", taken.getsockname()[1]), "cannot listen on 127.0.0.1"),
            ((rooms_map, "--host", "no such host"), "cannot listen on no such host"),
            ((rooms_map, "--token-file", tmp_path / "token"), "has 5 characters, expected"),
            ((rooms_map, "--token-file", tmp_path / "none"), "cannot read"),
            ((rooms_map, "--set", "max_session=3"), "did you mean 'max_sessions'"),
            ((rooms_map, "--set", "workers=0"), "workers"),
        ):
            result = run("serve", *options)
            assert (result.code, result.out) == (2, "")
            assert message in result.err
            assert result.err.count("\n") == 1
