from __future__ import annotations

import os
from abc import abstractmethod
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from broken_datasets import BROKEN_DATASETS
from broken_detectors import BROKEN_DETECTORS, Described, columns
from broken_localizers import BROKEN_LOCALIZERS
from broken_planners import Dijkstra, OneWay, Retracing, Swimming
from broken_range_models import BROKEN_RANGE_MODELS, Ranging
from broken_stages import BROKEN_STAGES
from broken_trackers import Confident, Drifting, Following, Gullible, Requiring, Standing, Stubborn
from conformance import breaks, conforms
from salframe_annotations.detector import AnnotationDetector
from salframe_graphs.localizer import SaliencyGraphLocalizer
from tiny_folder import write_tiny_folder

from salframe.framework.component import Role, match_only
from salframe.framework.components.identity import UserFile
from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot, slots
from salframe.framework.config import merge
from salframe.framework.errors import DataError
from salframe.framework.validation import Settings
from salframe.panoramas.geometry import rays_to_pixels
from salframe.testing import ConformanceError
from salframe.testing.identities import _user_files, another_config, check_files
from salframe.testing.rooms import HEIGHT_PX, ROOMS, look, stand

BROKEN = [
    *BROKEN_DETECTORS,
    *BROKEN_STAGES,
    *BROKEN_LOCALIZERS,
    (int, "a plugin registers <class 'int'>, which is not a component, expected a subclass of one of Dataset"),
]
REAL = Path(os.environ.get("SALFRAME_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data")) / "matterport3d"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> Path:
    return write_tiny_folder(tmp_path_factory.mktemp("tiny"))


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))


def small_datasets(tiny: Path) -> dict[str, dict]:
    """Settings that make each dataset small."""
    return {
        "folder": {"root": str(tiny)},
        "house": {"rooms": 4, "height": 64, "rgb": False, "queries_per_room": 1},
        "matterport-annotations": {"root": str(REAL), "scans": ("17DRP5sb8fy",)},
        "habitat-maps": {"root": str(REAL), "scans": ("17DRP5sb8fy",)},
    }


OURS = [component for component, package in registry() if package == "salframe"]


BROUGHT = ("feature-matcher", "detection-decoder", "image-network")
"""Roles that salframe's plugins define, checked in tests/keypoints, tests/detectors and tests/image."""
FILED = ("onnx", "union", "onnx-depth", "segments", "ray", "transformers", "transformers-depth", "appearance")
"""Checked in the folders of their own tests, which write the files that they need."""
STAGES = [
    pytest.param(c, marks=pytest.mark.slow if (c.role, c.name) == ("detector", "text") else ())
    for c in OURS
    if c.role not in ("dataset", "localizer", *BROUGHT) and c.name not in FILED
]
"""The detector of texts reads six views of every panorama."""


@pytest.mark.parametrize("component", STAGES, ids=lambda component: f"{component.role}-{component.name}")
def test_every_stage_of_ours_conforms(component):
    if "numba" in component.requires:
        pytest.importorskip("numba")
    assert conforms(component)


def slow(name: str):
    return pytest.param(name, marks=pytest.mark.slow)


MADE_ELSEWHERE = ("matterport3d", "mesh")
"""Checked in tests/matterport/test_release.py and tests/mesh/test_mesh.py, where their files are written."""


@pytest.mark.parametrize("name", [c.name for c in OURS if c.role == "dataset" and c.name not in MADE_ELSEWHERE])
def test_every_dataset_of_ours_conforms(name, tiny):
    if name in ("matterport-annotations", "habitat-maps") and not REAL.exists():
        pytest.skip(f"the real buildings are not installed: no folder {REAL}")
    component = registry().get("dataset", name)
    assert conforms(component, component.Config(**small_datasets(tiny)[name]))


METHODS = ("proposed", "usg", "objects", "objects-multiset", "salient-objects", "sovs")


@pytest.mark.parametrize("method", [*METHODS, *map(slow, ("sift", "loftr-compact"))])
def test_every_method_of_ours_conforms(method):
    config = configure("localizer", method, settings("localizer", method))
    assert conforms(config.component, config)


def test_annotations_turn_exactly_under_heavy_noise():
    assert conforms(AnnotationDetector, AnnotationDetector.Config(noise="uniform-heavy", seed=3))


class Declared(SaliencyGraphLocalizer):
    """Declares that its poses turn with the panorama, whatever its settings."""

    name = "declared"
    column_step = 1


def test_the_step_of_a_method_is_that_of_its_stages():
    """Where the answer is the pose of the reference frame, it does not turn with the query."""
    fixed = SaliencyGraphLocalizer.Config(detector="annotations", positioner=None)
    assert SaliencyGraphLocalizer(fixed).column_step is None
    assert conforms(SaliencyGraphLocalizer, fixed)


