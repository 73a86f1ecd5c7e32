"""Localizers on the rooms of fake_plugin that go wrong as they are told, for the tests of runs."""

from __future__ import annotations

import faulthandler
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Literal

import numpy as np
from fake_plugin import Reader
from pydantic import Field

import salframe
from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import UserFile, identity
from salframe.framework.errors import ConfigError, WeightsError
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
    "text": lambda: "room-0",
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


def _hold_much() -> None:
    held = np.ones(62_500_000)
    time.sleep(60)
    del held


def _raise(error: BaseException) -> None:
    raise error


def _recurse() -> int:
    return 1 + _recurse()


def _exit_once() -> None:
    if not Path("died").exists():
        Path("died").touch()
        os._exit(3)


def _child(code: str) -> None:
    """Wait for a child process, which writes its id to the file `child` first."""
    code = f"import os, time; open('child', 'w').write(str(os.getpid())); {code}"
    subprocess.run([sys.executable, "-c", code], check=False)


def _silence_alarms() -> None:
    faulthandler.cancel_dump_traceback_later()
    signal.alarm(0)
    time.sleep(600)


def _wander() -> None:
    Path("elsewhere").mkdir(exist_ok=True)
    os.chdir("elsewhere")


DEADLY = {
    "hoard-in-child": lambda: _child("held = b'x' * 500_000_000; time.sleep(60)"),
    "hang-in-child": lambda: _child("time.sleep(600)"),
    "silence": _silence_alarms,
    "wander": _wander,
    "raise": lambda: _raise(ValueError("this is too much")),
    "leave": lambda: _raise(SystemExit("the network wants to leave")),
    "recurse": _recurse,
    "print": lambda: os.write(1, b"{\n") and print("{"),  # as C libraries do, and as Python does
    "hang": lambda: time.sleep(600),
    "spin": lambda: re.match(r"(a+)+$", "a" * 60 + "b"),  # in C, which no exception reaches
    "exit": lambda: os._exit(3),
    "exit-once": _exit_once,
    "fault": lambda: os.kill(os.getpid(), signal.SIGSEGV),
    "hoard": _hold_much,
}


class Deadly(Reader):
    """Goes wrong when it is built, on reference frames or on queries of some rooms."""

    name = "deadly"

    class Config(Reader.Config):
        how: Literal[tuple(DEADLY)] = Field("exit", description="what it does")  # type: ignore[valid-type]
        when: Literal["init", "map", "query"] = Field("query", description="when it does")
        rooms: tuple[int, ...] = Field((1,), description="in which rooms")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        if self.config.when == "init":
            DEADLY[self.config.how]()

    def describe_identity(self):
        return identity(self.config, describing=True)

    def describe(self, panorama):
        room, column = panorama.rgb[0, 0, :2]
        if self.config.when == "map" and room in self.config.rooms and not column:
            DEADLY[self.config.how]()
        return super().describe(panorama)

    def match(self, description):
        if self.config.when == "query" and int(description["room"][0]) in self.config.rooms:
            DEADLY[self.config.how]()
        return super().match(description)


class Slow(Reader):
    """Takes its time to describe, and leaves the file `describing`."""

    name = "slow"

    class Config(Reader.Config):
        describe_s: float = Field(0.0, description="seconds a panorama takes")

    def describe(self, panorama):
        Path("describing").touch()
        end_s = time.monotonic() + self.config.describe_s
        while time.monotonic() < end_s:
            time.sleep(0.02)  # a signal just before a sleep does not end it
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
            raise WeightsError("picky.pth is not at hand")


@salframe.hookimpl
def salframe_provides():
    return [Deadly, Faulty, Nonsense, Noted, Narrow, Odd, Picky, Slow]
