"""The role that `compare` knows: a panorama in, ranked places and a pose out."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator

from salframe.framework.auto import instead_of
from salframe.framework.cache import Cache
from salframe.framework.component import Role
from salframe.framework.config import ComponentConfig, Settings, match_only
from salframe.framework.errors import DataError, InputMissing
from salframe.framework.files import read_arrays, read_json, read_model, write_arrays, write_json
from salframe.framework.identity import digest, identity
from salframe.framework.registry import registry
from salframe.framework.slots import slot
from salframe.localization.answers import Localization, NodeMatches, PointMatches, RankedPlace
from salframe.localization.evidence import Evidence
from salframe.localization.posterior import Posterior, read_fitted
from salframe.panoramas.floors import FloorMasks, read_floors, write_floors
from salframe.panoramas.frames import FrameKind, MapFrame, QueryFrame
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.panoramas.range_model import RangeModel, estimate_range

Description = Mapping[str, np.ndarray]
"""What a localizer remembers of one panorama: named arrays (no object dtype), so that it can be cached, saved and
weighed."""

MAP, MAP_FORMAT = "map.json", 2
_Row = tuple[float, float, float, float]


class SavedFrame(Settings):
    """A mapping frame in map.json."""

    id: str
    place: str
    kind: FrameKind
    T_world_pano: tuple[_Row, _Row, _Row, _Row]


class SavedMap(Settings):
    """map.json: the localizer's version and settings, a digest of what its descriptions depend on, the frames in their
    order, and what floors.npz does not say of the floors, where any are known."""

    format: int
    version: str
    localizer: dict[str, Any]
    described_by: str
    frames: tuple[SavedFrame, ...]
    floors: tuple[dict[str, Any], ...] = ()


def range_slot() -> Any:
    """The type of a localizer's setting `range`: the range model for panoramas that have none."""
    return slot(RangeModel.role, optional=True, description="estimates the range of panoramas without; null: nothing")


def posterior_slot() -> Any:
    """The type of a localizer's setting `posterior`: what its scores are worth."""
    help = "a file of `salframe fit`, or its parameters: scores become probabilities; null: none"
    return Annotated[
        Posterior | None, BeforeValidator(partial(read_fitted, "posterior")), match_only(None, description=help)
    ]


