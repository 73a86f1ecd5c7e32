import json

import numpy as np
import pytest
from salframe_matterport.dataset import MatterportAnnotations
from salframe_matterport.diagnose import cause_of, main
from salframe_matterport.scenes import ViewpointScene

from salframe.evaluation.runs.request import Resolved
from salframe.evaluation.runs.run_folder import ROWS, Run
from salframe.framework.components.registry import registry
from salframe.panoramas.geometry import pose_2d

OBJECTS = {
    1: ("bed", (2, 0, 1)),
    2: ("lamp", (0, 2, 2)),
    3: ("lamp", (1, 2, 1)),
    4: ("sink", (-1, 1, 1)),
    5: ("bed", (9, 9, 1)),
}


def scene(x_m, y_m, objects, range_factor=1.0):
    """A viewpoint that sees these objects where they are, all ranges wrong by a factor."""
    offset = np.array([OBJECTS[number][1] for number in objects], float) - (x_m, y_m, 1.5)
    return ViewpointScene(
        id="",
        place="",
        T_world_pano=pose_2d(x_m, y_m, 0.3, 1.5),
        object_id=np.array(objects),
        labels=tuple(OBJECTS[n][0] for n in objects),
        keys=(),
        azimuth_rad=np.arctan2(offset[:, 1], offset[:, 0]),
        elevation_rad=np.arctan2(offset[:, 2], np.hypot(*offset[:, :2].T)),
        width_rad=np.zeros(len(objects)),
        height_rad=np.zeros(len(objects)),
        range_m=range_factor * np.linalg.norm(offset, axis=1),
    )


QUERY = scene(0, 0, [1, 2, 3])


@pytest.mark.parametrize(
    ("own", "winning", "cause"),
    [
        ([scene(1, 1, [4, 5])], [scene(8, 8, [5])], "no shared object"),
        ([scene(1, 1, [4, 5]), scene(1, 0, [1, 5])], [scene(8, 8, [5])], "one shared object"),
        ([scene(1, 1, [1, 2, 4], range_factor=1.5)], [scene(8, 8, [5])], "bad bearing or range"),
        ([scene(1, 1, [1, 2, 4])], [scene(8, 8, [5, 3])], "twin room"),
        ([scene(1, 1, [1, 2, 4])], [scene(8, 8, [5])], "other"),
        ([scene(1, 1, [1, 2, 4])], [], "other"),
    ],
)
def test_cause(own, winning, cause):
    assert cause_of(QUERY, own, winning) == cause


@pytest.fixture
def run(building, tmp_path):
    """A run on the drawn building, which has two queries in region 0: a is right, b names region 1."""
    config = MatterportAnnotations.Config(root=building.root)
    methods = {"objects": registry().get("localizer", "objects").Config()}
    engine = registry().get("engine", "inline").Config()
    run = Run.open(
        tmp_path / "runs", "test", {"name": "localization"}, Resolved(methods, "fake", config, engine), seed=0
    )
    run.folder("objects").mkdir(parents=True)
    places = {"a": "fake/region-0", "b": "fake/region-1"}
    unknown = dict.fromkeys(("error", "pose", "query_ms", "describe_ms", "peak_memory_mb"))
    answered = {"status": "no-pose", **unknown}
    rows = [
        {"fold": f"fake/{v}", "query": f"fake/{v}/query", "places": [["fake/c", place, 1.0]], **answered}
        for v, place in places.items()
    ]
    (run.folder("objects") / ROWS).write_text("".join(json.dumps(row) + "\n" for row in rows))
    return run


def test_command_counts_and_lists_wrong_queries(run, capsys):
    assert main([str(run.directory), "objects", "--queries"]) == 0
    # b shares a chair, a lamp and a table with a, but only a chair and a lamp with c.
    assert capsys.readouterr().out.split("\n")[-3:] == ["    1  other", "         fake/b/query", ""]


def test_command_says_what_is_missing(run, tmp_path, capsys):
    assert main([str(tmp_path / "nowhere"), "objects"]) == 2
    assert "is not a run folder" in capsys.readouterr().err
    (run.folder("objects") / ROWS).write_text("")
    assert main([str(run.directory), "objects"]) == 2
    assert (
        "has no answer of the method 'objects' to the query fake/a/query, expected a complete run"
        in capsys.readouterr().err
    )
