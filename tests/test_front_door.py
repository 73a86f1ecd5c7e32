"""What `import salframe` promises: its names, that they cost nothing until they are used, and that they do what the
documentation's first lines do."""

from __future__ import annotations

import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from tiny_folder import write_tiny_folder

import salframe
from salframe.testing.rooms import PARTS, query_frames, query_truths

# fmt: off
DOOR = [
    "export_map", "fetch_weights", "score", "CameraSequence", "read_sequence", "write_rerun",
    "equirectangular_rays", "invert_pose", "pose_2d", "rays_to_pixels", "transform_points",
    "BuildingMap", "LocalizationMap",
    "Annotations", "Cache", "Camera", "Component", "ComponentConfig", "ConfigError", "Conformance", "Connection",
    "DataError", "Dataset",
    "Detections", "Detector", "Engine", "Estimate", "FloorMasks", "Fold", "FrameKind", "GraphMatch", "GraphMatcher",
    "InputMissing", "InvalidAnswer", "Localization", "LocalizationStatus", "Localizer", "MapEdge", "ReferenceFrame",
    "MapNode", "NoRoute", "NodeKind", "NodeMatches", "ObjectBoxes", "Panorama", "Planner", "PointMatches",
    "PoseEstimate", "PoseStatus", "Positioner", "Presets", "QueryFrame", "RangeModel", "RankedGraphs", "RankedPlace",
    "Request", "RequirementMissing", "Result", "Role", "Route", "RuleResult", "RuleStatus", "SalframeError",
    "SaliencyGraph", "SaliencyModel", "SceneCandidates", "SceneIndex", "Scorer", "TopologicalMap", "Truth",
    "UnknownName", "UserFile", "View", "NetworkWeights", "WeightsError",
    "__version__", "ablate", "ask_map", "build_map", "check_component", "compare",
    "detections_from_points", "directions", "draw_topology", "evaluate", "find_dataset", "find_frame", "find_route",
    "fit_method", "hookimpl", "reference_frames", "match_only", "measure_detection", "measure_matching",
    "measure_sensor", "navigate", "open_map", "rank_places", "read_camera", "read_panorama",
    "read_photograph", "open_topology", "show_objects",
    "Limits", "run_experiment", "slot", "slots", "Variant", "Report", "write_report", "add_to_map", "calibrate_map",
    "merge_maps", "remove_from_map", "Track", "TrackedCamera", "TrackedPose", "Tracker", "TrackStatus", "TrackStep",
    "draw_trail", "open_tracker", "track", "EvidenceColumn", "EvidenceModel", "PlaceFrames", "PlaceHypotheses",
    "list_labels", "LabelList", "ListedLabel",
    "NextView", "Question", "TextAnswer", "ask",
    "ImageFiles", "ImportPreview", "ImportResult", "Importer", "PanoramaRecord", "PlaceSource", "Recording",
    "import_data", "preview_import",
]
# fmt: on
"""Adding a name is a promise; removing one breaks whoever uses it."""
HEAVY = ("numpy", "scipy", "pydantic", "yaml", "typer", "cv2", "PIL", "pyarrow", "onnxruntime", "torch", "loky")


def test_the_public_names():
    assert sorted(salframe.__all__) == sorted(DOOR)
    for name in DOOR:
        assert getattr(salframe, name) is not None
    with pytest.raises(AttributeError, match="build_mapp"):
        salframe.build_mapp  # noqa: B018


def test_what_is_promised_can_be_read_up():
    assert [name for name in DOOR if not (getattr(salframe, name).__doc__ or "").strip()] == []


def test_importing_it_imports_nothing_heavy():
    code = f"import sys, salframe; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_the_version_is_that_of_the_distribution():
    assert salframe.__version__ == metadata.version("salframe")


def test_type_checkers_see_the_types():
    assert (Path(salframe.__file__).parent / "py.typed").exists()


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    """A map whose method detects by the annotations."""
    folder = tmp_path_factory.mktemp("rooms")
    salframe.build_map(write_tiny_folder(folder / "data"), folder / "map")
    return folder / "map"


def test_a_map_stays_open_and_is_asked_with_arrays(saved):
    opened, truths = salframe.open_map(str(saved)), query_truths()
    for frame in query_frames():
        seen = frame.load()
        answer = opened.localize(rgb=seen.rgb, range_m=seen.range_m, annotations=seen.annotations)
        truth = truths[frame.id]
        assert answer.places[0].place == truth.place
        np.testing.assert_allclose(answer.T_world_query, truth.T_world_pano, atol=0.05)
        again = opened.localize(seen)
        np.testing.assert_array_equal(again.T_world_query, answer.T_world_query)


def test_a_map_that_needs_more_says_what_to_build_instead(saved, monkeypatch, tmp_path):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))  # no weights that somebody fetched
    seen = query_frames(PARTS - {"annotations"})[0].load()
    said = (
        "^the method 'saliency-places' needs annotations, which the panorama does not have: "
        r"build the map with --set detector\.kind=panoseg, or pass annotations too$"
    )
    with pytest.raises(salframe.InputMissing, match=said):
        salframe.open_map(saved).localize(rgb=seen.rgb, range_m=seen.range_m)


def test_a_map_that_detects_by_itself_is_asked_with_a_picture_and_its_range(tmp_path):
    """Made rooms are no furniture to the network: what it answers is not judged, but that it does."""
    salframe.build_map(write_tiny_folder(tmp_path / "data"), tmp_path / "map", overrides=["detector.kind=panoseg"])
    seen = query_frames()[0].load()
    answer = salframe.open_map(tmp_path / "map").localize(rgb=seen.rgb, range_m=seen.range_m)
    assert isinstance(answer, salframe.Localization)


def test_images_that_do_not_fit_are_told_in_one_line(saved):
    opened, seen = salframe.open_map(saved), query_frames()[0].load()
    with pytest.raises(salframe.DataError, match="range image is 100 x 50, expected 384 x 192 like the other images"):
        opened.localize(rgb=seen.rgb, range_m=np.ones((50, 100), np.float32))
    with pytest.raises(salframe.DataError, match="received both the query bedroom-query and images"):
        opened.localize(seen, rgb=seen.rgb)


SCRIPT = """
import salframe

result = salframe.compare(salframe.Request(methods=["reader"], data="rooms"))
print(result.row("reader").accuracy.value)
"""


def test_a_plain_script_compares_in_processes(fakes, tmp_path):
    """The engine's processes do not import the script, which would compare again."""
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "1.0\n"), done.stderr
