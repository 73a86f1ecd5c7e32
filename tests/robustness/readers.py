"""Sound files of every kind that salframe reads, and the readers that take them in."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from salframe_matterport.readers import read_boxes, read_regions, read_room_types, read_ways
from salframe_matterport.release import read_viewpoints as read_cameras
from salframe_matterport.reverie import Reverie
from salframe_mesh.dataset import read_frames
from salframe_mesh.floors import read_rooms
from small_map import write_small_map
from tiny_folder import write_tiny_folder

from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.studies.study import plan, read_study
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.framework.components.presets import configure_default
from salframe.framework.files.cache import Cache
from salframe.framework.files.hashes import file_sha256
from salframe.framework.onnx import open_model
from salframe.localization.map import open_map
from salframe.localization.map_files import MAP
from salframe.navigation.episodes import read_episode_requests
from salframe.panoramas import images
from salframe.panoramas.camera_file import read_camera
from salframe.panoramas.folder_reader import Folder
from salframe.panoramas.house_file import read_house
from salframe.panoramas.shot import read_panorama
from salframe.topology.building_map import build_map
from salframe.topology.store import open_topology


@dataclass(frozen=True)
class Reader:
    """A folder of sound files by its name; `read` gives something whose repr tells what was read of it; sealed: whether
    whatever was damaged must be found out; reseal: after a damage that whoever edits a map could hide; files: the
    pattern of those that are damaged."""

    folder: str
    read: Callable[[Path], Any]
    sealed: bool = False
    reseal: Callable[[Path], None] | None = None
    files: str = "**/*"


def _folder(root: Path) -> Any:
    folder = Folder(root)
    folder.floors()
    frames = folder.manifest.frames
    truth = [folder.truth(frame.id) for frame in frames if frame.role == "query"]
    return folder.labels, truth, [folder.load(frame).id for frame in frames[:2]], folder.fingerprint


def _pictures(root: Path) -> Any:
    arrays = images.read_color(root / "a.png"), images.read_range(root / "b.png"), images.read_mask(root / "c.png")
    return [array.tobytes() for array in arrays]


def _run(root: Path) -> Any:
    run = Run.load(root)
    notes, environment = run.notes(), run.environment()
    return notes, environment, run.data(), run.outcome("objects"), run.rows("objects", AnswerRow)


def _map(root: Path) -> Any:
    map = open_map(root)
    return map.localizer.config, [frame.T_world_pano.tolist() for frame in map.frames]


def _study(root: Path) -> Any:
    study = read_study(root / "study.yaml")
    return [arm.settings for arm in plan(study, Request(methods=(), data=str(root / "data.yaml")))]


def reseal(root: Path) -> None:
    """Write the hashes of a map anew, as whoever edits one may."""
    content = json.loads((root / MAP).read_text())
    parts = root / content["parts"]
    content["sha256"] = {name: file_sha256(parts / name) for name in content["sha256"] if (parts / name).is_file()}
    (root / MAP).write_text(json.dumps(content))


READERS = {
    "folder": Reader("folder", _folder),
    "labels": Reader("labels", lambda root: read_panorama(instances=root / "ids.png", labels=root / "labels.json")),
    "pictures": Reader("pictures", _pictures, sealed=True),
    "photograph": Reader("photograph", lambda root: images.read_color(root / "a.jpg").shape),
    "map": Reader("map", _map, sealed=True),
    "edited map": Reader("map", _map, reseal=reseal),
    "topology": Reader("topology", lambda root: repr(open_topology(root)), sealed=True),
    "edited topology": Reader("topology", lambda root: repr(open_topology(root)), reseal=reseal),
    "run": Reader("run", _run),
    "study": Reader("study", _study),
    "preset": Reader("preset", lambda root: configure_default("localizer", str(root / "preset.yaml"))),
    "episodes": Reader("episodes", lambda root: read_episode_requests(root / "episodes.json")),
    "reverie": Reader("reverie", lambda root: Reverie().score(root / "answers.json", root)),
    "connectivity": Reader("reverie", lambda root: read_ways(root / "connectivity" / "s_connectivity.json")),
    "boxes": Reader("reverie", lambda root: read_boxes(root / "reverie" / "BBox" / "s_a.json", "a")),
    "regions": Reader(
        "regions", lambda root: (read_regions(root / "vp2room.json"), read_room_types(root / "vp2room.json"))
    ),
    "house": Reader("house", lambda root: read_house(root / "a.house")),
    "camera": Reader("camera", lambda root: read_camera(root / "camera.json")),
    "cameras": Reader("cameras", lambda root: read_cameras(root)),
    "frames": Reader("frames", lambda root: read_frames(root / "frames.csv")),
    "rooms": Reader("rooms", lambda root: read_rooms(root)),
    "network": Reader("network", lambda root: open_model(root / "net.onnx", [(None, 3, 8, 8)]).outputs),
    "cache": Reader("cache", lambda root: Cache(root).get("key"), sealed=True),
}


def write_sound(root: Path) -> None:
    """Write the sound files of every reader."""
    write_tiny_folder(root / "folder")
    build_map(root / "folder", root / "map", "objects", overrides=("detector.kind=annotations",))
    rng = np.random.default_rng(0)
    for name in (
        "labels",
        "pictures",
        "photograph",
        "camera",
        "study",
        "preset",
        "episodes",
        "regions",
        "house",
        "frames",
        "rooms",
    ):
        (root / name).mkdir()
    noise = rng.integers(0, 255, (16, 32, 3)).astype(np.uint8)
    images.write_color(root / "pictures" / "a.png", noise)
    images.write_range(root / "pictures" / "b.png", noise[..., 0] / 30)
    images.write_mask(root / "pictures" / "c.png", noise[..., 0] > 99)
    cv2.imwrite(str(root / "photograph" / "a.jpg"), noise)
    images.write_ids(root / "labels" / "ids.png", noise[..., 0] % 3)
    write_json(root / "labels" / "labels.json", {"1": "bed", "2": "lamp"})
    pinhole = {"width": 640, "height": 480, "fx": 525.0, "fy": 525.0, "cx": 319.5, "cy": 239.5}
    distortion = {"distortion_model": "plumb_bob", "distortion": [-0.2, 0.04, 0.001, -0.0005, 0.0]}
    pose = [[0, 0, 1, 0.2], [-1, 0, 0, 0], [0, -1, 0, 0.4], [0, 0, 0, 1]]
    write_json(root / "camera" / "camera.json", {**pinhole, **distortion, "T_base_camera": pose})
    write_small_map(root / "topology")
    _write_run(root / "run", root / "folder")
    (root / "study" / "study.yaml").write_text(
        "method: objects\nset: {data.seed: 3}\nvary: {labels: [set, multiset], data.rooms: [4, 5]}\nseeds: [1, 2]\n"
    )
    (root / "study" / "data.yaml").write_text("kind: house\nrooms: 4\n")
    (root / "preset" / "preset.yaml").write_text("base: base.yaml\nlabels: set\n")
    (root / "preset" / "base.yaml").write_text("kind: objects\ndetector: {kind: annotations, noise: none}\n")
    write_json(
        root / "episodes" / "episodes.json",
        [{"start": [1.5, 2.0], "goal": "a", "yaw_deg": 90.0}, {"start": "b", "goal": "a"}],
    )
    write_reverie(root / "reverie")
    regions = {"a": {"region_index": "0", "label": "b"}, "b": {"region_index": 1, "label": "k"}}
    write_json(
        root / "regions" / "vp2room.json",
        {"label_info": {"label_name": {"b": "bedroom (x)"}}, "pano_info": {"s": regions}},
    )
    (root / "house" / "a.house").write_text(
        "R  0 0  0 0  b  0 0 0  0 0 0  5 4 2.5  2.5\nS 0 0 0 0\nV 0 0 0 0 0\nV 1 0 0 5 0\nV 2 0 0 5 4\n"
        f"P  {'a' * 32} 0 0 0  1 2 1.5\nC 0 4 bed 4 bed\nO 0 0 0 1 1 1 1 0 0 0 1 0 0.5 0.5 0.5\n"
    )
    pose = " ".join(map(str, np.eye(4).ravel()))
    cameras = root / "cameras" / "undistorted_camera_parameters" / "cameras.conf"
    cameras.parent.mkdir(parents=True)
    cameras.write_text(f"intrinsics_matrix 1000 0 640  0 1000 512  0 0 1\nscan a_d1_0.png a_i1_5.jpg {pose}\n")
    (root / "frames" / "frames.csv").write_text(
        "id,role,place,x_m,y_m,z_m,yaw_rad\na,map,kitchen,1,2,1.5,0\nb,query,kitchen,1.2,2,1.5,0.3\n"
    )
    write_json(root / "rooms" / "regions.json", {"kitchen": {"outline_m": [[0, 0], [3, 0], [3, 3]], "floor_m": 0.0}})
    Cache(root / "cache").put("key", {"a": np.arange(50.0), "b": np.array(["x", "y"])}, 1.0)


def write_json(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def write_network(path: Path) -> None:
    """A network that gives back its image."""
    import onnx
    from onnx import TensorProto, helper

    path.parent.mkdir()
    inputs, outputs = (helper.make_tensor_value_info(name, TensorProto.FLOAT, ("n", 3, 8, 8)) for name in "xy")
    graph = helper.make_graph([helper.make_node("Relu", ["x"], ["y"])], "net", [inputs], [outputs])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)


def _write_run(root: Path, data: Path) -> None:
    data_settings = {"kind": "folder", "root": str(data)}
    request = {
        "format": 2,
        "task": {"name": "localization"},
        "seed": 0,
        "data": data_settings,
        "methods": {"objects": {"kind": "objects"}},
    }
    root.mkdir()
    (root / "request.yaml").write_text(json.dumps(request))
    write_json(root / "env.json", {"dataset_fingerprint": "0", "python": "3.11"})
    write_json(root / "notes.json", ["a note"])
    folder = root / "methods" / "objects"
    write_json(folder / "outcome.json", {"status": "done", "reason": None, "input": ["rgb"]})
    write_json(folder / "identity.json", {"sha256": "0", "source": None})
    answer = {"fold": "all", "query": "q", "places": [["m", "kitchen", 0.5]], "pose": np.eye(4).ravel().tolist()}
    cost = {"query_ms": 1.0, "describe_ms": 2.0, "peak_memory_mb": None, "status": "ok", "error": None, "heading": 0.1}
    (folder / "rows.jsonl").write_text((json.dumps(answer | cost) + "\n") * 2)


def write_reverie(root: Path) -> None:
    poses = {"a": (0, 0), "b": (2, 0), "c": (2, 2)}
    viewpoints = []
    for name, (x, y) in poses.items():
        pose = np.eye(4)
        pose[:2, 3] = x, y
        free = [other != name for other in poses]
        viewpoints.append(
            {"image_id": name, "pose": pose.ravel().tolist(), "included": True, "unobstructed": free, "height": 1.5}
        )
    write_json(root / "connectivity" / "s_connectivity.json", viewpoints)
    for name in poses:
        boxes = {"7": {"name": "arm#chair", "visible_pos": [3, 4], "bbox2d": [[1, 2, 30, 40], [5, 6, 70, 80]]}}
        write_json(root / "reverie" / "BBox" / f"s_{name}.json", {name: boxes if name == "c" else {}})
    task = {
        "path_id": 1,
        "scan": "s",
        "objId": 7,
        "path": ["a", "b", "c"],
        "heading": 0.5,
        "instructions": ["go", "come"],
    }
    write_json(root / "reverie" / "REVERIE_val.json", [task])
    trajectory = [["a", 0.5, 0.0], ["b", 0.0, 0.0], ["c", 0.0, 0.0]]
    answers = [{"instr_id": f"1_7_{number}", "trajectory": trajectory, "predObjId": 7} for number in (0, 1)]
    write_json(root / "answers.json", answers)
