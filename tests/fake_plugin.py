"""A tiny dataset and localizers that behave in known ways, for the tests of runs, metrics and the command line.

The dataset is a row of rooms 4 m apart; the panorama of a frame is one pixel row that holds the room's number and the
frame's yaw.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from functools import partial

import numpy as np
from pydantic import Field

import salframe
from salframe.framework.component import ComponentConfig
from salframe.framework.errors import DataError, WeightsError
from salframe.framework.files.hashes import digest
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.localizer import Description, Localizer, posterior_slot
from salframe.localization.ranking import rank_places
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame, Truth
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.hidden_places import add_hidden_places, hide_query_place_setting
from salframe.panoramas.panorama import Panorama


class Rooms(Dataset):
    """Rooms in a row, two queries each; the panorama of a frame shows its room's number."""

    name = "rooms"
    version = "1"
    provides = frozenset({"rgb"})

    class Config(ComponentConfig):
        rooms: int = Field(5, ge=0, description="how many rooms")
        queries: int = Field(2, ge=0, description="queries a room")
        posed: bool = True
        broken: tuple[str, ...] = Field((), description="ids of frames whose image is corrupt")
        leave_one_out: bool = False
        seed: int = Field(0, description="another seed is another data set of the same rooms")
        root: str = ""
        hide_query_place: bool = hide_query_place_setting()

    @property
    def fingerprint(self) -> str:
        return digest(self.config.model_dump(mode="json", exclude={"hide_query_place"})) + os.environ.get(
            "ROOMS_CONTENT", ""
        )

    def prepare(self, progress) -> None:
        progress(self.config.rooms, self.config.rooms)

    def _load(self, name: str, room: int, column: int) -> Panorama:
        if name in self.config.broken:
            raise DataError(f"{name}.png is no image")
        rgb = np.full((4, 8, 3), room, np.uint8)
        rgb[..., 1] = column
        return Panorama(name, rgb)

    def _map_frame(self, room: int) -> ReferenceFrame:
        name = f"map-{room}"
        return ReferenceFrame(name, f"room-{room}", pose_2d(4.0 * room, 0, 0), load=partial(self._load, name, room, 0))

    def _query_frame(self, room: int, query: int) -> QueryFrame:
        name = f"query-{room}-{query}"
        return QueryFrame(name, partial(self._load, name, room, query + 1))

    def folds(self) -> Sequence[Fold]:
        mapping = tuple(self._map_frame(room) for room in range(self.config.rooms))
        queries = tuple(
            self._query_frame(room, query) for room in range(self.config.rooms) for query in range(self.config.queries)
        )
        if not self.config.leave_one_out:
            folds = [Fold("all", mapping, queries)]
        else:
            folds = [Fold(query.id, mapping, (query,)) for query in queries]
        return add_hidden_places(folds, self.truth) if self.config.hide_query_place else folds

    def floors(self) -> Sequence[FloorMasks]:
        """A corridor of rooms 4 m x 3 m, 0.2 m thick walls, a table in each."""
        if not self.config.posed:
            return ()
        region = np.zeros((16, 20 * self.config.rooms), np.int32)
        obstacle = np.zeros(region.shape, bool)
        for room in range(self.config.rooms):
            region[1:15, 20 * room + 1 : 20 * room + 19] = room + 1
            obstacle[3:6, 20 * room + 12 : 20 * room + 16] = True
        places = {room + 1: f"room-{room}" for room in range(self.config.rooms)}
        return [FloorMasks((region > 0) & ~obstacle, region, obstacle, 0.2, (-2.0, 1.6), places)]

    def truth(self, query_id: str) -> Truth:
        _, room, query = query_id.split("-")
        pose = pose_2d(4.0 * int(room) + 0.1 * (int(query) + 1), 0, 0) if self.config.posed else None
        return Truth(f"room-{room}", pose)


class Reader(Localizer):
    """Reads the room's number off the image; `offset` makes it wrong by so many rooms."""

    name = "reader"
    version = "1"
    needs = frozenset({"rgb"})

    class Config(ComponentConfig):
        offset: int = Field(0, description="rooms to be wrong by")
        wrong_from: int = Field(99, description="be wrong from this room on")
        fail_in: int = Field(-1, description="raise on queries of this room")
        refuse_in: int = Field(-1, description="answer low-score in this room")
        sleep_s: float = Field(0.0, description="seconds a query takes", ge=0)
        posterior: posterior_slot()  # type: ignore[valid-type]

    def describe(self, panorama: Panorama) -> Description:
        return {"room": panorama.rgb[0, 0, :2].astype(np.int64)}

    def describe_identity(self):
        return {"name": self.name}

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        self.frames, self.rooms = frames, np.array([d["room"][0] for d in descriptions])

    def match(self, description: Description) -> Localization:
        time.sleep(self.config.sleep_s)
        room = int(description["room"][0])
        if room == self.config.fail_in:
            raise ValueError("this room is too much")
        if room == self.config.refuse_in:
            return Localization((), None, LocalizationStatus.LOW_SCORE)
        shift = self.config.offset if room < self.config.wrong_from else 1
        scores = self.scores(np.abs(self.rooms - (room + shift)).astype(float))
        places = rank_places(self.frames, scores)
        best = next(frame for frame in self.frames if frame.id == places[0].frame)
        return Localization(places, best.T_world_pano, LocalizationStatus.OK)

    def scores(self, distance: np.ndarray) -> np.ndarray:
        return -distance


class Clear(Reader):
    """A Reader whose scores of all wrong rooms are nearly the same."""

    name = "clear"

    def scores(self, distance: np.ndarray) -> np.ndarray:
        return -np.minimum(distance, 1) - 0.01 * distance


class Greedy(Reader):
    """Holds on to 200 MB while it matches."""

    name = "greedy"

    def match(self, description: Description) -> Localization:
        self.hoard = np.ones(25_000_000)
        return super().match(description)


class Suicidal(Reader):
    """Takes its process down, as a segmentation fault would."""

    name = "suicidal"

    def match(self, description: Description) -> Localization:
        os.kill(os.getpid(), 9)
        raise AssertionError


class Unbuildable(Reader):
    """Raises when the map is built."""

    name = "unbuildable"

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        raise RuntimeError("no map for you")


class Weightless(Reader):
    """Its weights are never there."""

    name = "weightless"

    @classmethod
    def check(cls, config: ComponentConfig) -> None:
        raise WeightsError(
            "weightless.pth is not at hand: salframe weights fetch weightless", "salframe weights fetch weightless"
        )


class Ranger(Reader):
    """Needs what the rooms do not have."""

    name = "ranger"
    needs = frozenset({"rgb", "range"})


@salframe.hookimpl
def salframe_provides():
    return [Rooms, Reader, Clear, Greedy, Suicidal, Unbuildable, Weightless, Ranger]
