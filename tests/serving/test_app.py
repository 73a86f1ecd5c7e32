"""Queries, routes, sessions and the map over HTTP."""

from __future__ import annotations

import io
import json
import re

import numpy as np
import pytest
from shapely import Point, Polygon

from salframe.localization.tracking import TrackedCamera
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.shot import read_panorama
from salframe.testing.rooms import look, stand
from serving.rooms_service import HALL, ROOMS, TRUTHS, detections, floor, png, upload


def test_a_panorama_is_localized(service):
    for room in ROOMS:
        answer = service.client.post("/localize", files=upload(room.name)).raise_for_status().json()
        assert answer["places"][0]["place"] == room.name
        truth = TRUTHS[room.name].T_world_pano
        assert answer["status"] == "ok"
        assert [answer["pose"][key] for key in ("x_m", "y_m")] == pytest.approx(truth[:2, 3].tolist(), abs=0.1)
        assert np.cos(np.radians(answer["pose"]["yaw_deg"]) - pose_yaw(truth)) > np.cos(np.radians(2))
        total = sum(place["probability"] for place in answer["places"]) + answer["out_of_map_probability"]
        assert total == pytest.approx(1)
        assert np.allclose(np.array(answer["T_world_query"])[:2, 3], truth[:2, 3], atol=0.1)
        covariance = np.array(answer["covariance"]["matrix"])
        assert covariance.shape == (6, 6)
        assert answer["covariance"]["estimated"] == ["x", "y", "rotation_z"]
        assert (np.linalg.eigvalsh(covariance[np.ix_([0, 1, 5], [0, 1, 5])]) > 0).all()


def test_detections_are_localized(service):
    for room in ROOMS:
        body = {"detections": detections(room)}
        answer = service.client.post("/localize?objects=true", json=body).raise_for_status().json()
        assert answer["places"][0]["place"] == room.name
        middle = np.array(room.corner_m) + np.array(room.size_m[:2]) / 2  # the pose of the reference frame
        assert [answer["pose"][key] for key in ("x_m", "y_m")] == pytest.approx(middle.tolist(), abs=0.1)
        assert answer["pose"]["yaw_deg"] == pytest.approx(np.degrees(0.3), abs=2)
        sent, returned = (
            sorted(tuple(np.round(thing["centroid_m"], 3)) for thing in things)
            for things in (body["detections"], answer["objects"])
        )
        assert returned == sent


def test_matched_objects_are_those_of_the_room(service):
    """The matched object of the map lies where the furniture stands in the world."""
    room = ROOMS[0]
    answer = service.client.post("/localize?objects=true", files=upload(room.name)).json()
    matched = {thing["label"]: thing["matched"] for thing in answer["objects"] if thing["matched"]}
    assert len(matched) >= 4
    centre = {box.label: np.add(box.centre_m, (*room.corner_m, 0)) for box in room.boxes}
    for label, thing in matched.items():
        assert thing["label"] == label
        assert np.linalg.norm(np.array(thing["xyz_m"][:2]) - centre[label][:2]) < 0.6, label


def test_outlines_are_around_the_objects(service):
    """The outline of the bed is at its direction from the camera, computed from the true pose."""
    room = ROOMS[0]
    answer = service.client.post("/localize?objects=true&picture=true", files=upload(room.name)).json()
    assert answer["picture"].startswith("data:image/jpeg;base64,")
    bed = next(thing for thing in answer["objects"] if thing["label"] == "bed")
    truth = TRUTHS[room.name].T_world_pano
    ahead = np.linalg.inv(truth) @ [*np.add(room.boxes[0].centre_m[:2], room.corner_m), room.boxes[0].centre_m[2], 1]
    azimuth = np.degrees(np.arctan2(ahead[1], ahead[0]))
    assert bed["azimuth_deg"] == pytest.approx(azimuth, abs=8)
    column = (180 - azimuth) / 360
    lines = [np.array(line) for line in bed["outline"]]
    assert any(line[:, 0].min() < column < line[:, 0].max() and line[:, 1].max() > 0.5 for line in lines)