@pytest.mark.parametrize("structure", ["rings", slow("node2vec")])
def test_the_papers_angles_do_not_turn_with_the_panorama(structure):
    """The arccos loses the sign and the arithmetic mean wraps
    (docs/explanation/saliency-graph.md#from-matched-nodes-to-a-pose); without them the paper's poses turn."""
    paper = merge(settings("localizer", "paper"), {"matcher": {"structure": structure}, "detector": "annotations"})
    config = configure("localizer", "paper", paper)
    assert config.component(config).column_step is None
    declared = Declared.Config.model_validate({key: value for key, value in paper.items() if key != "kind"})
    breaks(r"rolled by 1 columns: received a pose that moved .* rad off the rotation", Declared, declared)
    repaired = configure("localizer", "paper", paper, [{"positioner": {"angle": "atan2", "mean": "circular"}}])
    assert repaired.component(repaired).column_step == 1
    assert conforms(repaired.component, repaired)


def test_rooms_are_seen_where_they_are():
    bedroom = ROOMS[0]
    panorama = look(bedroom, "a", stand(bedroom, yaw_rad=0.0))
    # From (2.1, 1.8, 1.5) in a room of 4.2 x 3.6 x 2.6 m: the wall behind, the ceiling, the floor, and the bed, whose
    # top is at (1.1, 0.8, 0.6).
    for direction, label, range_m in (
        ((-2.1, 0, 0.1), None, 2.10),
        ((0, 0.01, 1.1), None, 1.1),
        ((0, 0.01, -1.5), None, 1.5),
        ((-1, -1, -0.9), "bed", 1.676),
    ):
        column, row = (int(pixel) for pixel in rays_to_pixels(np.array(direction), len(panorama.range_m)))
        assert panorama.range_m[row, column] == pytest.approx(range_m, abs=0.02)  # a pixel spans 1 deg
        assert panorama.annotations.labels.get(panorama.annotations.instance_id[row, column]) == label


class Coarse(AnnotationDetector):
    """Rounds bearings to two columns. Each is off by up to a column (0.9 deg) when the panorama rolls by one."""

    name = "coarse"
    column_step = 2

    def detect(self, panorama):
        detections = super().detect(panorama)
        column = columns(detections)
        off_rad = (column - 2 * np.round(column / 2)) * np.pi / HEIGHT_PX
        c, s, (x, y, z) = np.cos(off_rad), np.sin(off_rad), detections.centroid_m.T
        return replace(detections, centroid_m=np.stack([c * x - s * y, s * x + c * y, z], 1))


def test_between_its_steps_a_detector_may_be_off_a_little():
    assert conforms(Coarse)


@pytest.mark.parametrize(
    ("component", "message"), [*BROKEN, *BROKEN_RANGE_MODELS], ids=lambda value: getattr(value, "__name__", "")
)
def test_a_broken_component_is_told_in_one_line(component, message):
    breaks(message, component)


@pytest.mark.parametrize(("component", "message"), BROKEN_DATASETS, ids=lambda value: getattr(value, "__name__", ""))
def test_a_broken_dataset_is_told_in_one_line(component, message, tiny):
    breaks(message, component, component.Config(root=tiny))


def test_a_range_model_that_breaks_no_rule_conforms():
    assert conforms(Ranging)


def test_a_planner_is_checked_against_the_shortest_route():
    assert conforms(Dijkstra)
    breaks(r"route from hall to room: received .* expected the shortest route, .*'door'", OneWay)
    breaks("received a route, expected NoRoute", Swimming)
    breaks(r"route from room to hall: received the path .* in the walking direction", Retracing)


class Listed(Settings):
    files: tuple[UserFile, ...] = ()
    last: UserFile | None = match_only(None)


class Settled(AnnotationDetector):
    """Settings of each type that the suite varies, none of which affects the output, and a file that does."""

    name = "settled"

    class Config(AnnotationDetector.Config):
        eager: bool = match_only(True)
        tries: int = match_only(5, ge=1, le=5)
        share: float = match_only(1.0, gt=0.4, le=1)
        way: Literal["straight", "round"] = match_only("straight")
        limit: float | None = match_only(None)
        matcher: slot("matcher", "geometric", match_only=True)
        word: str = match_only("any")
        labels: UserFile | None = None


class Filed(Described):
    """Takes files in a nested model and in the component of a slot, and rejects those of the suite."""

    class Config(AnnotationDetector.Config):
        tables: Listed = Listed()
        detector: slot("detector", "onnx")
        others: slots("detector", ("annotations", "onnx"), "some more")

    def __init__(self, config=None):
        super().__init__(config)
        if self.config != self.Config():
            raise DataError("unknown format")


