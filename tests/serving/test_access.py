"""Hosts, origins and tokens."""

from __future__ import annotations

import json

import pytest
from starlette.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from salframe.serving.access import AccessRules, is_loopback
from salframe.serving.problems import Problem
from salframe.testing.rooms import ROOMS
from serving.rooms_service import detections, serving

TOKEN = "0123456789abcdef-token"


@pytest.fixture(scope="module")
def guarded(rooms_map):
    """A service that needs a token, as on an address of the network."""
    with serving(rooms_map, rules=AccessRules(TOKEN)) as running:
        yield running


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        *((host, True) for host in ("127.0.0.1", "127.8.8.8", "::1", "localhost")),
        *((host, False) for host in ("0.0.0.0", "192.168.1.4", "::", "example.org", "")),
    ],
)
def test_loopback_addresses(host, expected):
    assert is_loopback(host) is expected


def test_requests_need_the_token(guarded):
    for path in ("/map", "/metrics", "/openapi.json", "/sessions/x"):
        refused = guarded.client.get(path)
        assert refused.status_code == 401, path
        assert refused.headers["www-authenticate"] == "Bearer"
        assert TOKEN not in refused.text
    for token in ("x", "wrong", TOKEN + "x", TOKEN[:-1], "ä" * 20):
        headers = {"Authorization": f"Bearer {token}".encode()}
        assert guarded.client.get("/map", headers=headers).status_code == 401
    assert guarded.client.get("/map", headers={"Authorization": f"Bearer {TOKEN}"}).status_code == 200
    assert guarded.client.get("/map", headers={"Authorization": f"bearer {TOKEN}"}).status_code == 200


def test_a_token_in_the_url_is_not_accepted(guarded):
    assert guarded.client.get(f"/map?token={TOKEN}").status_code == 401
    assert guarded.client.get(f"/map?access_token={TOKEN}").status_code == 401


def test_the_static_page_needs_no_token(guarded):
    for path in ("/", "/api", "/health", "/page/app.js"):
        assert guarded.client.get(path).status_code == 200, path
    assert guarded.client.get("/page/../map").status_code in (401, 404)
    assert guarded.client.get("/page/..%2fmap").status_code == 404


def test_a_websocket_sends_the_token_first(guarded):
    headers = {"Authorization": f"Bearer {TOKEN}"}
    session = guarded.client.post("/sessions", headers=headers).json()["id"]
    url = f"ws://127.0.0.1:{guarded.port}/sessions/{session}/stream"
    with connect(url) as socket:
        socket.send(json.dumps({"token": TOKEN}))
        assert json.loads(socket.recv())["status"] == "lost"
    with connect(url, additional_headers=headers) as socket:
        assert json.loads(socket.recv())["status"] == "lost"
    for message in ('{"token": "wrong"}', "{", "[]", '{"token": 1}', b"\x00"):
        with connect(url) as socket:
            socket.send(message)
            with pytest.raises(ConnectionClosed) as closed:
                socket.recv()
            assert closed.value.rcvd.code == 1008


def test_a_websocket_streams_the_belief(service):
    session = service.client.post("/sessions").json()["id"]
    with connect(f"ws://127.0.0.1:{service.port}/sessions/{session}/stream") as socket:
        assert json.loads(socket.recv())["observations"] == 0
        body = {"detections": detections(ROOMS[2]), "t_s": 1}
        belief = service.client.post(f"/sessions/{session}/observations", json=body).json()["belief"]
        assert json.loads(socket.recv()) == belief
        assert belief["place"] == "lounge"
        service.client.delete(f"/sessions/{session}")
        with pytest.raises(ConnectionClosed):
            socket.recv()
    with connect(f"ws://127.0.0.1:{service.port}/sessions/{session}/stream") as socket:
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv()
        assert "no session has this id" in closed.value.rcvd.reason


def test_pages_of_other_sites_are_refused(service):
    own = f"http://127.0.0.1:{service.port}"
    assert service.client.get("/map", headers={"Origin": own}).status_code == 200
    for origin in ("http://evil.example", "null", f"http://127.0.0.1:{service.port + 1}", "http://127.0.0.1", "x"):
        refused = service.client.post("/localize", json={"detections": []}, headers={"Origin": origin})
        assert refused.status_code == 403, origin
        assert "access-control-allow-origin" not in refused.headers
    session = service.client.post("/sessions").json()["id"]
    url = f"ws://127.0.0.1:{service.port}/sessions/{session}/stream"
    with pytest.raises(InvalidStatus) as refused:
        connect(url, origin="http://evil.example")
    assert refused.value.response.status_code == 403
    with connect(url, origin=own) as socket:
        assert json.loads(socket.recv())["status"] == "lost"


def test_other_host_names_are_refused_on_loopback(service):
    for host in ("evil.example", "127.0.0.1.evil.example", "", "[::1", "evil.example:8360"):
        assert service.client.get("/health", headers={"Host": host}).status_code == 403, host
    for host in ("localhost", "127.0.0.1:1", "[::1]:8360"):
        assert service.client.get("/health", headers={"Host": host}).status_code == 200, host


def test_cors_headers_only_for_configured_origins(rooms_map):
    origin = "https://robots.example"
    with serving(rooms_map, rules=AccessRules(TOKEN, origins=(origin,))) as running:
        preflight = {"Origin": origin, "Access-Control-Request-Method": "POST"}
        allowed = running.client.options("/localize", headers=preflight)
        assert allowed.headers["access-control-allow-origin"] == origin
        other = running.client.options("/localize", headers={**preflight, "Origin": "https://evil.example"})
        assert "access-control-allow-origin" not in other.headers
        refused = running.client.get("/map", headers={"Origin": origin})
        assert refused.status_code == 401  # an origin is no token


def test_security_headers(service):
    for path in ("/", "/map", "/none", "/health"):
        headers = service.client.get(path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert "server" not in headers


def test_rules_of_an_open_address_accept_any_host():
    rules = AccessRules.of_address("0.0.0.0", TOKEN, ())
    rules.check(Headers({"host": "robot.local", "authorization": f"Bearer {TOKEN}"}), "/map", is_websocket=False)
    with pytest.raises(Problem) as refused:
        rules.check(Headers({"host": "robot.local"}), "/map", is_websocket=False)
    assert refused.value.status == 401