class Localizer(Role):
    """Answers where a panorama was taken, from a map of described places.

    A localizer writes three hooks: `describe` a panorama, `index` the descriptions of the map, `match` a description
    against it. Map building, answering, caching, timing, saving and loading are the same for all; so is estimating the
    range of panoramas without, for a localizer whose Config has the field `range: range_slot()`, and making scores
    probabilities, for one whose Config has `posterior: posterior_slot()`.
    """

    role = "localizer"
    presets = "methods"
    word = "method"
    column_step: ClassVar[int] = 1
    """Turning the panorama by a multiple of this many columns turns the pose and nothing else."""
    turn_tolerance_m: ClassVar[float] = 1e-4
    """How far the pose may then move (metres), and be off the turn (radians: metres at an object 1 m away)."""
    range_model: RangeModel | None = None
    """What is set as `range`."""
    posterior: Posterior | None = None
    """What is set as `posterior`."""
    uses_floors: ClassVar[bool] = False
    """Whether `index` reads `floors`, which are then saved beside the map."""
    floors: tuple[FloorMasks, ...] = ()
    """The map's floors seen from above; none where they are not known, or not used."""

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self.posterior = getattr(self.config, "posterior", None)
        chosen = getattr(self.config, "range", None)
        if chosen is not None:
            self.range_model = registry().build(RangeModel.role, chosen)

    @property
    @abstractmethod
    def needs(self) -> frozenset[str]:
        """Which of "rgb", "range", "annotations" a panorama must have to be described."""

    @abstractmethod
    def describe(self, panorama: Panorama) -> Description:
        """What this method remembers of a panorama. Must not change its input."""

    @abstractmethod
    def index(self, descriptions: Sequence[Description], frames: Sequence[MapFrame]) -> None:
        """Take the map in: one description and one MapFrame (id, place, pose) a mapping frame."""

    @abstractmethod
    def match(self, description: Description) -> Localization:
        """Answer for one described query. Failing to localize is a status, never an exception."""

    def count_objects(self, description: Description) -> int:
        """How many objects a description holds, which a posterior may weigh; 0 from a method that knows of none."""
        return 0

    def answer(self, description: Description) -> Localization:
        """`match`, with the probabilities of the posterior that is set; those that the method has itself stay."""
        found = self.match(description)
        if self.posterior is None or not isinstance(found, Localization) or found.not_here is not None:
            return found
        return self.posterior.apply(found, self.count_objects(description))

    def correspond(self, query: Description, reference: Description) -> PointMatches | NodeMatches | None:
        """What it takes for the same in two panoramas, whatever map it holds; None from a method that matches neither
        points nor objects."""
        return None

    def evidence(self, description: Description) -> Evidence | None:
        """What its scores are made of for one described query, in the order of its setting `weights`; None from a
        method that weighs nothing, and of a query that it has nothing to weigh of."""
        return None

    def estimates(self, provides: frozenset[str]) -> bool:
        """Whether the range of panoramas that provide these parts is estimated: they have none, and a range model is
        set."""
        return self.range_model is not None and "range" not in provides

    def needs_of(self, provides: frozenset[str]) -> frozenset[str]:
        """What panoramas that provide these parts must have: `needs`, or what the range model needs instead of the
        range that they lack."""
        if self.range_model is None or not self.estimates(provides):
            return self.needs
        return (self.needs - {"range"}) | self.range_model.needs

    def complete(
        self, panorama: Panorama, cache: Cache | None = None, known_by: Mapping[str, str] | None = None
    ) -> tuple[Panorama, float]:
        """The panorama with what `needs` asks for, its range estimated where it has none and a range model is set, and
        the seconds that this took when it was done; cache and known_by as in `estimate_range`. Raises InputMissing."""
        if absent := self.needs_of(panorama.provides) - panorama.provides:
            raise InputMissing(self._lacks(panorama, absent))
        if self.range_model is None or not self.estimates(panorama.provides):
            return panorama, 0.0
        return estimate_range(self.range_model, panorama, cache, known_by)

    def describe_identity(self) -> dict[str, Any]:
        """What `describe` depends on besides the panorama: the settings that are not `match_only`, and the weights."""
        return identity(self.config, describing=True)

    def note(self, description: Description) -> str | None:
        """What the user must know of a description: what of the panorama it lacks; None where there is nothing."""
        return None

    def scene_bytes(self, description: Description) -> int:
        """Bytes that one place costs in the map."""
        return sum(array.nbytes for array in description.values())

    def describe_frame(
        self, frame: MapFrame | QueryFrame, cache: Cache | None = None, dataset: str = ""
    ) -> tuple[Description, float]:
        """The description of a frame and the seconds it took when it was computed, loading the panorama not counted.

        With a cache, `dataset` (its content_key) and the frame's id stand for the panorama. Raises InputMissing,
        DataError.
        """
        known_by = {"dataset": dataset, "frame": frame.id}
        if cache is not None:
            key = {**known_by, "describe": self.describe_identity()}
            known = cache.get(key)
            if known is not None:
                return known
        panorama, estimate_s = self.complete(frame.load(), cache, known_by)
        start = time.perf_counter()
        description = self.describe(panorama)
        seconds = estimate_s + time.perf_counter() - start
        if cache is not None:
            cache.put(key, description, seconds)
        return description, seconds

    def build(
        self,
        frames: Sequence[MapFrame],
        cache: Cache | None = None,
        dataset: str = "",
        progress: Callable[[int, int], None] | None = None,
        floors: Sequence[FloorMasks] = (),
    ) -> list[str]:
        """Describe the mapping frames and index them, on floors where they are known; what the user must know of the
        descriptions. Raises DataError where there is no frame."""
        if not frames:
            raise DataError("a map needs at least one mapping frame, received none")
        descriptions = []
        for done, frame in enumerate(frames):
            if progress:
                progress(done, len(frames))
            descriptions.append(self.describe_frame(frame, cache, dataset)[0])
        self.take_map(descriptions, frames, floors)
        if progress:
            progress(len(frames), len(frames))
        notes = ((frame, self.note(known)) for frame, known in zip(frames, descriptions, strict=True))
        return [f"{frame.id}: {note}" for frame, note in notes if note]

    def take_map(
        self, descriptions: Sequence[Description], frames: Sequence[MapFrame], floors: Sequence[FloorMasks] = ()
    ) -> None:
        """Index described frames, on floors where they are known, and remember them for `save`."""
        self._descriptions, self._frames = list(descriptions), list(frames)
        self.floors = tuple(floors) if self.uses_floors else ()
        self.index(self._descriptions, self._frames)

    def localize(
        self,
        asked: MapFrame | QueryFrame | Panorama | None = None,
        *,
        rgb: np.ndarray | None = None,
        range_m: np.ndarray | None = None,
        annotations: Annotations | None = None,
    ) -> Localization:
        """Where a frame or a panorama was taken, or what the images of a panorama show: rgb (H, 2H, 3) uint8, range_m
        (H, 2H) float32, metres along the ray, NaN where unknown, or annotations.

        Raises InputMissing where the method needs something else, and says with which detector the map would not;
        DataError on images that do not fit.
        """
        if asked is None:
            asked = Panorama("the panorama", rgb, range_m, annotations=annotations)
        elif any(image is not None for image in (rgb, range_m, annotations)):
            raise DataError(f"received both {asked.id} and images of another panorama, expected one of them")
        if not isinstance(asked, Panorama):
            return self.answer(self.describe_frame(asked)[0])
        if absent := self.needs_of(asked.provides) - asked.provides:
            raise InputMissing(f"{self._lacks(asked, absent)}: {instead_of(self.config, asked.provides)}")
        return self.answer(self.describe_frame(QueryFrame(asked.id, lambda: asked))[0])

    def _lacks(self, panorama: Panorama, absent: Iterable[str]) -> str:
        return f"{self.name} needs {' and '.join(sorted(absent))}, which {panorama.id} does not have"

    def save(self, directory: Path) -> None:
        """Write the map: map.json (frames, poses, this localizer's settings) and its descriptions, each file
        atomically."""
        directory.mkdir(parents=True, exist_ok=True)
        self.write_descriptions(directory, self._descriptions)
        frames = [
            {"id": f.id, "place": f.place, "kind": f.kind, "T_world_pano": f.T_world_pano.tolist()}
            for f in self._frames
        ]
        content = {
            "format": MAP_FORMAT,
            "version": self.version,
            "localizer": self.config.model_dump(mode="json"),
            "described_by": digest(self.describe_identity()),
            "frames": frames,
            **({"floors": write_floors(directory, self.floors)} if self.floors else {}),
        }
        write_json(directory / MAP, content)

    def load(self, directory: Path) -> None:
        """Read a map that `save` wrote.

        Raises DataError on another format, method or version, on a map whose descriptions this localizer would make
        otherwise (settings, weights, files of the user's), and on one that is damaged.
        """
        saved = read_map(directory)
        kind = saved.localizer.get("kind")
        if (kind, saved.version) != (self.name, self.version):
            made = f"{kind} {saved.version}"
            raise DataError(f"{directory} was made by {made}, expected {self.name} {self.version}: build it again")
        if saved.described_by != digest(self.describe_identity()):
            raise DataError(
                f"{directory} was described with other settings, weights or files than {self.name} has now: "
                "build it again"
            )
        frames = [MapFrame(f.id, f.place, np.array(f.T_world_pano), f.kind) for f in saved.frames]
        descriptions = self.read_descriptions(directory, len(frames))
        if len(descriptions) != len(frames):
            raise _miscounted(directory, len(descriptions), len(frames))
        try:
            floors = read_floors(directory, saved.floors) if saved.floors else ()
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise DataError(
                f"{directory} tells no whole floor ({type(error).__name__}: {error}): build it again"
            ) from None
        self.take_map(descriptions, frames, floors)

    def write_descriptions(self, directory: Path, descriptions: Sequence[Description]) -> None:
        """Write the map's descriptions: one compressed array archive, unless overridden."""
        arrays = {
            f"{i}/{name}": array for i, description in enumerate(descriptions) for name, array in description.items()
        }
        write_arrays(directory / "descriptions.npz", {"count": np.array(len(descriptions)), **arrays})

    def read_descriptions(self, directory: Path, count: int) -> Sequence[Description]:
        """Read what `write_descriptions` wrote, `count` descriptions in order. Raises DataError where there are more or
        fewer."""
        arrays = read_arrays(directory / "descriptions.npz")
        written = int(arrays.pop("count", np.array(-1)))
        if written != count:
            raise _miscounted(directory, written, count)
        descriptions: list[dict[str, np.ndarray]] = [{} for _ in range(count)]
        for key, array in arrays.items():
            position, _, name = key.partition("/")
            descriptions[int(position)][name] = array
        return descriptions


