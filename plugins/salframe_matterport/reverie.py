"""The scorer `reverie`: an agent's answers to REVERIE by the rules of the task's own evaluation.

REVERIE: Qi et al., "REVERIE: Remote Embodied Visual Referring Expression in Real Indoor Environments", CVPR 2020. Paths
are scored as its `eval_release.py` does; the object metrics, which that leaves out, as DUET does (Chen et al., CVPR
2022), by whose evaluation later agents report.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field

from salframe.evaluation.scorer import Scorer
from salframe.framework.errors import DataError, UnknownName, unknown
from salframe.framework.files.reading import read_as, read_json
from salframe.navigation.episodes import EpisodeRequest
from salframe_matterport.readers import Number, boxes_path, connectivity_path, read_boxes, read_connectivity, read_ways

METRICS = ("SR", "OSR", "SPL", "RGS", "RGSPL")
MIN_LENGTH_M = 0.01
"""Divisor of SPL where neither the agent nor the reference moves (DUET)."""
NAMED = 5
"""Missing instructions that a message names; the others it counts."""


class Reverie(Scorer):
    """REVERIE: reaching the viewpoint that shows the object meant (SR, OSR, SPL), and naming it (RGS, RGSPL)."""

    name = "reverie"
    version = "1"

    def score(self, answers: Path, root: Path) -> Sequence[Mapping[str, Any]]:
        """See Scorer. Metrics in percent, to two decimals; the paths' lengths are shortest ways along the connectivity
        graph, in 3D.

        A split is scored where the file answers any of its instructions, and then must answer all of them. `ignored`:
        answers that count in no split, to instructions that `root` does not have, and the second to one instruction.
        """
        splits = read_episodes(root)
        given = read_json(answers)
        read = read_answers(given, answers)
        touched = {split: episodes for split, episodes in splits.items() if not read.keys().isdisjoint(episodes)}
        if not touched:
            known = ", ".join(f"{len(episodes)} of {split}" for split, episodes in splits.items())
            raise DataError(f"{answers} answers none of the instructions of {root}: {known}")
        for split, episodes in touched.items():
            missing = [name for name in episodes if name not in read]
            if missing:
                named = ", ".join(missing[:NAMED]) + (", ..." if len(missing) > NAMED else "")
                raise DataError(
                    f"{answers} lacks {len(missing)} of the {len(episodes)} instructions of {split}: {named}"
                )
        building = {
            scan: BuildingGraph(root, scan)
            for episodes in touched.values()
            for scan in {e.scan for e in episodes.values()}
        }
        ignored = len(given) - sum(map(len, touched.values()))
        rows = []
        for split, episodes in touched.items():
            scores = np.array(
                [score_episode(name, episode, read[name], building[episode.scan]) for name, episode in episodes.items()]
            )
            percent = (round(float(mean) * 100, 2) for mean in scores.mean(0))
            rows.append(
                {
                    "split": split,
                    "episodes": len(episodes),
                    "ignored": ignored,
                    **dict(zip(METRICS, percent, strict=True)),
                }
            )
        return rows

    def episodes(self, split: str, root: Path) -> Sequence[EpisodeRequest]:
        """See Scorer: one for all instructions to the same object along the same path, to the path's end."""
        return [
            EpisodeRequest(
                world=episode.scan,
                start=f"{episode.scan}/{episode.path[0]}",
                goal=f"{episode.scan}/{episode.path[-1]}",
                yaw_deg=90.0 - math.degrees(episode.heading_rad),
            )
            for episode in by_task(split, root).values()
        ]

    def submission(self, split: str, root: Path, walked: Sequence[np.ndarray | None]) -> list[dict[str, Any]]:
        """See Scorer: the same answer to all instructions of a task, and no object, which localization does not find.
        Headings are clockwise from the world's y axis, as the simulator's; elevations are 0."""
        tasks = by_task(split, root)
        camera = {
            scan: read_connectivity(connectivity_path(root, scan)) for scan in {task.scan for task in tasks.values()}
        }
        trajectory = {}
        for (name, task), poses in zip(tasks.items(), walked, strict=True):
            if poses is None:
                trajectory[name] = [[task.path[0], task.heading_rad, 0.0]]
                continue
            viewpoints, stood_m = list(camera[task.scan]), np.array([T[:3, 3] for T in camera[task.scan].values()])
            nearest = np.linalg.norm(poses[:, None, :3] - stood_m, axis=2).argmin(1)
            heading = (math.pi / 2 - poses[:, 3]) % (2 * math.pi)
            trajectory[name] = [[viewpoints[i], float(h), 0.0] for i, h in zip(nearest, heading, strict=True)]
        return [
            {"instr_id": name, "trajectory": trajectory[task_of(name)], "predObjId": None}
            for name in read_split(split, root)
        ]


