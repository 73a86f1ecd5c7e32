"""The objects of a map's scenes on disk, a list a label: built from a stream, read by mapping it into memory."""

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
"""A code c in 0 to 255 of height over the camera (m), log length and log box height (m) stands for low + step x c."""
_FROM_MIDDLE = (np.arange(256) - 127.5) / 127.5
POSITION_M = REACH_M * _FROM_MIDDLE * np.abs(_FROM_MIDDLE)
"""x or y (m) in the panorama frame that a code stands for: 0.1 m apart at 1 m and 0.4 m at 16 m, where a detector's
errors are larger too."""
RARITY_UNIT = 64
"""Rarity is an integer, in these parts of one, so that sums do not depend on their order."""
CHUNK = 1 << 17
"""Number of objects to hold in memory while building."""
_FORMAT = 1
_INDEX, _LISTS, _SCENE, _CODE, _WEIGHT = "index.json", "lists.npy", "scene.npy", "code.npy", "weight.npy"
_POSITION = "position.npy"
_OBJECT = np.dtype([("label", "<u4"), ("scene", "<u4"), ("code", "u1", 3), ("position", "u1", 2)])


class _Index(Settings):
    """index.json: the number of scenes, the labels in the order of their lists, and whether positions are stored."""

    format: int
    scenes: int
    labels: tuple[str, ...]
    positions: bool = False


@dataclass(frozen=True, eq=False)
class Postings:
    """The P objects of S scenes, those of label l at start[l] to start[l + 1], in the order of their scenes.

    Attributes:
        labels: name -> l.
        start: (L + 1,) int64.
        scene: (P,) uint32.
        code: (P, 3) uint8, height and sizes, see CODE_LOW.
        rarity: (L + 1,) int64, smooth inverse document frequency ln((1 + S) / (1 + s)) + 1 in parts of RARITY_UNIT; the
            last is that of a label which no scene has.
        weight: (S,) uint32, sum of the rarities of a scene's objects.
        position: (P, 2) uint8, x and y, see POSITION_M; None where they are not stored.
    """

    labels: dict[str, int]
    start: np.ndarray
    scene: np.ndarray
    code: np.ndarray
    rarity: np.ndarray
    weight: np.ndarray
    position: np.ndarray | None


def appearance(graph: SaliencyGraph) -> np.ndarray:
    """Return (N, 3) height over the camera (m), log length and log box height of a graph's nodes; NaN where unknown."""
    return np.concatenate([graph.centroid_m[:, 2:], np.log(graph.size_m[:, ::2])], 1)


def write_postings(graphs: Iterable[SaliencyGraph], folder: Path, *, positions: bool) -> None:
    """Write the postings of a stream of graphs to a folder, with positions where wanted. Memory holds CHUNK objects."""
    labels: dict[str, int] = {}
    spool = folder / "objects.bin"
    scenes = _spool(graphs, labels, spool)
    start, rarity = _sort(spool, folder, scenes, len(labels), positions)
    spool.unlink()
    np.save(folder / _LISTS, np.stack([start, rarity]))
    index = {"format": _FORMAT, "scenes": scenes, "labels": list(labels), "positions": positions}
    write_json(folder / _INDEX, index)


def read_postings(folder: Path) -> Postings:
    """Return the postings that `write_postings` wrote, mapped into memory. Raises DataError where there are none, or
    they have another format or are incomplete."""
    if not (folder / _INDEX).exists():
        raise DataError(f"{folder} holds no scene index: build it with SceneIndex.build")
    index = read_model(folder / _INDEX, _Index)
    if index.format != _FORMAT:
        raise DataError(f"{folder} has scene index format {index.format}, expected {_FORMAT}: build it again")
    try:
        start, rarity = np.asarray(map_array(folder / _LISTS))
        scene, code, weight = (np.asarray(map_array(folder / name)) for name in (_SCENE, _CODE, _WEIGHT))
        position = np.asarray(map_array(folder / _POSITION)) if index.positions else None
    except (OSError, ValueError) as error:
        raise DataError(f"{folder} is not whole ({error}): build the scene index again") from None
    placed = (start[-1], 2) if position is None else position.shape
    shapes = (len(start), scene.shape, code.shape, weight.shape, placed)
    if shapes != (len(index.labels) + 1, (start[-1],), (start[-1], 3), (index.scenes,), (start[-1], 2)):
        raise DataError(f"{folder} has lists of other lengths than its {_INDEX} says: build the scene index again")
    return Postings({name: i for i, name in enumerate(index.labels)}, start, scene, code, rarity, weight, position)


def _spool(graphs: Iterable[SaliencyGraph], labels: dict[str, int], spool: Path) -> int:
    """Write the objects in the order of the scenes and number their labels. Return the number of scenes."""
    scenes, held, waiting = 0, 0, []
    with spool.open("wb") as file:
        for graph in graphs:
            waiting.append((scenes, graph))
            scenes, held = scenes + 1, held + len(graph)
            if held >= CHUNK:
                _objects(waiting, labels).tofile(file)
                held, waiting = 0, []
        _objects(waiting, labels).tofile(file)
    return scenes


def _objects(scenes: list[tuple[int, SaliencyGraph]], labels: dict[str, int]) -> np.ndarray:
    """Return the objects of numbered scenes."""
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
    """Write spooled objects label by label, and the weight of each scene. Return where lists start, and rarities."""
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
    having = np.array([*(1 + np.count_nonzero(np.diff(of_label)) for of_label in lists), 0])
    rarity = np.round(RARITY_UNIT * (np.log((1 + scenes) / (1 + having)) + 1)).astype(np.int64)
    weight = open_memmap(folder / _WEIGHT, "w+", np.uint32, (scenes,))
    for of_label, worth in zip(lists, rarity, strict=False):
        np.add.at(weight, of_label, np.uint32(worth))
    for written in (scene, code, weight, *([] if position is None else [position])):
        written.flush()
    return start, rarity


def _chunks(spool: Path) -> Iterable[np.ndarray]:
    """Yield spooled objects, CHUNK at a time."""
    with spool.open("rb") as file:
        while len(chunk := np.fromfile(file, _OBJECT, CHUNK)):
            yield chunk