def read_map(directory: Path) -> SavedMap:
    """What map.json in a folder says. Raises DataError, in one line, on another format and on whatever is wrong."""
    content = read_json(directory / MAP)
    if isinstance(content, Mapping) and content.get("format", MAP_FORMAT) != MAP_FORMAT:
        raise DataError(f"{directory} has map format {content['format']}, expected {MAP_FORMAT}: build it again")
    return read_model(directory / MAP, SavedMap)


def _miscounted(directory: Path, descriptions: int, frames: int) -> DataError:
    return DataError(
        f"{directory} has {descriptions} descriptions and {frames} frames, expected one each: build it again"
    )


def rank_places(
    frames: Sequence[MapFrame], scores: np.ndarray, T_world_query: np.ndarray | None = None
) -> tuple[RankedPlace, ...]:
    """The places of scored frames, best first, each by its best frame; ties keep the order of the map. scores (K,),
    -inf: no candidate.

    Where the best frame is a transition and the pose is known, the scene frame nearest to the pose comes first with
    that score: a doorway lies between places, and the pose tells which of them the query stands in.
    """
    order = [int(i) for i in np.argsort(-scores, kind="stable") if np.isfinite(scores[i])]
    value = scores.astype(np.float64)
    if T_world_query is not None and order and frames[order[0]].kind is FrameKind.TRANSITION:
        scenes = [i for i, frame in enumerate(frames) if frame.kind is FrameKind.SCENE]
        if scenes:
            nearest = min(
                scenes, key=lambda i: float(np.linalg.norm(frames[i].T_world_pano[:3, 3] - T_world_query[:3, 3]))
            )
            value[nearest] = value[order[0]]
            order = [nearest, *(i for i in order if i != nearest)]
    ranked: dict[str, RankedPlace] = {}
    for i in order:
        ranked.setdefault(frames[i].place, RankedPlace(frames[i].id, frames[i].place, float(value[i])))
    return tuple(ranked.values())
