"""The scorer `reverie`: an agent's answers to REVERIE, scored by the rules of the task's official evaluation.

REVERIE: Qi et al., "REVERIE: Remote Embodied Visual Referring Expression in Real Indoor Environments", CVPR 2020. Paths
are scored as in its `eval_release.py`. That script does not score objects; object metrics follow the evaluation of DUET
(Chen et al., CVPR 2022), which later agents report.
"""

from __future__ import annotations

import logging
import math
import re
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

_log = logging.getLogger("salframe.reverie")
METRICS = ("SR", "OSR", "SPL", "RGS", "RGSPL")
MIN_LENGTH_M = 0.01
"""Minimum divisor of SPL in metres, as in DUET. It is used if neither the agent nor the reference path moves."""
NAMED = 5
"""Maximum number of instructions without an answer that an error lists."""


class Reverie(Scorer):
    """The metrics of the benchmark REVERIE. An agent moves to the viewpoint that shows a target object, and identifies
    the object.

    SR (success rate), OSR (oracle success rate) and SPL (success weighted by path length) measure whether the agent
    reaches the viewpoint. RGS (remote grounding success) and RGSPL (RGS weighted by path length) measure whether it
    identifies the object.
    """

    name = "reverie"
    version = "1"

    def score(self, answers: Path, root: Path) -> Sequence[Mapping[str, Any]]:
        """See Scorer. Metrics are percentages with two decimals. Lengths are shortest paths in the viewpoint graph.

        A split is scored if the file answers any of its instructions; the file must then answer all of them. The column
        `ignored` counts answers to instructions that `root` does not have, and repeated answers to one instruction.
        """
        splits = read_episodes(root)
        content = read_json(answers)
        answer_by_id = read_answers(content, answers)
        scored = {split: episodes for split, episodes in splits.items() if not answer_by_id.keys().isdisjoint(episodes)}
        if not scored:
            available = ", ".join(f"{split} ({len(episodes)} instructions)" for split, episodes in splits.items())
            raise DataError(
                f"none of the answers in {answers} belongs to an instruction of {root}, expected answers to the "
                f"instructions of at least one split ({available})"
            )
        for split, episodes in scored.items():
            missing = [name for name in episodes if name not in answer_by_id]
            if missing:
                listed = ", ".join(missing[:NAMED]) + (", ..." if len(missing) > NAMED else "")
                raise DataError(
                    f"{answers} has no answer to {len(missing)} of the {len(episodes)} instructions of the split "
                    f"{split}, expected an answer to each; missing: {listed}"
                )
        buildings = {
            scan: BuildingGraph(root, scan)
            for episodes in scored.values()
            for scan in {e.scan for e in episodes.values()}
        }
        ignored = len(content) - sum(map(len, scored.values()))
        rows = []
        for split, episodes in scored.items():
            scores = np.array(
                [
                    score_episode(name, episode, answer_by_id[name], buildings[episode.scan])
                    for name, episode in episodes.items()
                ]
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
        hidden = [
            name
            for episodes in scored.values()
            for name, episode in episodes.items()
            if not buildings[episode.scan].shows(episode.path[-1], episode.object_id)
        ]
        if hidden:
            _log.warning(
                "%s: for %d of %d instructions, the target object is not in the box file (reverie/BBox) of the last "
                "viewpoint of the reference path, such as %s",
                *(root, len(hidden), sum(map(len, scored.values())), hidden[0]),
            )
        return rows

    def episodes(self, split: str, root: Path) -> Sequence[EpisodeRequest]:
        """See Scorer. All instructions to the same object along the same path share one episode, whose goal is the end
        of the path."""
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
        """See Scorer. Return the same answer to all instructions of a task, without an object.

        Headings are clockwise from the world's y axis, as in the simulator; elevations are 0.
        """
        tasks = by_task(split, root)
        camera = {
            scan: read_connectivity(connectivity_path(root, scan)) for scan in {task.scan for task in tasks.values()}
        }
        trajectory = {}
        for (name, task), poses in zip(tasks.items(), walked, strict=True):
            if poses is None:
                trajectory[name] = [[task.path[0], task.heading_rad, 0.0]]
                continue
            viewpoints, camera_m = list(camera[task.scan]), np.array([T[:3, 3] for T in camera[task.scan].values()])
            nearest = np.linalg.norm(poses[:, None, :3] - camera_m, axis=2).argmin(1)
            heading = (math.pi / 2 - poses[:, 3]) % (2 * math.pi)
            trajectory[name] = [[viewpoints[i], float(h), 0.0] for i, h in zip(nearest, heading, strict=True)]
        return [
            {"instr_id": name, "trajectory": trajectory[task_of(name)], "predObjId": None}
            for name in read_split(split, root)
        ]


class _ReverieTask(BaseModel):
    """An entry of REVERIE_<split>.json: the task to find a target object. `objId`, the id of this object, is not
    published for every split."""

    path_id: int | str
    scan: str
    objId: int | Annotated[str, Field(pattern="^[0-9]{1,9}$")] | None = None  # noqa: N815
    path: tuple[str, ...] = Field(min_length=1)
    heading: Number
    instructions: tuple[str, ...]


@dataclass(frozen=True)
class ReverieEpisode:
    """A task for an agent: in building `scan`, starting at path[0], walk to a viewpoint that shows the target object.

    Attributes:
        scan: Building.
        object_id: Id of the target object.
        path: Viewpoints of the reference path.
        heading_rad: Heading at the start, clockwise from the world's y axis.
    """

    scan: str
    object_id: int
    path: tuple[str, ...]
    heading_rad: float


@dataclass(frozen=True)
class Answer:
    """The answer of an agent.

    Attributes:
        path: Viewpoints of the agent's path, including the start.
        object_id: Id of the object that the agent named; "None": no object.
    """

    path: tuple[str, ...]
    object_id: str


class BuildingGraph:
    """Shortest paths between the viewpoints of a building, and the objects that each viewpoint shows."""

    def __init__(self, root: Path, scan: str) -> None:
        """Read the graph. Raises DataError if the connectivity file is missing or malformed."""
        self._root, self._scan = root, scan
        self.number, self._distance_m = walking_distances(connectivity_path(root, scan))
        self._visible: dict[str, frozenset[int]] = {}

    def distance_m(self, start: str, end: str) -> float:
        """Return the length of the shortest path between two viewpoints in metres; inf if there is none."""
        return float(self._distance_m[self.number[start], self.number[end]])

    def shows(self, viewpoint: str, object_id: int) -> bool:
        """Return whether REVERIE's boxes (objects within 3 m) contain the object in any view of the viewpoint.

        Raises:
            DataError: The box file is missing.
        """
        if viewpoint not in self._visible:
            self._visible[viewpoint] = frozenset(read_boxes(boxes_path(self._root, self._scan, viewpoint), viewpoint))
        return object_id in self._visible[viewpoint]


def walking_distances(path: Path) -> tuple[dict[str, int], np.ndarray]:
    """Compute shortest paths between the included viewpoints of a connectivity file.

    Two included viewpoints are connected if the way between them is unobstructed. The length of an edge is its 3D
    length.

    Returns:
        Mapping from viewpoint id to row, and path lengths (N, N) float64 in metres.
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
    """Return the METRICS of one episode, each from 0 to 1.

    A step between viewpoints that are not neighbours has the length of the shortest path between them. The named object
    is scored regardless of where the agent stopped.

    Raises:
        DataError: The path does not begin at the start, contains an unknown viewpoint, or contains a step between two
            viewpoints that are not connected by any path in the building.
    """
    for viewpoint in (*answer.path, episode.path[-1]):
        if viewpoint not in building.number:
            raise DataError(
                f"the answer {name}: the viewpoint {viewpoint!r} is not in the building {episode.scan}, expected only "
                "viewpoints of this building"
            )
    if answer.path[0] != episode.path[0]:
        raise DataError(
            f"the answer {name}: the trajectory begins at the viewpoint {answer.path[0]}, expected {episode.path[0]}, "
            "the start of its instruction"
        )
    walked_m = sum(building.distance_m(a, b) for a, b in zip(answer.path, answer.path[1:], strict=False))
    if not np.isfinite(walked_m):
        raise DataError(
            f"the answer {name}: the trajectory jumps between viewpoints of the building {episode.scan} that no path "
            "connects, expected connected viewpoints"
        )
    shortest_m = building.distance_m(episode.path[0], episode.path[-1])
    directness = shortest_m / max(walked_m, shortest_m, MIN_LENGTH_M)
    success = building.shows(answer.path[-1], episode.object_id)
    was_visible = any(building.shows(viewpoint, episode.object_id) for viewpoint in answer.path)
    is_named = answer.object_id == str(episode.object_id)
    return float(success), float(was_visible), success * directness, float(is_named), is_named * directness


def read_episodes(root: Path) -> dict[str, dict[str, ReverieEpisode]]:
    """Read the episodes of every REVERIE_<split>.json, by split and instr_id.

    Episodes without a published object id are left out. Raises DataError if no episode is left.
    """
    splits = {}
    for path in sorted((root / "reverie").glob("REVERIE_*.json")):
        tasks: list[_ReverieTask] = read_as(path, list[_ReverieTask])
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
            f"{root} has no episodes, expected a folder with reverie/REVERIE_<split>.json, reverie/BBox/*.json "
            "and connectivity/*.json"
        )
    return splits


def read_split(split: str, root: Path) -> dict[str, ReverieEpisode]:
    """Read the episodes of one split, by instr_id.

    Raises:
        UnknownName: The split does not exist.
        DataError: The files are missing or malformed.
    """
    splits = read_episodes(root)
    if split not in splits:
        raise UnknownName(f"{root}: {unknown('split', split, list(splits))}")
    return splits[split]


def task_of(name: str) -> str:
    """Return the task of an instr_id: the part of the id that is the same for all instructions that lead to the same
    object along the same path."""
    return name.rpartition("_")[0]


def by_task(split: str, root: Path) -> dict[str, ReverieEpisode]:
    """Read one episode per task. The keys are the results of `task_of`. Episodes of one task differ only in their
    instruction."""
    return {task_of(name): episode for name, episode in read_split(split, root).items()}


def read_answers(content: Any, path: Path) -> dict[str, Answer]:
    """Parse the answers of a submission file, by instr_id. Of several answers to an instruction, the first is used.

    Two formats are accepted: the format of REVERIE (`predObjId`, steps are [viewpoint, heading, elevation]), and the
    format of the DUET family (`pred_objid`, trajectories nested one list deeper, steps may be viewpoints only).

    Args:
        content: Parsed JSON of the file.
        path: Path of the file, for error messages.

    Raises:
        DataError: The content has another format.
    """
    expected = 'a list of {"instr_id": ..., "trajectory": [[viewpoint, heading, elevation], ...], "predObjId": ...}'
    if isinstance(content, dict):  # eval_release also accepts a mapping and ignores its keys
        content = list(content.values())
    if not isinstance(content, list):
        raise DataError(f"{path} contains {type(content).__name__}, expected {expected}")
    answers: dict[str, Answer] = {}
    keyless, unnamed = 0, 0
    for position, item in enumerate(content):
        try:
            name, walked = item["instr_id"], tuple(viewpoints(item["trajectory"]))
            named = item.get("predObjId", item.get("pred_objid"))
            answers.setdefault(name, Answer(walked, _object_id(named, f"{path}: the answer {name}")))
            keyless += "predObjId" not in item and "pred_objid" not in item
            unnamed += named is None
        except (AttributeError, KeyError, TypeError) as error:
            reason = f"no key {error}" if isinstance(error, KeyError) else str(error)
            raise DataError(
                f"{path}: answer {position + 1} of {len(content)} is invalid ({reason}), expected {expected}"
            ) from None
        if not walked:
            raise DataError(f"{path}: the answer {name} has an empty trajectory, expected at least the first viewpoint")
    if keyless:
        _log.warning(
            "%s: %d of %d answers have no key predObjId (or pred_objid), and count as answers without an object",
            *(path, keyless, len(content)),
        )
    elif 0 < unnamed < len(content):
        _log.warning(
            "%s: %d of %d answers name no object, and count as failures in RGS (remote grounding success)",
            *(path, unnamed, len(content)),
        )
    return answers


def _object_id(named: Any, where: str) -> str:
    """Return the object id of an answer as text.

    Raises:
        DataError: The id is not an integer of at most 9 digits (as a number or as text), "None" or null.
    """
    is_typed = isinstance(named, int | str | None) and not isinstance(named, bool)
    if not is_typed or not re.fullmatch("-?[0-9]{1,9}|None", str(named)):
        raise DataError(
            f"{where} names the object {named!r:.60}, expected an integer id of at most 9 digits, or null for no object"
        )
    return str(named)


def viewpoints(trajectory: Any) -> Iterator[str]:
    """Yield the viewpoints of a trajectory in order.

    A step is [viewpoint, heading, elevation], a viewpoint, or a list of steps.
    """
    if not isinstance(trajectory, list):
        raise TypeError(f"the trajectory has the type {type(trajectory).__name__}, not list")
    if len(trajectory) == 3 and isinstance(trajectory[0], str) and not isinstance(trajectory[1], str):
        angles = trajectory[1:]
        if any(isinstance(angle, bool) or not isinstance(angle, int | float) for angle in angles):
            raise TypeError(f"the heading and elevation of a step are {angles!r:.60}, not numbers")
        yield trajectory[0]
        return
    for step in trajectory:
        if isinstance(step, str):
            yield step
        else:
            yield from viewpoints(step)
