"""An inverted index on disk: for each label, the list of the objects with this label in all scenes of a map.

The index is written as a stream and memory-mapped for reading.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib.format import open_memmap

from salframe.framework.errors import DataError
from salframe.framework.files.array_files import map_array
from salframe.framework.files.reading import read_model
from salframe.framework.files.writing import write_json
from salframe.framework.validation import Settings
from salframe.graphs.graph import REACH_M, SaliencyGraph

CODE_STEP = 0.025
CODE_LOW = np.array([-3.2, -4.0, -4.0])
"""Each object has three codes from 0 to 255: for the height above the camera (m), the log length and the log box
height. A code c stands for the value CODE_LOW + CODE_STEP * c."""
_FROM_MIDDLE = (np.arange(256) - 127.5) / 127.5
POSITION_M = REACH_M * _FROM_MIDDLE * np.abs(_FROM_MIDDLE)
"""Value (m) of each code of x or y in the panorama frame. Adjacent codes differ by 0.1 m at 1 m and by 0.4 m at 16 m,
because a detector's errors increase with range."""
RARITY_UNIT = 64
"""Rarities are integers in units of 1 / RARITY_UNIT, so that sums do not depend on their order."""
CHUNK = 1 << 17
"""Number of objects in memory while an index is built."""
_FORMAT = 1
_INDEX, _LISTS, _SCENE, _CODE, _WEIGHT = "index.json", "lists.npy", "scene.npy", "code.npy", "weight.npy"
_POSITION = "position.npy"
_OBJECT = np.dtype([("label", "<u4"), ("scene", "<u4"), ("code", "u1", 3), ("position", "u1", 2)])


class _Index(Settings):
    """The content of index.json: the number of scenes, the labels in the order of their lists, and whether positions
    are stored."""

    format: int
    scenes: int
    labels: tuple[str, ...]
    positions: bool = False


@dataclass(frozen=True, eq=False)
class Postings:
    """The P objects of S scenes. Objects start[l] to start[l + 1] - 1 have label l, in the order of their scenes.

    Attributes:
        labels: Mapping from each of L label names to its index l.
        start: (L + 1,) int64, position of each label's first object; the last value is P.
        scene: (P,) uint32, index of the scene of each object.
        code: (P, 3) uint8 codes of height, length and box height, see CODE_LOW.
        rarity: (L + 1,) int64, smooth inverse document frequency ln((1 + S) / (1 + s)) + 1 in units of 1 / RARITY_UNIT.
            The last value is for labels that no scene has.
        weight: (S,) uint32, sum of the rarities of a scene's objects.
        position: (P, 2) uint8 codes of x and y, see POSITION_M; None if positions are not stored.
    """

    labels: dict[str, int]
    start: np.ndarray
    scene: np.ndarray
    code: np.ndarray
    rarity: np.ndarray
    weight: np.ndarray
    position: np.ndarray | None


def appearance(graph: SaliencyGraph) -> np.ndarray:
    """Return (N, 3): height above the camera (m), log length and log box height of each node, NaN if unknown."""
    return np.concatenate([graph.centroid_m[:, 2:], np.log(graph.size_m[:, ::2])], 1)


def write_postings(graphs: Iterable[SaliencyGraph], folder: Path, *, positions: bool) -> None:
    """Write the postings of a stream of graphs to a folder, with or without positions.

    About CHUNK objects are in memory at once.
    """
    labels: dict[str, int] = {}
    spool = folder / "objects.bin"
    scenes = _spool(graphs, labels, spool)
    start, rarity = _sort(spool, folder, scenes, len(labels), positions)
    spool.unlink()
    np.save(folder / _LISTS, np.stack([start, rarity]))
    index = {"format": _FORMAT, "scenes": scenes, "labels": list(labels), "positions": positions}
    write_json(folder / _INDEX, index)


def read_postings(folder: Path) -> Postings:
    """Return the postings that `write_postings` wrote, mapped into memory.

    Raises:
        DataError: The folder has no postings, or they have another format or are incomplete.
    """
    if not (folder / _INDEX).exists():
        raise DataError(f"{folder} has no scene index: build the map again, or only the index with SceneIndex.build")
    index = read_model(folder / _INDEX, _Index)
    if index.format != _FORMAT:
        raise DataError(
            f"{folder} has scene index format {index.format}, expected {_FORMAT}: build the map again, or only the "
            "index with SceneIndex.build"
        )
    try:
        start, rarity = np.asarray(map_array(folder / _LISTS))
        scene, code, weight = (np.asarray(map_array(folder / name)) for name in (_SCENE, _CODE, _WEIGHT))
        position = np.asarray(map_array(folder / _POSITION)) if index.positions else None
    except (OSError, ValueError) as error:
        raise DataError(f"the scene index in {folder} is incomplete ({error}): build the map again") from None
    position_shape = (start[-1], 2) if position is None else position.shape
    shapes = (len(start), scene.shape, code.shape, weight.shape, position_shape)
    if shapes != (len(index.labels) + 1, (start[-1],), (start[-1], 3), (index.scenes,), (start[-1], 2)):
        raise DataError(
            f"the scene index in {folder} is damaged: its arrays do not have the lengths stated in {_INDEX}; build the "
            "map again"
        )
    return Postings({name: i for i, name in enumerate(index.labels)}, start, scene, code, rarity, weight, position)


