"""Scores against episodes worked out by hand on a small building, and against the reference paths of the real ones."""

import json
import re
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
from command_line import run
from conformance import breaks, conforms
from salframe_matterport.readers import connectivity_path
from salframe_matterport.reverie import Reverie, read_episodes, walking_distances

from salframe.evaluation.runs.request import Request
from salframe.evaluation.studies.experiment import run_experiment
from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError, UnknownName

# A corridor a - b - c of 3 m and 4 m, a stair b - d of (0, 3, 4), 5 m, and e that no way leads to. f is not included.
#   a --3-- b --4-- c
#           |5
#           d
PLACES = {"a": (0, 0, 1), "b": (3, 0, 1), "c": (7, 0, 1), "d": (3, 3, 5), "e": (9, 9, 1), "f": (3, 1, 1)}
WAYS = {("a", "b"), ("b", "c"), ("b", "d"), ("b", "f"), ("f", "d")}
SEES = {"a": (), "b": (7,), "c": (7, 8), "d": (9,), "e": (8,), "f": ()}
TASKS = [
    {
        "path_id": 1, "objId": 8, "scan": "fake", "heading": 0.5, "path": ["a", "b", "c"],
        "instructions": ["go there", "do go there"],
    },
    {"path_id": 2, "objId": 9, "scan": "fake", "heading": 3.0, "path": ["a", "b", "d"], "instructions": ["climb"]},
]  # fmt: skip
# instr_id -> (path, predicted object): a detour to the goal; the goal passed and left; a jump from a to d, 8 m along
# the ways.
ANSWERS = {"1_8_0": ("abdbc", 8), "1_8_1": ("abcb", 7), "2_9_0": ("ad", 9)}
# Lengths: 3 + 5 + 5 + 4 = 17 against 7; 3 + 4 + 4 = 11 against 7; 8 against 8.
BY_HAND = {"SR": 2 / 3, "OSR": 1, "SPL": (7 / 17 + 0 + 1) / 3, "RGS": 2 / 3, "RGSPL": (7 / 17 + 0 + 1) / 3}


def official(answers):
    return [
        {"instr_id": name, "trajectory": [[v, 0.5, 0.0] for v in path], "predObjId": found}
        for name, (path, found) in answers.items()
    ]


def duet(answers):
    """Each action is the list of viewpoints that it walked through."""
    return [
        {"instr_id": name, "trajectory": [[path[0]], list(path[1:])], "pred_objid": found}
        for name, (path, found) in answers.items()
    ]


def duet_with_angles(answers):
    return [
        {**item, "trajectory": [[[v, 0.5, 0] for v in action] for action in item["trajectory"]]}
        for item in duet(answers)
    ]


@pytest.fixture
def root(tmp_path):
    names = list(PLACES)
    connectivity = []
    for name, place in PLACES.items():
        pose = np.eye(4)
        pose[:3, 3] = place
        free = [(name, other) in WAYS or (other, name) in WAYS for other in names]
        connectivity.append(
            {"image_id": name, "pose": pose.ravel().tolist(), "included": name != "f", "unobstructed": free}
        )
    write(tmp_path / "connectivity" / "fake_connectivity.json", connectivity)
    for name, numbers in SEES.items():
        objects = {str(n): {"name": "thing", "visible_pos": [3], "bbox2d": [[1, 2, 3, 4]]} for n in numbers}
        objects["8" if 8 not in numbers else "99"] = {"name": "hidden", "visible_pos": [], "bbox2d": []}
        write(tmp_path / "reverie" / "BBox" / f"fake_{name}.json", {name: objects})
    write(tmp_path / "reverie" / "REVERIE_val_seen.json", TASKS)
    return tmp_path