def test_files_are_found_wherever_they_are():
    check_files(Filed.Config())
    assert {file.key: file.match_only for file in _user_files(Filed.Config())} == {
        "noise": False,
        "tables.files": False,
        "tables.last": True,
        "detector.model": False,
        "detector.labels": False,
        "others[0].noise": False,
        "others[1].model": False,
        "others[1].labels": False,
    }


def test_settings_that_do_not_matter_are_varied():
    assert conforms(Settled)
    defaults = Settled.Config()
    other = {name: another_config(defaults, name) for name in Settled.Config.model_fields}
    varied = {name: getattr(config, name) for name, config in other.items() if config is not None}
    assert varied["eager"] is False
    assert varied["tries"] == 4
    assert varied["share"] == 0.5
    assert varied["way"] == "round"
    assert varied["limit"] == 2.0
    assert other["matcher"] is other["word"] is other["kind"] is None


class Compass(Role):
    """A role that a plugin defines."""

    role = "compass"
    conformance = f"{__name__}:check_compass"

    @abstractmethod
    def north(self) -> float:
        """Radians."""


class Needle(Compass):
    """Points ahead."""

    name, version = "needle", "1"

    def north(self) -> float:
        return 0.0


class Spinning(Needle):
    """Points past a whole turn."""

    name = "spinning"

    def north(self) -> float:
        return 7.0


def check_compass(make) -> None:
    if make().north() > 2 * np.pi:
        raise ConformanceError("north: received more than a turn")


def test_a_role_brings_its_own_rules(monkeypatch):
    monkeypatch.setitem(registry().roles, "compass", Compass)
    assert conforms(Needle)
    breaks("north: received more than a turn", Spinning)
    monkeypatch.setattr(Compass, "conformance", "")
    assert conforms(Spinning)


def test_a_role_of_a_plugins_own_is_checked_by_the_function_that_it_names(monkeypatch):
    monkeypatch.setenv("SALFRAME_PLUGINS", "role_plugin")
    registry.cache_clear()
    try:
        assert registry().failures == []
        assert conforms(registry().get("greeter", "polite"))
        assert conforms(registry().get("mute", "silent"))  # its role defines no rules
        breaks("greet: received 'what', expected a greeting", registry().get("greeter", "rude"))
    finally:
        registry.cache_clear()


class Shaken(Coarse):
    """Declares a column_step of 1, which is wrong."""

    name = "shaken"
    column_step = 1


def test_every_rule_is_checked_and_a_broken_one_names_the_setting_that_mends_it():
    conformance = breaks(
        r"moved 0\.\d+ m, expected at most turn_tolerance_m = 0\.0001 m in addition to the rotation", Shaken
    )
    assert conformance.component == "detector shaken"
    assert [result.rule for result in conformance.failed] == ["detections rotate with the panorama"]
    assert {result.rule: result.message for result in conformance.skipped} == {
        "detections rotate between column steps": (
            "the column_step of the detector is 1, so no number of columns lies between two multiples of it"
        )
    }
    assert len(conformance.rules) == len(conformance.passed) + 2 == 11
    assert "detector shaken: passed: another instance gives the same answer\n" in str(conformance)


class Deaf(AnnotationDetector):
    """Raises on every panorama."""

    name = "deaf"

    def detect(self, panorama):
        raise ValueError("no panorama")


def test_what_builds_on_a_broken_rule_is_skipped():
    conformance = breaks("detect in the bedroom: received ValueError: no panorama, expected an answer", Deaf)
    assert len(conformance.failed) == 1
    assert {result.message for result in conformance.skipped} == {
        "depends on 'detections are well formed', which failed"
    }
    undeclared = breaks("Deafer .*summary|docstring", type("Deafer", (Deaf,), {"__doc__": None}))
    assert [result.rule for result in undeclared.failed] == ["declaration"]
    assert {result.message for result in undeclared.skipped} == {"depends on 'declaration', which failed"}


def test_a_tracker_that_breaks_no_rule_conforms():
    assert conforms(Following)


@pytest.mark.parametrize(
    ("tracker", "message"),
    [
        (Standing, "belief after a motion: received a pose 1.04 m"),
        (Gullible, "belief after a wrong answer: received a pose"),
        (Stubborn, "correct answers at another place: received a pose"),
        (Confident, "60 failed answers: received tracking, expected lost or out-of-map"),
        (Drifting, "belief, twice: received two different beliefs"),
        (Requiring, "move: received ValueError"),
    ],
)
def test_a_broken_tracker_is_told_in_one_line(tracker, message):
    breaks(message, tracker)
