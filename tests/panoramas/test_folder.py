"""The folder format: what is written is read back, optional parts are optional, and whatever is wrong is said in one
line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import run

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.folder_format import (
    FrameEntry,
    TruthEntry,
    is_written,
    write_floor,
    write_manifest,
    write_objects,
    write_panorama,
)
from salframe.panoramas.folder_reader import Folder
from salframe.panoramas.frames import FrameKind, QueryFrame
from salframe.panoramas.geometry import pose_2d

HEIGHT = 32
POSE = pose_2d(1.0, -2.0, 0.5, 1.5)
MASKS = FloorMasks(
    np.eye(6, 9, dtype=bool),
    np.arange(54, dtype=np.int32).reshape(6, 9),
    np.zeros((6, 9), bool),
    0.05,
    (-1.0, 4.0),
    {1: "room-a", 2: "room-b"},
    2.5,
)


def numbers(pose: np.ndarray) -> tuple[float, ...]:
    return tuple(pose.ravel().tolist())


@pytest.fixture
def images() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    range_m = rng.uniform(0.1, 60, (HEIGHT, 2 * HEIGHT)).astype(np.float32)
    range_m[3, 4] = np.nan
    rgb = cv2.GaussianBlur(rng.integers(0, 256, (HEIGHT, 2 * HEIGHT, 3)).astype(np.uint8), (0, 0), 3)
    return {
        "rgb": rgb,
        "range_m": range_m,
        "instance_id": rng.integers(0, 65536, (HEIGHT, 2 * HEIGHT)).astype(np.int32),
    }


@pytest.fixture
def folder(tmp_path: Path, images: dict[str, np.ndarray]) -> Path:
    """A reference frame, a transition and a query with everything there is."""
    entries = [
        FrameEntry(
            id="a",
            role="map",
            rgb="a.png",
            range="a.range.png",
            instances="a.ids.png",
            pose=numbers(POSE),
            place="room-a",
        ),
        FrameEntry(
            id="t",
            role="transition",
            rgb="t.png",
            range="t.range.png",
            instances="t.ids.png",
            pose=numbers(np.eye(4)),
            place="door",
        ),
        FrameEntry(id="q", role="query", rgb="q.jpg", range="q.range.png", instances="q.ids.png"),
    ]
    for entry in entries:
        assert not is_written(tmp_path, entry)
        write_panorama(tmp_path, entry, **images)
        assert is_written(tmp_path, entry)
    write_objects(
        tmp_path / "objects.parquet", {"instance_id": [1, 2], "label": ["chair", "bed"], "room": ["room-a", "room-b"]}
    )
    truth = {"q": TruthEntry(place="room-a", pose=numbers(pose_2d(1.2, -2, 3, 1.5)), instances=(1, 2))}
    write_manifest(tmp_path, entries, truth, "objects.parquet", [write_floor(tmp_path, "floor", MASKS)])
    return tmp_path


def dataset(root: Path) -> FolderDataset:
    return FolderDataset(FolderDataset.Config(root=root))


def edit(root: Path, change: Callable[[dict], object], name: str = "manifest.json") -> None:
    content = json.loads((root / name).read_text())
    change(content)
    (root / name).write_text(json.dumps(content))


def test_reads_what_was_written(folder: Path, images: dict[str, np.ndarray]) -> None:
    data = dataset(folder)
    assert data.provides == {"rgb", "range", "annotations"}
    (fold,) = data.folds()
    assert [(f.id, f.place, f.kind) for f in fold.references] == [
        ("a", "room-a", FrameKind.SCENE),
        ("t", "door", FrameKind.TRANSITION),
    ]
    np.testing.assert_array_equal(fold.references[0].T_world_pano, POSE)
    panorama = fold.references[0].load()
    np.testing.assert_array_equal(panorama.rgb, images["rgb"])
    np.testing.assert_allclose(panorama.range_m, images["range_m"], atol=0.0005001)
    np.testing.assert_array_equal(panorama.annotations.instance_id, images["instance_id"])
    assert panorama.annotations.labels == {1: "chair", 2: "bed"}


def test_queries_carry_no_truth(folder: Path, images: dict[str, np.ndarray]) -> None:
    data = dataset(folder)
    (query,) = data.folds()[0].queries
    assert {field.name for field in fields(query)} == {"id", "load", "content", "earlier", "T_last_view"}
    assert (query.earlier, query.T_last_view) == ((), None)
    assert query.content == ""
    assert type(query) is QueryFrame
    assert "room" not in (folder / "manifest.json").read_text().partition('"q"')[2].partition("}")[0]
    truth = data.truth("q")
    assert (truth.place, truth.instances) == ("room-a", (1, 2))
    np.testing.assert_array_equal(truth.T_world_pano, pose_2d(1.2, -2, 3, 1.5))
    assert np.abs(query.load().rgb.astype(int) - images["rgb"]).mean() < 4  # JPEG


def test_range_is_uint16_millimetres_with_zero_for_unknown(folder: Path, images: dict[str, np.ndarray]) -> None:
    stored = cv2.imread(str(folder / "a.range.png"), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    known = ~np.isnan(images["range_m"])
    np.testing.assert_array_equal(stored[known], np.round(images["range_m"].astype(float)[known] * 1000))
    assert stored[3, 4] == 0
    far = np.full((2, 4), 70.0, np.float32)
    entry = FrameEntry(id="far", role="query", range="far.png")
    write_panorama(folder, entry, range_m=far)
    assert not cv2.imread(str(folder / "far.png"), cv2.IMREAD_UNCHANGED).any()


def test_floor_masks(folder: Path) -> None:
    (floor,) = dataset(folder).floors()
    np.testing.assert_array_equal(floor.free, MASKS.free)
    np.testing.assert_array_equal(floor.region, MASKS.region)
    np.testing.assert_array_equal(floor.obstacle, MASKS.obstacle)
    assert (floor.resolution_m, floor.origin_m, floor.regions, floor.z_m) == (
        0.05,
        (-1.0, 4.0),
        {1: "room-a", 2: "room-b"},
        2.5,
    )


def test_optional_parts_are_optional(tmp_path: Path, images: dict[str, np.ndarray]) -> None:
    """A manifest by hand, with colour alone, no truth, no floors and a reference frame only."""
    cv2.imwrite(str(tmp_path / "mine.png"), images["rgb"])
    frame = {"id": "mine", "role": "map", "rgb": "mine.png", "pose": np.eye(4).ravel().tolist(), "place": "kitchen"}
    (tmp_path / "manifest.json").write_text(json.dumps({"format": "salframe-folder", "version": 1, "frames": [frame]}))
    data = dataset(tmp_path)
    assert data.provides == {"rgb"}
    assert data.floors() == []
    assert data.folds()[0].queries == ()
    panorama = data.folds()[0].references[0].load()
    assert panorama.range_m is None
    assert panorama.annotations is None
    with pytest.raises(DataError, match="has no true place of the query 'x'"):
        data.truth("x")


def test_instance_images_are_annotations_without_range_too(folder: Path) -> None:
    edit(folder, lambda m: m["frames"][1].pop("range"))
    assert dataset(folder).provides == {"rgb", "annotations"}


def test_a_moved_folder_has_the_same_fold(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    (before,) = dataset(folder).folds()
    (after,) = dataset(folder.rename(tmp_path_factory.mktemp("other") / "name")).folds()
    assert after.id == before.id


def test_fingerprint_follows_every_file(folder: Path) -> None:
    before = dataset(folder).fingerprint
    assert dataset(folder).fingerprint == before
    for name in ("a.png", "q.range.png", "truth.json", "objects.parquet", "floor-region.png", "manifest.json"):
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content + b" ")
        assert dataset(folder).fingerprint != before, name
        (folder / name).write_bytes(content)


def test_valid_mask_marks_a_partial_field_of_view(folder: Path) -> None:
    seen = np.zeros((HEIGHT, 2 * HEIGHT), np.uint8)
    seen[:, 10:20] = 255
    cv2.imwrite(str(folder / "seen.png"), seen)
    edit(folder, lambda m: m["frames"][0].update(valid="seen.png"))
    np.testing.assert_array_equal(dataset(folder).folds()[0].references[0].load().valid, seen > 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m["frames"][0].pop("id"), r"manifest.json: the required key frames.0.id is missing"),
        (lambda m: m.pop("frames"), r"manifest.json: the required key frames is missing"),
        (lambda m: m.update(frames=[]), r"none of 0 frames in the manifest is a reference frame"),
        (lambda m: m.update(version=2), r"version: received 2, expected 1"),
        (lambda m: m["frames"][0].pop("pose"), r"the reference frame a has no pose"),
        (lambda m: m["frames"][1].pop("place"), r"the reference frame t has no place"),
        (lambda m: m["frames"][2].update(place="room-a"), r"the query q has a pose or place in the manifest"),
        (lambda m: m["frames"][1].update(id="a"), r"two frames have the id a"),
        (lambda m: m["frames"][0].update(depth="a.png"), r"unknown key .*frames.0.depth"),
        (lambda m: m["frames"][0].update(pose=[2.0] * 16), r"not a rigid motion"),
        (lambda m: m["frames"][0].update(pose=[1.0, 2.0]), r"frames.0.pose"),
        (lambda m: m.pop("objects"), r"expected a table with the labels"),
        (
            lambda m: [m["frames"][2].pop(part) for part in ("rgb", "range", "instances")],
            r"the frame q has no image file",
        ),
    ],
)
def test_a_wrong_manifest_is_one_line(folder: Path, change: Callable[[dict], object], message: str) -> None:
    edit(folder, change)
    with pytest.raises(DataError, match=message) as error:
        dataset(folder).folds()
    assert "\n" not in str(error.value)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:200])


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda root: cut(root / "q.jpg"), r"q.jpg is not a readable image \(file size 200 bytes\)"),
        (lambda root: cut(root / "q.range.png"), r"q.range.png is not a readable image"),
        (lambda root: (root / "q.jpg").write_bytes(b""), r"q.jpg is not a readable image \(file size 0 bytes\)"),
        (lambda root: (root / "q.jpg").unlink(), r"cannot read .*q.jpg: No such file"),
        (
            lambda root: cv2.imwrite(str(root / "q.range.png"), np.ones((8, 16), np.uint16)),
            r"q: the range image is 16 x 8, expected 64 x 32",
        ),
        (lambda root: cv2.imwrite(str(root / "q.jpg"), np.ones((32, 60, 3), np.uint8)), r"is .*60.*width = 2 x height"),
        (
            lambda root: cv2.imwrite(str(root / "q.range.png"), np.ones((32, 64), np.uint8)),
            r"has 1 channel of 8 bits, expected 1 channel of 16",
        ),
        (lambda root: (root / "objects.parquet").write_bytes(b"no table"), r"objects.parquet is not a Parquet table"),
        (
            lambda root: pq.write_table(pa.table({"instance_id": [1]}), root / "objects.parquet"),
            r"objects.parquet has no column label",
        ),
    ],
)
def test_a_wrong_file_is_one_line(folder: Path, spoil: Callable[[Path], object], message: str) -> None:
    spoil(folder)
    (query,) = dataset(folder).folds()[0].queries
    with pytest.raises(DataError, match=message) as error:
        query.load()
    assert "\n" not in str(error.value)


def test_no_folder_no_manifest_no_json(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="pass the path as --data-dir"):
        FolderDataset().folds()
    with pytest.raises(DataError, match=r"expected a folder with the file manifest\.json"):
        dataset(tmp_path).folds()
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(DataError, match="is not JSON"):
        Folder(tmp_path)
    (tmp_path / "manifest.json").write_text("[]")
    with pytest.raises(DataError, match="contains a list, expected a JSON object"):
        Folder(tmp_path)


def test_masks_of_a_floor_have_one_size(folder: Path) -> None:
    cv2.imwrite(str(folder / "floor-free.png"), np.ones((3, 3), np.uint8))
    with pytest.raises(DataError, match=r"masks .* of the floor at z = 2.5 m have the sizes 3 x 3, 9 x 6, 9 x 6"):
        dataset(folder).floors()


def test_a_folder_without_truth_is_a_dataset(folder: Path) -> None:
    entries = Folder(folder).manifest.frames
    (folder / "truth.json").unlink()
    write_manifest(folder, entries, {}, "objects.parquet")
    assert not (folder / "truth.json").exists()
    done = run("data", "info", str(folder), "--json").json
    assert (done["queries"], done["queried_places"], done["queries_without_truth"]) == (1, 0, 1)
    with pytest.raises(
        DataError, match=r"manifest\.json has no true place of the query 'q', which an evaluation needs"
    ):
        dataset(folder).truth("q")


def test_stairs_are_read_and_their_ends_are_checked(folder: Path) -> None:
    assert dataset(folder).connections() == []
    before = dataset(folder).fingerprint
    edit(folder, lambda content: content["frames"][1].update(role="map", place="room-b"))
    stairs = {"start": "room-a", "end": "room-b", "kind": "stairs", "length_m": 6.0}
    edit(folder, lambda content: content.update(connections=[stairs]))
    (connection,) = dataset(folder).connections()
    assert connection.model_dump() == stairs
    assert dataset(folder).fingerprint != before
    edit(folder, lambda content: content.update(connections=[{**stairs, "end": "rom-b"}]))
    with pytest.raises(DataError, match="the key `connections` has an unknown place 'rom-b', did you mean 'room-b'"):
        dataset(folder).connections()


def test_a_manifest_without_stairs_has_no_key_for_them(folder: Path) -> None:
    assert "connections" not in json.loads((folder / "manifest.json").read_text())