def test_the_map_has_floors_places_and_objects(service):
    response = service.client.get("/map")
    assert response.headers["content-type"] == "application/geo+json"
    content = response.json()
    layers = {}
    for feature in content["features"]:
        layers.setdefault(feature["properties"]["layer"], []).append(feature)
    assert {f["properties"]["place"] for f in layers["place"]} == {room.name for room in ROOMS}
    assert {f["properties"]["place"] for f in layers["region"]} == {*(room.name for room in ROOMS), "hall"}
    assert {"node", "edge", "object"} <= set(layers)
    hall = next(f for f in layers["region"] if f["properties"]["place"] == "hall")
    ring = np.array(hall["geometry"]["coordinates"][0][0])
    assert ring.min(0) == pytest.approx(HALL[0], abs=0.06)  # one pixel
    assert ring.max(0) == pytest.approx(HALL[1], abs=0.06)
    bed = next(f for f in layers["object"] if f["properties"]["label"] == "bed")
    ring = np.array(bed["geometry"]["coordinates"][0])
    centre = np.add(ROOMS[0].boxes[0].centre_m[:2], ROOMS[0].corner_m)
    assert Polygon(ring).contains(Point(centre))
    again = service.client.get("/map", headers={"If-None-Match": response.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_a_route_leads_from_a_pose_to_a_place(service):
    pose = {"x_m": 2.1, "y_m": 1.8, "yaw_deg": 0}
    body = {"start": {"pose": pose}, "goal": {"place": "kitchen"}}
    route = service.client.post("/route", json=body).raise_for_status().json()
    line = np.array(route["line"])
    assert route["length_m"] == pytest.approx(np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1).sum(), abs=1e-6)
    straight = np.linalg.norm(line[-1, :2] - line[0, :2])
    assert straight < route["length_m"] < 3 * straight
    assert line[0, :2] == pytest.approx((2.1, 1.8), abs=0.05)
    masks = floor()
    for start, end in zip(line[:-1, :2], line[1:, :2], strict=True):  # never through a wall
        for xy in np.linspace(start, end, 50):
            column, row = ((xy - masks.origin_m) * (1, -1) / masks.resolution_m).astype(int)
            assert masks.free[row, column]
    first = route["steps"][0]
    assert first["turn_deg"] == pytest.approx(first["azimuth_deg"], abs=1e-6)  # the heading is 0
    assert first["say"].startswith("turn left" if first["turn_deg"] > 0 else "turn right")


def test_a_route_leads_to_a_point(service):
    body = {"start": {"frame": "bedroom-map"}, "goal": {"point": {"x_m": 8.0, "y_m": 1.0}}}
    route = service.client.post("/route", json=body).raise_for_status().json()
    assert route["line"][-1][:2] == pytest.approx([8.0, 1.0], abs=0.06)
    body["goal"] = {"point": {"x_m": 80.0, "y_m": 1.0}}
    problem = service.client.post("/route", json=body)
    assert problem.status_code == 422
    assert "is not on a floor of the map" in problem.json()["detail"]


def walk(client, session: str, start: float, **more):
    """Two observations in the bedroom: before and after a turn by 90 degrees on the spot."""
    files = {name: (part[0], part[1].getvalue(), part[2]) for name, part in upload("bedroom").items()}
    first = client.post(f"/sessions/{session}/observations", files=files, data={"t_s": start})
    turned = {
        name: (part[0], png(np.roll(_decode(part[1]), 384 // 4, axis=1)), part[2]) for name, part in files.items()
    }
    data = {"t_s": start + 1, "odometry": json.dumps({"x_m": 0, "yaw_deg": 90}), **more}
    return first, client.post(f"/sessions/{session}/observations", files=turned, data=data)


def _decode(content: bytes) -> np.ndarray:
    from PIL import Image

    image = np.array(Image.open(io.BytesIO(content)))
    return image.astype(np.uint16) if image.ndim == 2 else image


def test_a_session_follows_a_robot(service):
    created = service.client.post("/sessions")
    assert created.status_code == 201
    session = created.json()["id"]
    lost = service.client.get(f"/sessions/{session}").json()
    assert (lost["status"], lost["pose"], lost["observations"]) == ("lost", None, 0)
    first, second = walk(service.client, session, 10.0)
    truth = TRUTHS["bedroom"].T_world_pano
    for response, turn_rad in ((first, 0), (second, np.pi / 2)):
        belief = response.raise_for_status().json()["belief"]
        assert (belief["status"], belief["place"]) == ("tracking", "bedroom")
        assert [belief["pose"]["x_m"], belief["pose"]["y_m"]] == pytest.approx(truth[:2, 3].tolist(), abs=0.1)
        assert np.cos(np.radians(belief["pose"]["yaw_deg"]) - pose_yaw(truth) - turn_rad) > np.cos(np.radians(2))
    late = service.client.post(
        f"/sessions/{session}/observations", json={"detections": detections(ROOMS[1]), "t_s": 10.5}
    )
    assert late.status_code == 409
    assert "t_s 10.5" in late.json()["detail"]
    assert service.client.get(f"/sessions/{session}").json() == belief  # an error leaves the session as it was
    assert service.client.delete(f"/sessions/{session}").status_code == 204
    assert service.client.get(f"/sessions/{session}").status_code == 404


def test_metrics_count_requests(service):
    service.client.get("/sessions/none")
    text = service.client.get("/metrics").text
    assert 'salframe_requests_total{method="GET",path="/sessions/{session_id}",status="404"}' in text
    assert "salframe_localize_seconds_count" in text


def test_examples_of_the_description_run(service):
    schema = service.client.get("/openapi.json").json()
    assert set(schema["paths"]) >= {"/localize", "/route", "/sessions", "/map", "/health", "/metrics"}
    for name in re.findall(r'"#/components/schemas/(\w+)"', json.dumps(schema)):
        assert name in schema["components"]["schemas"]
    for path in ("/localize", "/route"):
        example = schema["paths"][path]["post"]["requestBody"]["content"]["application/json"]["example"]
        assert service.client.post(path, json=example).status_code == 200
    session = service.client.post("/sessions").json()["id"]
    operation = schema["paths"]["/sessions/{session_id}/observations"]["post"]
    example = operation["requestBody"]["content"]["application/json"]["example"]
    assert service.client.post(f"/sessions/{session}/observations", json=example).status_code == 200


def test_a_session_is_tracked_like_a_camera(service, tmp_path):
    """The trajectory is that of `TrackedCamera`, for a walk with odometry that drifts."""
    room, camera = ROOMS[2], TrackedCamera(service.maps.current.localization)
    session = service.client.post("/sessions").json()["id"]
    last = None
    for number in range(6):
        pose = stand(room, 0.35 + 0.06 * number, 0.4 + 0.03 * number, 0.4 * number)
        panorama = look(room, f"view {number}", pose)
        files = {"image": png(panorama.rgb), "range": png(np.round(panorama.range_m * 1000).astype(np.uint16))}
        for name, content in files.items():
            (tmp_path / f"{name}.png").write_bytes(content)
        data, odometry = {"t_s": number}, None
        if last is not None:
            motion = np.linalg.inv(last) @ pose
            sent = {"x_m": motion[0, 3] * 1.02, "y_m": motion[1, 3], "yaw_deg": np.degrees(pose_yaw(motion)) + 0.5}
            data["odometry"] = json.dumps(sent)
            odometry = pose_2d(sent["x_m"], sent["y_m"], np.radians(sent["yaw_deg"]))
        last = pose
        step = camera.step(read_panorama(tmp_path / "image.png", tmp_path / "range.png"), odometry)
        uploads = {name: (f"{name}.png", content, "image/png") for name, content in files.items()}
        response = service.client.post(f"/sessions/{session}/observations", files=uploads, data=data)
        belief = response.raise_for_status().json()["belief"]
        assert belief["status"] == step.pose.status == "tracking"
        assert belief["place"] == room.name
        assert np.abs(np.array(belief["T_world_base"]) - step.pose.T_world_pano).max() < 1e-6
        assert np.hypot(*(np.array(belief["T_world_base"])[:2, 3] - pose[:2, 3])) < 0.15