class _Task(BaseModel):
    """What REVERIE_<split>.json says of an object to find; objId is not published of every split."""

    path_id: int | str
    scan: str
    objId: int | Annotated[str, Field(pattern="^[0-9]{1,9}$")] | None = None  # noqa: N815
    path: tuple[str, ...] = Field(min_length=1)
    heading: Number
    instructions: tuple[str, ...]


@dataclass(frozen=True)
class ReverieEpisode:
    """What is asked: in building `scan`, from path[0], looking along heading_rad (clockwise from the world's y axis),
    walk to where the object is seen; the reference walks `path`."""

    scan: str
    object_id: int
    path: tuple[str, ...]
    heading_rad: float


@dataclass(frozen=True)
class Answer:
    """What an agent did: the viewpoints it walked through, first its start, and the object it named ("None": none)."""

    path: tuple[str, ...]
    object_id: str


class BuildingGraph:
    """Shortest ways between the viewpoints of a building, and which objects each of them shows."""

    def __init__(self, root: Path, scan: str) -> None:
        """Raises DataError on a missing or malformed connectivity file."""
        self._root, self._scan = root, scan
        self.number, self._distance_m = walking_distances(connectivity_path(root, scan))
        self._visible: dict[str, frozenset[int]] = {}

    def distance_m(self, start: str, end: str) -> float:
        """Length of the shortest way, inf where there is none."""
        return float(self._distance_m[self.number[start], self.number[end]])

    def shows(self, viewpoint: str, object_id: int) -> bool:
        """Whether any view of the viewpoint has the object, by REVERIE's boxes (within 3 m). Raises DataError on a
        missing box file."""
        if viewpoint not in self._visible:
            self._visible[viewpoint] = frozenset(read_boxes(boxes_path(self._root, self._scan, viewpoint), viewpoint))
        return object_id in self._visible[viewpoint]


def walking_distances(path: Path) -> tuple[dict[str, int], np.ndarray]:
    """Row of each included viewpoint of a connectivity file, by its id, and the (N, N) float64 lengths in metres of the
    shortest ways.

    Two included viewpoints are joined where the way between them is unobstructed; an edge is as long as the straight
    line in 3D.
    """
    from scipy.sparse.csgraph import dijkstra

    position_m = {viewpoint: pose[:3, 3] for viewpoint, pose in read_connectivity(path).items()}
    number = {viewpoint: row for row, viewpoint in enumerate(position_m)}
    straight_m = np.zeros((len(number), len(number)))
    for a, b in read_ways(path):
        if a in number and b in number:
            straight_m[number[a], number[b]] = np.linalg.norm(position_m[a] - position_m[b])
    return number, dijkstra(straight_m, directed=False)


def score_episode(name: str, episode: ReverieEpisode, answer: Answer, building: BuildingGraph) -> tuple[float, ...]:
    """The METRICS of one episode, each from 0 to 1. Raises DataError on a path that could not have been walked.

    A step between viewpoints that are not joined counts as long as the shortest way between them. Naming the object
    counts wherever the agent stopped.
    """
    for viewpoint in (*answer.path, episode.path[-1]):
        if viewpoint not in building.number:
            raise DataError(f"{name}: the viewpoint {viewpoint!r} is not one of building {episode.scan}")
    if answer.path[0] != episode.path[0]:
        raise DataError(f"{name}: the trajectory begins at {answer.path[0]}, expected the start {episode.path[0]}")
    walked_m = sum(building.distance_m(a, b) for a, b in zip(answer.path, answer.path[1:], strict=False))
    if not np.isfinite(walked_m):
        raise DataError(f"{name}: the trajectory jumps between viewpoints of {episode.scan} that no way joins")
    shortest_m = building.distance_m(episode.path[0], episode.path[-1])
    directness = shortest_m / max(walked_m, shortest_m, MIN_LENGTH_M)
    success = building.shows(answer.path[-1], episode.object_id)
    passed = any(building.shows(viewpoint, episode.object_id) for viewpoint in answer.path)
    named = answer.object_id == str(episode.object_id)
    return float(success), float(passed), success * directness, float(named), named * directness


