"""The base of data sets that render: what it writes, in which order, and what a run that was killed leaves."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from salframe_engines import Inline, Processes

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import DataError, SalframeError
from salframe.framework.files.cache import Cache
from salframe.framework.files.hashes import digest
from salframe.framework.files.writing import atomic_path
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.describing import describe_frame
from salframe.localization.localizer import Localizer
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.panoramas.query_view import QueryView
from salframe.panoramas.rendered import FrameSpec, RenderedDataset

FRAMES = [
    FrameSpec("hall/1", "map", "hall", 1.0, 2.0, 1.5, 0.0),
    FrameSpec("door", "transition", "door-1", 2.0, 2.0, 1.5, 0.0),
    FrameSpec("q", "query", "hall", 1.5, 2.0, 1.4, np.pi / 2),
]
TURNED = [[0, -1, 0, 1.5], [1, 0, 0, 2.0], [0, 0, 1, 1.4], [0, 0, 0, 1]]
"""The query's pose: its x axis is the world's y."""
FLOOR = FloorMasks(
    np.ones((3, 4), bool), np.ones((3, 4), np.int32), np.zeros((3, 4), bool), 0.5, (0.0, 1.5), {1: "hall"}, 0.2
)


class Plain(RenderedDataset[FrameSpec]):
    """Panoramas 16 pixels high, at a range that tells the frame; of three objects in two rows, two are visible."""

    name = "plain"
    version = "1"
    provides = frozenset({"range", "annotations"})

    class Config(ComponentConfig):
        range_m: float = 2.0

    def list_frames(self) -> list[FrameSpec]:
        return FRAMES

    def render(self, frame: FrameSpec) -> Panorama:
        range_m = np.full((16, 32), self.config.range_m + FRAMES.index(frame), np.float32)
        instance_id = np.zeros((16, 32), np.int32)
        instance_id.flat[:50], instance_id.flat[60:109], instance_id.flat[200:300] = 1, 2, 7
        return Panorama(frame.id, range_m=range_m, annotations=Annotations(instance_id, rendered=True))

    def list_objects(self) -> dict[str, list]:
        return {"instance_id": [1, 2, 7], "label": ["bed", "lamp", "sofa"]}

    def list_floors(self) -> dict[str, FloorMasks]:
        return {"ground": FLOOR}


class Many(Plain):
    """The same, rendered by two processes."""

    name = "many"
    engine = Processes(Processes.Config(workers=2))


class Dying(Many):
    """One whose processes die: of each frame the first time, or of the last always."""

    name = "dying"

    class Config(Plain.Config):
        always: bool = False

    def render(self, frame: FrameSpec) -> Panorama:
        tried = self.root / f"tried-{FRAMES.index(frame)}"
        if not tried.exists() or (self.config.always and frame == FRAMES[-1]):
            tried.parent.mkdir(parents=True, exist_ok=True)
            tried.touch()
            os._exit(3)
        return super().render(frame)


class Slow(Many):
    """One whose processes take a minute to write a frame."""

    name = "slow"

    def render(self, frame: FrameSpec) -> Panorama:
        with atomic_path(self.root / "half.png") as temporary:
            temporary.touch()
            time.sleep(60)
        return super().render(frame)


class Unplanned(Plain):
    """One whose floors cannot be drawn."""

    name = "unplanned"

    def render(self, frame: FrameSpec) -> Panorama:
        pytest.fail("rendered before its floors were drawn")

    def list_floors(self) -> dict[str, FloorMasks]:
        raise DataError("no floor")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    monkeypatch.setattr(RenderedDataset, "engine", Inline())
    return tmp_path


def recorder() -> tuple[list[tuple[int, int]], Callable[[int, int], None]]:
    seen: list[tuple[int, int]] = []
    return seen, lambda done, total: seen.append((done, total))


def files(root: Path) -> dict[str, tuple[bytes, int]]:
    paths = (path for path in root.rglob("*") if path.is_file())
    return {path.relative_to(root).as_posix(): (path.read_bytes(), path.stat().st_mtime_ns) for path in paths}


def test_what_was_rendered_is_read_from_the_folder(cache: Path) -> None:
    data = Plain()
    seen, progress = recorder()
    data.prepare(progress)
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]
    assert data.root == cache / "plain" / data.fingerprint[:16]
    (fold,) = data.folds()
    assert [(f.id, f.place, f.kind) for f in fold.references] == [
        ("hall/1", "hall", FrameKind.SCENE),
        ("door", "door-1", FrameKind.TRANSITION),
    ]
    assert [float(frame.load().range_m[3, 3]) for frame in (*fold.references, *fold.queries)] == [2.0, 3.0, 4.0]
    (query,) = fold.queries
    annotations = query.load().annotations
    assert annotations.labels == {1: "bed", 2: "lamp", 7: "sofa"}
    assert annotations.rendered
    truth = data.truth("q")
    assert (truth.place, truth.instances) == ("hall", (1, 7))  # the lamp covers 49 pixels
    np.testing.assert_allclose(truth.T_world_pano, TURNED, atol=1e-15)
    (floor,) = data.floors()
    assert (floor.regions, floor.z_m) == ({1: "hall"}, 0.2)
    assert sorted(files(data.root)) == [
        "contents.json",
        *(f"frames/{number:05d}.{part}.png" for number in range(3) for part in ("instances", "range")),
        *(f"ground-{mask}.png" for mask in ("free", "obstacle", "region")),
        "manifest.json",
        "objects.parquet",
        "truth.json",
    ]


def test_a_killed_run_loses_no_finished_frame() -> None:
    """Stopped after two frames there is no manifest, and those two are not rendered again."""
    data = Plain()

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        data.prepare(stop)
    before = files(data.root)
    assert sorted(before) == [
        f"frames/0000{number}.{part}.png" for number in range(2) for part in ("instances", "range")
    ]
    with pytest.raises(DataError, match=r"with the file manifest\.json"):
        data.folds()
    seen, progress = recorder()
    data = Plain()
    data.prepare(progress)
    assert seen == [(2, 3), (3, 3)]
    assert before.items() <= files(data.root).items()
    data.prepare(lambda done, total: pytest.fail("rendered what was there"))


def test_other_settings_are_another_folder() -> None:
    assert Plain().fingerprint == Plain().fingerprint != Plain(Plain.Config(range_m=3.0)).fingerprint
    assert Plain().root != Many().root


def test_processes_render_the_same_files() -> None:
    for kind in (Plain, Many):
        kind().prepare(lambda done, total: None)
    content = [{name: data for name, (data, _) in files(kind().root).items()} for kind in (Plain, Many)]
    assert all(one.pop("contents.json") for one in content)  # which tells the data sets apart
    assert content[0] == content[1]


def test_a_frame_whose_process_dies_is_rendered_by_another() -> None:
    Dying().prepare(lambda done, total: None)
    Plain().prepare(lambda done, total: None)
    content = [{name: data for name, (data, _) in files(kind().root).items()} for kind in (Dying, Plain)]
    assert content[0].items() >= {name: data for name, data in content[1].items() if name != "contents.json"}.items()


def test_a_frame_whose_process_always_dies_is_one_line() -> None:
    with pytest.raises(
        SalframeError, match=r"died on the same frame, after 2 of 3 frames: run the command again to resume"
    ):
        Dying(Dying.Config(always=True)).prepare(lambda done, total: None)


def test_an_interrupt_ends_the_processes_at_once(interruptible) -> None:
    sent: list[float] = []

    def interrupt() -> None:
        while len(list(Slow().root.glob(".half-*"))) < 2:
            time.sleep(0.01)
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        Slow().prepare(lambda done, total: None)
    assert time.monotonic() - sent[0] < 2  # the work of each would have taken a minute
    assert multiprocessing.active_children() == []
    assert files(Slow().root) == {}
    thread.join()


def test_what_is_wrong_with_the_floors_shows_before_rendering() -> None:
    with pytest.raises(DataError, match="no floor"):
        Unplanned().prepare(lambda done, total: None)


class Later(Plain):
    """One whose map depends on the range alone, and whose query on the time too; counts what it renders."""

    name = "later"
    rendered: ClassVar[list[tuple[float, str]]] = []

    class Config(ComponentConfig):
        range_m: float = 2.0
        hours: float = 0.0
        word: str = "sofa"

    def depends_on(self, frame: FrameSpec) -> str:
        return digest([self.config.range_m, self.config.hours if frame.is_query else None])

    def render(self, frame: FrameSpec) -> Panorama:
        self.rendered.append((self.config.hours, frame.id))
        return super().render(frame)

    def list_objects(self) -> dict[str, list]:
        return {"instance_id": [1, 2, 7], "label": ["bed", "lamp", self.config.word]}


def later(**settings: float | str) -> Later:
    Later.rendered.clear()
    data = Later(Later.Config(**settings))
    data.prepare(lambda done, total: None)
    return data


def known(data: Later) -> dict[str, str]:
    (fold,) = data.folds()
    return {frame.id: frame.content for frame in (*fold.references, *fold.queries)}


def test_frames_that_do_not_depend_on_a_setting_are_shared() -> None:
    first = later()
    assert len(Later.rendered) == 3
    second = later(hours=5.0)
    assert Later.rendered == [(5.0, "q")]
    assert first.root != second.root
    assert {id for id, content in known(first).items() if content == known(second)[id]} == {"hall/1", "door"}
    assert first.content_key != second.content_key
    file = "frames/00000.range.png"
    assert (first.root / file).samefile(second.root / file)
    assert not (first.root / "frames/00002.range.png").samefile(second.root / "frames/00002.range.png")
    later(hours=0.0)
    assert Later.rendered == []


def test_frames_that_depend_on_a_setting_are_not_shared() -> None:
    first, second = known(later()), known(later(range_m=3.0))
    assert len(Later.rendered) == 3
    assert not set(first.values()) & set(second.values())


def test_other_words_are_other_content_of_the_same_images() -> None:
    """Components may draw from all words of the table, as the detector `annotations` does."""
    first, second = known(later()), known(later(word="couch"))
    assert Later.rendered == []
    assert not set(first.values()) & set(second.values())


def test_what_was_rendered_before_images_were_shared_is_not_rendered_again(cache: Path) -> None:
    """Then there was no contents.json, and no folder of shared images."""
    first = later()
    (first.root / "contents.json").unlink()
    shutil.rmtree(cache / "later" / "frames")
    later(hours=1.0)
    assert len(Later.rendered) == 3
    shutil.rmtree(cache / "later" / "frames")
    assert known(later()).keys() == {"hall/1", "door", "q"}
    assert Later.rendered == []


def test_a_frame_that_stands_elsewhere_is_another_though_its_id_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    first = known(later())
    moved = [replace(FRAMES[0], x_m=9.0), *FRAMES[1:]]
    monkeypatch.setattr(Later, "list_frames", lambda self: moved)
    monkeypatch.setattr(Later, "render", lambda self, frame: Plain.render(self, FRAMES[moved.index(frame)]))
    second = known(later(hours=2.0))
    assert first["hall/1"] != second["hall/1"]
    assert first["door"] == second["door"]


class Narrow(Plain):
    """One whose queries may show less."""

    name = "narrow"

    class Config(QueryView):
        range_m: float = 2.0


def test_how_queries_are_seen_renders_nothing_anew() -> None:
    whole, half = Narrow(), Narrow(Narrow.Config(query_fov_deg=180.0))
    whole.prepare(lambda done, total: None)
    half.prepare(lambda done, total: pytest.fail("rendered what was there"))
    assert whole.root == half.root
    (before,), (after,) = (data.folds()[0].queries for data in (whole, half))
    assert before.content != after.content
    assert np.isnan(after.load().range_m).mean() == 0.5
    assert not np.isnan(before.load().range_m).any()
    for one, other in zip(whole.folds()[0].references, half.folds()[0].references, strict=True):
        assert one.content == other.content
        assert other.load().valid is None


def test_descriptions_are_shared_as_images_are(tmp_path: Path) -> None:
    """A localizer describes the map once for both data sets, and each one's query by itself."""
    described: list[str] = []

    class Counting(Localizer):
        name, version, needs = "counting", "1", frozenset({"range"})

        def index(self, descriptions: object, frames: object) -> None: ...

        def match(self, description: object) -> Localization:
            return Localization((), None, LocalizationStatus.NO_MATCH)

        def describe(self, panorama: Panorama) -> dict[str, np.ndarray]:
            described.append(panorama.id)
            return {"range_m": np.nan_to_num(panorama.range_m[:1])}

    localizer, store = Counting(), Cache(tmp_path / "descriptions")
    for settings in ({}, {"query_fov_deg": 180.0}):
        data = Narrow(Narrow.Config(**settings))
        data.prepare(lambda done, total: None)
        (fold,) = data.folds()
        for frame in (*fold.references, *fold.queries):
            describe_frame(localizer, frame, store, data.content_key)
    assert described == ["hall/1", "door", "q", "q"]
