"""Localizers on the rooms of fake_plugin that go wrong as they are told, for the tests of runs."""

from __future__ import annotations

import os
import re
import signal
import time
from typing import Literal

import numpy as np
from fake_plugin import Reader
from pydantic import Field

import salframe
from salframe.framework.config import ComponentConfig
from salframe.framework.errors import ConfigError, WeightsMissing
from salframe.framework.identity import UserFile, identity
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace

ERRORS = {
    "exit": SystemExit("the network wants to leave"),
    "generator": GeneratorExit("no more"),
    "interrupt": KeyboardInterrupt(),
    "value": ValueError("this is too much"),
}


class Faulty(Reader):
    """Raises something, where it is told to."""

    name = "faulty"

    class Config(Reader.Config):
        where: Literal["init", "describe", "index", "match", "check", "weights", "nowhere"] = Field(
            "nowhere", description="which hook"
        )
        what: Literal["exit", "generator", "interrupt", "value"] = Field("exit", description="what it raises")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._fail("init")

    @classmethod
    def check(cls, config: ComponentConfig) -> None:
        super().check(config)
        if config.where == "check":
            raise ValueError("the driver is odd")

    @classmethod
    def weights_in_use(cls, config: ComponentConfig) -> tuple:
        if config.where == "weights":
            raise ValueError("no weights of that name")
        return ()

    def describe_identity(self):
        return identity(self.config, describing=True)

    def _fail(self, where: str) -> None:
        if self.config.where == where:
            raise ERRORS[self.config.what]

    def describe(self, panorama):
        self._fail("describe")
        return super().describe(panorama)

    def index(self, descriptions, frames):
        self._fail("index")
        super().index(descriptions, frames)

    def match(self, description):
        self._fail("match")
        return super().match(description)


PLACES = (RankedPlace("map-0", "room-0", 1.0),)
MIRROR = np.diag([1.0, 1.0, -1.0, 1.0])
ANSWERS = {
    "shape": lambda: Localization(PLACES, np.eye(3), LocalizationStatus.OK),
    "zero": lambda: Localization(PLACES, np.zeros((4, 4)), LocalizationStatus.OK),
    "scaled": lambda: Localization(PLACES, np.diag([2.0, 2.0, 2.0, 1.0]), LocalizationStatus.OK),
    "mirrored": lambda: Localization(PLACES, MIRROR, LocalizationStatus.OK),
    "nan": lambda: Localization(PLACES, np.full((4, 4), np.nan), LocalizationStatus.OK),
    "status": lambda: Localization(PLACES, np.eye(4), "certain"),
    "posed": lambda: Localization(PLACES, np.eye(4), LocalizationStatus.NO_POSE),
    "poseless": lambda: Localization(PLACES, None, LocalizationStatus.OK),
    "placeless": lambda: Localization((), None, LocalizationStatus.NO_POSE),
    "elsewhere": lambda: Localization((RankedPlace("map-9", "room-9", 1.0),), None, LocalizationStatus.NO_POSE),
    "misplaced": lambda: Localization((RankedPlace("map-0", "room-1", 1.0),), None, LocalizationStatus.NO_POSE),
    "mapping": lambda: {"places": PLACES, "status": "ok"},
    "nothing": lambda: None,
    "score": lambda: Localization((RankedPlace("map-0", "room-0", float("nan")),), None, LocalizationStatus.NO_POSE),
}


class Nonsense(Reader):
    """Answers what no localizer may answer."""

    name = "nonsense"

    class Config(Reader.Config):
        answer: str = Field("shape", description="which of ANSWERS")

    def match(self, description):
        return ANSWERS[self.config.answer]()


class Noted(Reader):
    """Reads a file of the user's."""

    name = "noted"

    class Config(Reader.Config):
        note: UserFile = Field(UserFile("note.txt"), description="a file")


class Narrow(Reader):
    """Cannot run here, and has a setting that no other has."""

    name = "narrow"
    requires = ("no_such_package",)

    class Config(Reader.Config):
        depth: int = Field(1, description="a setting of its own")


class Odd(Reader):
    """Cannot even say whether it can run."""

    name = "odd"

    @classmethod
    def check(cls, config: ComponentConfig) -> None:
        raise ValueError("the driver is odd")


def _hold_a_gigabyte() -> None:
    held = np.ones(125_000_000)
    time.sleep(60)
    del held


DEADLY = {
    "hang": lambda: time.sleep(600),
    "spin": lambda: re.match(r"(a+)+$", "a" * 60 + "b"),  # in C, which no exception reaches
    "exit": lambda: os._exit(3),
    "fault": lambda: os.kill(os.getpid(), signal.SIGSEGV),
    "hoard": _hold_a_gigabyte,
}


class Deadly(Reader):
    """Ends its process, or needs to be ended, on queries of some rooms."""

    name = "deadly"

    class Config(Reader.Config):
        how: Literal["hang", "spin", "exit", "fault", "hoard"] = Field("exit", description="what it does")
        rooms: tuple[int, ...] = Field((1,), description="in which rooms")

    def match(self, description):
        if int(description["room"][0]) in self.config.rooms:
            DEADLY[self.config.how]()
        return super().match(description)


class Slow(Reader):
    """Takes its time to describe."""

    name = "slow"

    class Config(Reader.Config):
        describe_s: float = Field(0.0, description="seconds a panorama takes")

    def describe(self, panorama):
        time.sleep(self.config.describe_s)
        return super().describe(panorama)


class Picky(Reader):
    """Lacks weights with an offset below 0, cannot be built with one of 100, and exits with a larger one."""

    name = "picky"

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        if self.config.offset == 100:
            raise ConfigError("an offset of 100 is too far")
        if self.config.offset > 100:
            raise SystemExit(self.config.offset)

    @classmethod
    def check(cls, config: ComponentConfig) -> None:
        if config.offset < 0:
            raise WeightsMissing("picky.pth is not at hand")


@salframe.hookimpl
def salframe_provides():
    return [Deadly, Faulty, Nonsense, Noted, Narrow, Odd, Picky, Slow]
