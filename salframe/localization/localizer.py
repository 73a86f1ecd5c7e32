"""The role that `compare` knows: a panorama in, ranked places and a pose out."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator

from salframe.framework.auto import instead_of
from salframe.framework.cache import Cache
from salframe.framework.columns import Columns
from salframe.framework.component import Role
from salframe.framework.config import ComponentConfig, match_only
from salframe.framework.errors import DataError, InputMissing, describe_error
from salframe.framework.identity import digest, identity
from salframe.framework.registry import registry
from salframe.framework.slots import slot
from salframe.graphs.scene_index import scene_index_notes
from salframe.localization.answers import Localization, NodeMatches, PointMatches, RankedPlace
from salframe.localization.evidence import Evidence
from salframe.localization.map_folder import read_map, write_map
from salframe.localization.map_parts import INDEX, SavedFrames, check_method, read_scenes, write_method, write_scenes
from salframe.localization.posterior import Posterior, read_fitted
from salframe.panoramas.floors import FLOORS, FloorMasks, read_floors, write_floors
from salframe.panoramas.frames import FrameKind, MapFrame, QueryFrame
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.panoramas.range_model import RangeModel, estimate_range

Description = Mapping[str, np.ndarray]
"""What a localizer remembers of one panorama: named arrays (no object dtype), so that it can be cached, saved and
weighed."""


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
    uses: ClassVar[frozenset[str]] = frozenset()
    """Which parts of a panorama it makes use of where they are there, besides those that it needs."""
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

    def write_index(self, folder: Path) -> None:
        """Write what `index` made to a new folder among the parts of a map, so that it opens without indexing: an
        option, to be taken together with `open_index`. Unless overridden nothing is written, and a map is indexed anew
        when it is opened."""

    def open_index(self, folder: Path, packed: Columns, frames: SavedFrames) -> None:
        """Take the map in as `index` did before `write_index`, for the same answers: by mapping into memory what that
        wrote, what is kept of descriptions (`pack`), and frames. `folder` and those of the two sequences may be removed
        while this localizer is in use."""
        raise NotImplementedError(f"{self.name} writes an index, expected that it opens it too")

    def describe_identity(self) -> dict[str, Any]:
        """What `describe` depends on besides the panorama: the settings that are not `match_only`, and the weights."""
        return identity(self.config, describing=True)

    def note(self, description: Description) -> str | None:
        """What the user must know of a description: what of the panorama it lacks; None where there is nothing."""
        return None

    def pack(self, description: Description) -> Description:
        """What a map keeps of a description: all of it, unless overridden by arrays that take less."""
        return description

    def unpack(self, packed: Description) -> Description:
        """The description that was packed, to the rounding of `pack`."""
        return packed

    def describe_frame(
        self, frame: MapFrame | QueryFrame, cache: Cache | None = None, dataset: str = ""
    ) -> tuple[Description, float]:
        """The description of a frame and the seconds it took when it was computed, loading the panorama not counted.

        With a cache, the frame's id and `content`, or where it has none `dataset` (its content_key), stand for the
        panorama. Raises InputMissing, DataError.
        """
        known_by = {"dataset": frame.content or dataset, "frame": frame.id}
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
        descriptions and of the scene index. Raises DataError where there is no frame."""
        packed, notes = self._describe_all(frames, cache, dataset, progress)
        self._take_packed(packed, frames, floors)
        return [*notes, *scene_index_notes(self.config, len(self._frames))]

    def extend(
        self,
        frames: Sequence[MapFrame],
        cache: Cache | None = None,
        dataset: str = "",
        progress: Callable[[int, int], None] | None = None,
        floors: Sequence[FloorMasks] = (),
    ) -> list[str]:
        """Describe more mapping frames, which replace those of their places in the map that it remembers, and index
        all, on what are its floors from now on; notes and errors as of `build`."""
        packed, notes = self._describe_all(frames, cache, dataset, progress)
        self._replace({frame.place for frame in frames}, packed, frames, floors)
        return [*notes, *scene_index_notes(self.config, len(self._frames))]

    def remove(self, places: Collection[str], floors: Sequence[FloorMasks] = ()) -> None:
        """Forget the frames of some places of the map that it remembers, and index the others, on what are its floors
        from now on."""
        self._replace(places, [], [], floors)

    def merge(self, others: Sequence[Localizer], floors: Sequence[FloorMasks] = ()) -> None:
        """Index what localizers that describe alike remember beside what this one does, on what are its floors from
        now on."""
        packed = [row for other in others for row in other._packed]
        self._replace((), packed, [frame for other in others for frame in other._frames], floors)

    @property
    def mapped_frames(self) -> tuple[MapFrame, ...]:
        """The frames of the map that it remembers."""
        return tuple(self._frames)

    def _describe_all(
        self, frames: Sequence[MapFrame], cache: Cache | None, dataset: str, progress: Callable[[int, int], None] | None
    ) -> tuple[list[Description], list[str]]:
        """What a map keeps of frames, and what the user must know of their descriptions."""
        if not frames:
            raise DataError("a map needs at least one mapping frame, received none")
        packed, notes = [], []
        for done, frame in enumerate(frames):
            if progress:
                progress(done, len(frames))
            description, _ = self.describe_frame(frame, cache, dataset)
            packed.append(self.pack(description))
            if note := self.note(description):
                notes.append(f"{frame.id}: {note}")
        if progress:
            progress(len(frames), len(frames))
        return packed, notes

    def _replace(
        self,
        places: Collection[str],
        packed: Sequence[Description],
        frames: Sequence[MapFrame],
        floors: Sequence[FloorMasks],
    ) -> None:
        """Forget the frames of some places, and index the others with more, which come last."""
        kept = [i for i, frame in enumerate(self._frames) if frame.place not in places]
        remembered = [*(self._packed[i] for i in kept), *packed]
        with self._checking("the map"):
            self._take_packed(remembered, [*(self._frames[i] for i in kept), *frames], floors)

    def take_map(
        self, descriptions: Sequence[Description], frames: Sequence[MapFrame], floors: Sequence[FloorMasks] = ()
    ) -> None:
        """Index described frames, on floors where they are known, as a map keeps them: packed and unpacked."""
        self._take_packed([self.pack(description) for description in descriptions], frames, floors)

    def _take_packed(
        self, packed: Sequence[Description], frames: Sequence[MapFrame], floors: Sequence[FloorMasks]
    ) -> None:
        self._packed: Sequence[Description] = packed
        self._frames: Sequence[MapFrame] = list(frames)
        self.floors = tuple(floors) if self.uses_floors else ()
        self._index_packed()

    def _index_packed(self) -> None:
        self.index([self.unpack(description) for description in self._packed], list(self._frames))

    @contextmanager
    def _checking(self, what: str) -> Iterator[None]:
        """Blame what was saved, `what`, for arrays that the method cannot index: which there must be, only it knows."""
        try:
            yield
        except (IndexError, KeyError, TypeError, ValueError) as error:
            reason = describe_error(error)
            raise DataError(f"{what} is not what {self.name} wrote ({reason}): build it again") from error

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

    def save(self, directory: Path, *, indexed: bool = True) -> None:
        """Write the map to a folder, which changes whole; without its index where that is not wanted. Raises
        ConfigError where it holds something else than a map."""
        with write_map(directory) as parts:
            self.write_parts(parts, indexed=indexed)

    def load(self, directory: Path) -> None:
        """Read a map that `save` wrote.

        Raises DataError on another format, method or version, on a map whose descriptions this localizer would make
        otherwise (settings, weights, files of the user's), and on one that was edited or is not whole.
        """
        read_map(directory, self.read_parts)

    def write_parts(self, parts: Path, *, indexed: bool = True) -> None:
        """Write this localizer's parts of a map to a folder: method.json, frames, scenes, floors where it uses them,
        and its index where that is wanted and `write_index` is overridden."""
        write_method(parts, self.version, self.config, digest(self.describe_identity()))
        write_scenes(parts, self._packed, self._frames)
        if self.floors:
            write_floors(parts, self.floors)
        if indexed:
            self.write_index(self._index_folder(parts))

    def read_parts(self, parts: Path) -> None:
        """Read what `write_parts` wrote. Raises DataError as `load`."""
        packed, frames = self.remember(parts)
        index = self._index_folder(parts)
        with self._checking(str(parts)):
            if index.exists():
                self.open_index(index, packed, frames)
            else:
                self._index_packed()

    def _index_folder(self, parts: Path) -> Path:
        """Where the index lies that a localizer of these settings makes of a map, if it writes any."""
        return parts / f"{INDEX}-{digest(identity(self.config))[:16]}"

    def remember(self, parts: Path) -> tuple[Columns, SavedFrames]:
        """Read what `write_parts` wrote, packed descriptions and their frames, and index nothing: it may be extended,
        merged and written again, not asked. Raises DataError as `load`."""
        check_method(parts, self.name, self.version, digest(self.describe_identity()))
        self._packed, self._frames = packed, frames = read_scenes(parts)
        self.floors = read_floors(parts) if self.uses_floors and (parts / FLOORS).exists() else ()
        return packed, frames


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