def write(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
    return path


def score(root, content):
    return Reverie().score(write(root / "answers.json", content), root)


@pytest.mark.parametrize("form", [official, duet, duet_with_angles, lambda answers: dict(enumerate(official(answers)))])
def test_scores_are_those_worked_out_by_hand(root, form):
    (row,) = score(root, form(ANSWERS))
    assert row == {
        "split": "val_seen",
        "episodes": 3,
        "ignored": 0,
        **{name: round(100 * value, 2) for name, value in BY_HAND.items()},
    }


def test_an_object_counts_where_it_is_named_and_not_only_where_it_is_seen(root):
    """DUET's rule: RGS asks for the object alone."""
    (row,) = score(root, official({**ANSWERS, "1_8_1": ("ab", 8)}))
    assert (row["SR"], row["OSR"], row["RGS"]) == (66.67, 66.67, 100)
    assert row["RGSPL"] == round(100 * (7 / 17 + 1 + 1) / 3, 2)


def test_no_object_named_is_a_wrong_one_and_a_missing_key_is_told(root, caplog):
    (row,) = score(root, [{**item, "predObjId": None} for item in official(ANSWERS)])
    assert not caplog.messages
    unnamed = [{key: value for key, value in item.items() if key != "predObjId"} for item in official(ANSWERS)]
    assert score(root, unnamed) == [row]
    assert (row["SR"], row["RGS"], row["RGSPL"]) == (66.67, 0, 0)
    (message,) = caplog.messages
    assert "answers.json: 3 of 3 answers have no key predObjId" in message


def test_an_answer_without_an_object_among_others_is_a_warning(root, caplog):
    answers = official(ANSWERS)
    answers[0]["predObjId"] = None
    score(root, answers)
    (message,) = caplog.messages
    assert message.endswith(
        "answers.json: 1 of 3 answers name no object, and count as failures in RGS (remote grounding success)"
    )


def test_a_target_that_the_end_of_the_path_does_not_show_is_a_warning(root, caplog):
    tasks = json.loads((root / "reverie" / "REVERIE_val_seen.json").read_text())
    end = tasks[0]["path"][-1]
    write(root / "reverie" / "BBox" / f"fake_{end}.json", {end: {}})
    score(root, official(ANSWERS))
    (message,) = caplog.messages
    assert re.search(
        r"for \d of 3 instructions, the target object is not in the box file .* of the last viewpoint .* such as 1_8_0",
        message,
    )


@pytest.mark.parametrize("angles", [[0.5, "north"], [True, 0.0], [None, 0.0]])
def test_a_step_without_two_angles_is_refused(root, angles):
    answers = official(ANSWERS)
    answers[0]["trajectory"][0] = [answers[0]["trajectory"][0][0], *angles]
    with pytest.raises(
        DataError, match=r"answer 1 of 3 is invalid \(the heading and elevation of a step are .*, not numbers\)"
    ):
        score(root, answers)


@pytest.mark.parametrize("named", [1e300, 7.0, True, [], {}, "", "x", 10**18])
def test_what_is_no_object_id_is_refused(root, named):
    answers = official(ANSWERS)
    answers[0]["predObjId"] = named
    with pytest.raises(DataError, match=r"names the object .*, expected an integer id of at most 9 digits, or null"):
        score(root, answers)


def test_an_agent_that_stays_is_scored(root):
    (row,) = score(root, official(dict.fromkeys(ANSWERS, ("a", 0))))
    assert [row[name] for name in BY_HAND] == [0] * 5


def test_splits_are_scored_apart_and_what_counts_in_none_is_counted(root):
    write(root / "reverie" / "REVERIE_val_unseen.json", [{**TASKS[1], "path_id": 3}])
    write(
        root / "reverie" / "REVERIE_test.json",
        [{"path_id": 5, "scan": "fake", "heading": 0.0, "path": ["a"], "instructions": ["?"]}],
    )
    both = {**ANSWERS, "3_9_0": ("abd", 9), "4_1_0": ("zz", 1)}
    seen, unseen = score(root, [*official(both), *official({"2_9_0": ("a", 1)})])
    assert (seen["split"], seen["episodes"], seen["ignored"], seen["SPL"]) == (
        "val_seen",
        3,
        2,
        round(100 * BY_HAND["SPL"], 2),
    )
    assert (unseen["split"], unseen["episodes"], unseen["ignored"], unseen["SPL"]) == ("val_unseen", 1, 2, 100)


def test_ways_are_shortest_in_3d(root):
    number, distance_m = walking_distances(connectivity_path(root, "fake"))
    assert list(number) == ["a", "b", "c", "d", "e"]  # f, by which d would be nearer, is not included
    assert distance_m[number["a"]] == pytest.approx([0, 3, 7, 8, np.inf])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"1_8_1": None},
            r"answers.json has no answer to 1 of the 3 instructions of the split val_seen, expected an answer to each; "
            r"missing: 1_8_1$",
        ),
        (
            dict.fromkeys(ANSWERS),
            r"none of the answers in .* belongs to an instruction of .*, expected answers to the instructions of at "
            r"least one split \(val_seen \(3 instr",
        ),
        ({"1_8_0": ("abz", 8)}, "the answer 1_8_0: the viewpoint 'z' is not in the building fake"),
        ({"1_8_0": ("afd", 8)}, "the answer 1_8_0: the viewpoint 'f' is not in the building fake"),
        ({"1_8_0": ("bc", 8)}, "1_8_0: the trajectory begins at the viewpoint b, expected a"),
        (
            {"1_8_0": ("abe", 8)},
            "1_8_0: the trajectory jumps between viewpoints of the building fake that no path connects",
        ),
        ({"1_8_0": ("", 8)}, "1_8_0 has an empty trajectory"),
    ],
)
def test_what_is_wrong_with_an_answer_is_one_line(root, change, message):
    with pytest.raises(DataError, match=message) as caught:
        score(root, official({name: answer for name, answer in {**ANSWERS, **change}.items() if answer}))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[{", "is not JSON"),
        ("3", "contains int, expected a list of"),
        ("[3]", r"answer 1 of 1 is invalid \('int' object is not subscriptable\), expected a list of"),
        ('[{"instr_id": "1_8_0"}]', r"answer 1 of 1 is invalid \(no key 'trajectory'\), expected a list of"),
        (
            '[{"instr_id": "1_8_0", "trajectory": [["a", 0, 0], 7]}]',
            r"answer 1 of 1 is invalid \(the trajectory has the type int, not list\), expected a list of",
        ),
    ],
)
def test_a_file_that_is_no_submission_is_told_in_one_line(root, content, message):
    (root / "answers.json").write_text(content)
    with pytest.raises(DataError, match=message):
        Reverie().score(root / "answers.json", root)