def _spool(graphs: Iterable[SaliencyGraph], labels: dict[str, int], spool: Path) -> int:
    """Write the objects to the file `spool`, scene by scene, and give each label an integer id. Return the number of
    scenes."""
    scenes, num_objects, buffer = 0, 0, []
    with spool.open("wb") as file:
        for graph in graphs:
            buffer.append((scenes, graph))
            scenes, num_objects = scenes + 1, num_objects + len(graph)
            if num_objects >= CHUNK:
                _objects(buffer, labels).tofile(file)
                num_objects, buffer = 0, []
        _objects(buffer, labels).tofile(file)
    return scenes


def _objects(scenes: list[tuple[int, SaliencyGraph]], labels: dict[str, int]) -> np.ndarray:
    """Return the objects of numbered scenes as an array of _OBJECT."""
    objects = np.empty(sum(len(graph) for _, graph in scenes), _OBJECT)
    objects["label"] = [labels.setdefault(name, len(labels)) for _, graph in scenes for name in graph.labels]
    objects["scene"] = np.repeat(*np.array([(number, len(graph)) for number, graph in scenes], int).reshape(-1, 2).T)
    values = np.concatenate([np.zeros((0, 3)), *(appearance(graph) for _, graph in scenes)])
    objects["code"] = np.clip(np.round((values - CODE_LOW) / CODE_STEP), 0, 255)
    xy_m = np.concatenate([np.zeros((0, 2)), *(graph.centroid_m[:, :2] for _, graph in scenes)])
    root = np.sign(xy_m) * np.sqrt(np.abs(xy_m) / REACH_M)
    objects["position"] = np.clip(np.round(127.5 * (1 + root)), 0, 255)
    return objects


def _sort(spool: Path, folder: Path, scenes: int, labels: int, positions: bool) -> tuple[np.ndarray, np.ndarray]:
    """Write the spooled objects label by label, and the weight of each scene.

    Returns:
        `start` and `rarity` as in Postings.
    """
    count = np.zeros(labels, np.int64)
    for chunk in _chunks(spool):
        count += np.bincount(chunk["label"], minlength=labels)
    start = np.concatenate([[0], count.cumsum()])
    scene = open_memmap(folder / _SCENE, "w+", np.uint32, (int(start[-1]),))
    code = open_memmap(folder / _CODE, "w+", np.uint8, (int(start[-1]), 3))
    position = open_memmap(folder / _POSITION, "w+", np.uint8, (int(start[-1]), 2)) if positions else None
    free = start[:-1].copy()
    for chunk in _chunks(spool):
        chunk = chunk[np.argsort(chunk["label"], kind="stable")]
        number = np.bincount(chunk["label"], minlength=labels)
        target = (free - number.cumsum() + number)[chunk["label"]] + np.arange(len(chunk))
        scene[target], code[target] = chunk["scene"], chunk["code"]
        if position is not None:
            position[target] = chunk["position"]
        free += number
    lists = [scene[start[i] : start[i + 1]] for i in range(labels)]
    num_scenes_with_label = np.array([*(1 + np.count_nonzero(np.diff(of_label)) for of_label in lists), 0])
    rarity = np.round(RARITY_UNIT * (np.log((1 + scenes) / (1 + num_scenes_with_label)) + 1)).astype(np.int64)
    weight = open_memmap(folder / _WEIGHT, "w+", np.uint32, (scenes,))
    for of_label, label_rarity in zip(lists, rarity, strict=False):
        np.add.at(weight, of_label, np.uint32(label_rarity))
    for written in (scene, code, weight, *([] if position is None else [position])):
        written.flush()
    return start, rarity


def _chunks(spool: Path) -> Iterable[np.ndarray]:
    """Yield the objects of scenes that `_spool` wrote to a file, at most CHUNK at a time."""
    with spool.open("rb") as file:
        while len(chunk := np.fromfile(file, _OBJECT, CHUNK)):
            yield chunk