def read_episodes(root: Path) -> dict[str, dict[str, ReverieEpisode]]:
    """The episodes of every REVERIE_<split>.json by split and instr_id; those whose answer is not published are left
    out. Raises DataError."""
    splits = {}
    for path in sorted((root / "reverie").glob("REVERIE_*.json")):
        tasks: list[_Task] = read_as(path, list[_Task])
        episodes = {
            f"{task.path_id}_{task.objId}_{i}": ReverieEpisode(task.scan, int(task.objId), task.path, task.heading)
            for task in tasks
            if task.objId is not None
            for i in range(len(task.instructions))
        }
        if episodes:
            splits[path.stem.removeprefix("REVERIE_")] = episodes
    if not splits:
        raise DataError(
            f"{root} has no episodes, expected reverie/REVERIE_<split>.json, reverie/BBox/*.json "
            "and connectivity/*.json in it"
        )
    return splits


def read_split(split: str, root: Path) -> dict[str, ReverieEpisode]:
    """The episodes of one split by instr_id. Raises UnknownName, DataError."""
    splits = read_episodes(root)
    if split not in splits:
        raise UnknownName(f"{root}: {unknown('split', split, list(splits))}")
    return splits[split]


def task_of(name: str) -> str:
    """What the instructions to one object along one path share of their instr_id."""
    return name.rpartition("_")[0]


def by_task(split: str, root: Path) -> dict[str, ReverieEpisode]:
    """The episodes of a split by `task_of` their names: one of each, for they differ in words alone."""
    return {task_of(name): episode for name, episode in read_split(split, root).items()}


def read_answers(content: Any, path: Path) -> dict[str, Answer]:
    """The answers in the content of a submission file, by instr_id; the first counts where there are two. `path`: the
    file, for messages.

    Raises DataError on another form than REVERIE's (`predObjId`, a step is [viewpoint, heading, elevation]) or that of
    the DUET family (`pred_objid`, trajectories nested one list deeper, steps may be bare viewpoints).
    """
    expected = 'a list of {"instr_id": ..., "trajectory": [[viewpoint, heading, elevation], ...], "predObjId": ...}'
    if isinstance(content, dict):  # eval_release takes a mapping too, whatever its keys
        content = list(content.values())
    if not isinstance(content, list):
        raise DataError(f"{path} holds {type(content).__name__}, expected {expected}")
    found: dict[str, Answer] = {}
    for position, item in enumerate(content):
        try:
            name, walked = item["instr_id"], tuple(viewpoints(item["trajectory"]))
            found.setdefault(name, Answer(walked, str(item.get("predObjId", item.get("pred_objid")))))
        except (AttributeError, KeyError, TypeError) as error:
            reason = f"no key {error}" if isinstance(error, KeyError) else str(error)
            raise DataError(f"{path}: answer {position}: {reason}; expected {expected}") from None
        if not walked:
            raise DataError(f"{path}: {name} has an empty trajectory, expected its start at least")
    return found


def viewpoints(trajectory: Any) -> Iterator[str]:
    """The viewpoints of a trajectory in order: of [viewpoint, heading, elevation], of bare viewpoints, and of lists of
    these."""
    if not isinstance(trajectory, list):
        raise TypeError(f"a trajectory of {type(trajectory).__name__}")
    if len(trajectory) == 3 and isinstance(trajectory[0], str) and not isinstance(trajectory[1], str):
        yield trajectory[0]
        return
    for step in trajectory:
        if isinstance(step, str):
            yield step
        else:
            yield from viewpoints(step)