def test_an_episode_that_ends_outside_its_building_is_told_in_one_line(root):
    write(root / "reverie" / "REVERIE_val_seen.json", [{**task, "path": ["a", "z"]} for task in TASKS])
    with pytest.raises(DataError, match="1_8_0: the viewpoint 'z' is not in the building fake"):
        score(root, official(ANSWERS))


def test_missing_data_is_named(root):
    (root / "reverie" / "BBox" / "fake_c.json").unlink()
    with pytest.raises(DataError, match=r"cannot read .*fake_c.json"):
        score(root, official(ANSWERS))


def test_episodes_are_those_of_the_paths(root):
    """A heading of 0 is north, the world's y axis, and grows clockwise; instructions to one object are one episode."""
    there, up = Reverie().episodes("val_seen", root)
    assert (there.world, there.start, there.goal) == ("fake", "fake/a", "fake/c")
    assert (up.start, up.goal) == ("fake/a", "fake/d")
    assert (there.yaw_deg, up.yaw_deg) == pytest.approx((90 - np.degrees(0.5), 90 - np.degrees(3.0)))
    with pytest.raises(UnknownName, match="unknown split 'val_sen'"):
        Reverie().episodes("val_sen", root)


def test_what_was_walked_becomes_answers_to_all_instructions(root):
    """From a, looking east, to b, looking north, then to c; the second episode was not walked."""
    walked = np.array([(*PLACES["a"], 0.0), (*PLACES["b"], np.pi / 2), (*PLACES["c"], -np.pi / 2)])
    content = Reverie().submission("val_seen", root, [walked, None])
    assert [item["instr_id"] for item in content] == ["1_8_0", "1_8_1", "2_9_0"]
    assert content[0]["trajectory"] == content[1]["trajectory"]
    assert [step[0] for step in content[0]["trajectory"]] == ["a", "b", "c"]
    assert [step[1] for step in content[0]["trajectory"]] == pytest.approx([np.pi / 2, 0, np.pi])
    assert content[2]["trajectory"] == [["a", 3.0, 0.0]]
    assert {item["predObjId"] for item in content} == {None}
    (row,) = score(root, content)
    assert (row["SR"], row["OSR"], row["SPL"], row["RGS"]) == (66.67, 66.67, 66.67, 0)


@pytest.fixture
def walked(building, tmp_path, monkeypatch):
    """The folder of a building whose viewpoint a joins b and c, with an episode from b to c; the working directory."""
    connectivity = building.root / "connectivity" / "fake_connectivity.json"
    listed = json.loads(connectivity.read_text())
    names = [viewpoint["image_id"] for viewpoint in listed]
    for viewpoint in listed:
        viewpoint["unobstructed"] = [viewpoint["image_id"] + other in ("ab", "ba", "ac", "ca") for other in names]
    write(connectivity, listed)
    task = {**TASKS[0], "objId": 4, "path": ["b", "a", "c"]}
    write(building.root / "reverie" / "REVERIE_val_seen.json", [task])
    monkeypatch.chdir(tmp_path)
    return building.root


def test_an_agent_that_is_told_the_goal_writes_a_submission(walked):
    """Told its place as well, it walks the reference path, b to a to c."""
    command = (
        *("navigate", "--data", "matterport-annotations", "--data-dir", walked, "--methods", "objects"),
        *("--episodes", "reverie:val_seen", "--positioning", "all", "--engine", "inline"),
    )
    found = run(*command, "--json").json
    assert [row["method"] for row in found["rows"]] == ["objects", "objects without positioning", "true place"]
    assert any("the agent knows the goal of each episode, so the results are upper bounds" in n for n in found["notes"])
    for row in found["rows"]:
        submission = Path(found["run"]) / "methods" / row["method"] / "submission.json"
        (scored,) = Reverie().score(submission, walked)
        assert (scored["split"], scored["episodes"]) == ("val_seen", 2)
        assert row["scores"] == {name: scored[name] for name in BY_HAND}
    path = [step[0] for step in json.loads(submission.read_text())[0]["trajectory"]]
    assert list(dict.fromkeys(path)) == ["b", "a", "c"]
    assert (scored["SR"], scored["SPL"], row["success_rate"]) == (100, 100, 1)
    printed = run(*command).out
    assert re.search(r"metrics of the benchmark.*OSR.*true place +100.00 +100.00", printed, re.DOTALL)


def test_an_experiment_takes_published_episodes(walked):
    table = {"title": "T", "task": "navigation", "data": "matterport-annotations", "methods": ["objects"]}
    content = {"title": "E", "question": "?", "tables": {"bound": {**table, "episodes": "reverie:val_seen"}}}
    write(Path("bound.yaml"), content)
    (without,) = run_experiment("bound.yaml", Request(), results="stored").tables
    assert without.skipped.endswith("--data-dir DIR")
    (found,) = run_experiment("bound.yaml", Request(data_dir=walked, engine="inline"), results="stored").tables
    assert set(found.stored.rows[0]["scores"]) == set(BY_HAND)
    assert list(found.tables()[1].headings) == ["method", "input", *BY_HAND]


def test_data_without_a_folder_has_no_published_episodes():
    data = "matterport-annotations"
    result = run("navigate", "--data", data, "--methods", "objects", "--episodes", "reverie:val_seen")
    reason = (
        f"the episodes reverie:val_seen need the folder of the dataset {data}, received no folder: pass the folder "
        "as --data-dir DIR"
    )
    line = f"error: {reason}\n"
    assert (result.code, result.err) == (2, line)


class Lenient(Reverie):
    """Broken."""

    def score(self, answers, root):
        return []


class Careless(Reverie):
    """Broken."""

    def score(self, answers, root):
        return json.loads(answers.read_text())


def test_it_conforms():
    assert registry().get("scorer", "reverie") is Reverie
    assert conforms(Reverie)


@pytest.mark.parametrize(("scorer", "received"), [(Lenient, "0 rows"), (Careless, "FileNotFoundError: .*")])
def test_a_scorer_that_hides_a_bad_file_is_told_in_one_line(scorer, received):
    breaks(f"score of a missing file, .*: received {received}, expected DataError", scorer)


def test_the_command_prints_a_table_or_json(root):
    file = write(root / "answers.json", official(ANSWERS))
    assert run("score", "reverie", file, "--data", root, "--json").json == Reverie().score(file, root)
    printed = run("score", "reverie", file, "--data", root).out
    assert all(word in printed for word in ("val_seen", "OSR", "100.00", "66.67"))
    failed = run("score", "reverie", root / "absent.json", "--data", root)
    assert (failed.code, failed.err.count("\n")) == (2, 1)


def test_reference_paths_reach_every_object_of_the_real_buildings(real_root, tmp_path):
    """The reference paths end where the object is seen; an independent graph gives the same lengths."""
    splits = read_episodes(real_root)
    assert {split: len(episodes) for split, episodes in splits.items()} == {"val_seen": 790, "val_unseen": 1492}
    content = [
        {"instr_id": name, "trajectory": [[v, 0, 0] for v in e.path], "predObjId": e.object_id}
        for es in splits.values()
        for name, e in es.items()
    ]
    for row in Reverie().score(write(tmp_path / "answers.json", content), real_root):
        assert [row[name] for name in ("SR", "OSR", "RGS", "ignored")] == [100, 100, 100, 0]
        assert row["SPL"] == row["RGSPL"]
        lengths = []
        for episode in splits[row["split"]].values():
            graph = networkx_graph(real_root, episode.scan)
            walked = sum(nx.dijkstra_path_length(graph, a, b) for a, b in nx.utils.pairwise(episode.path))
            lengths.append(nx.dijkstra_path_length(graph, episode.path[0], episode.path[-1]) / walked)
        assert row["SPL"] == pytest.approx(100 * np.mean(lengths), abs=0.005)


_graphs = {}


def networkx_graph(root, scan):
    if scan not in _graphs:
        listed = json.loads(connectivity_path(root, scan).read_text())
        graph = _graphs[scan] = nx.Graph()
        for a in listed:
            for b, free in zip(listed, a["unobstructed"], strict=True):
                if free and a["included"] and b["included"]:
                    length_m = sum((a["pose"][i] - b["pose"][i]) ** 2 for i in (3, 7, 11)) ** 0.5
                    graph.add_edge(a["image_id"], b["image_id"], weight=length_m)
    return _graphs[scan]
