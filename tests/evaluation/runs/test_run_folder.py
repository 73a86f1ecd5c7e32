from __future__ import annotations

import json

import numpy as np
import pytest
import yaml

from salframe.evaluation.runs.request import Resolved
from salframe.evaluation.runs.rows import LineCounter, RowWriter, read_rows
from salframe.evaluation.runs.run_folder import MethodStatus, Outcome, Run
from salframe.evaluation.tasks.localization.answering import answer_row
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.framework.components.installation import environment
from salframe.framework.components.presets import configure, settings
from salframe.framework.errors import ConfigError, DataError, InvalidAnswer
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace


def config(role: str, name: str, **given: object):
    return configure(role, name, settings(role, name), [given])


def resolved(**methods):
    return Resolved(methods, "rooms", config("dataset", "rooms"), config("engine", "inline"))


def open_run(runs, seed=0, **given):
    asked = resolved(reader=config("localizer", "reader", **given))
    return Run.open(runs, "test", {"name": "localization"}, asked, seed)


def test_a_row_cut_off_by_a_kill_is_dropped(tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text('{"query": 1}\n{"query": 2}\n{"que')
    assert list(read_rows(path, dict)) == [{"query": 1}, {"query": 2}]
    with RowWriter(path) as rows:
        rows.append({"query": 3})
    assert [json.loads(line)["query"] for line in path.read_text().splitlines()] == [1, 2, 3]


def test_a_damaged_line_in_the_middle_is_an_error(tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text('{"query": 1}\n{"que\n{"query": 3}\n')
    with pytest.raises(DataError, match="line 2"):
        list(read_rows(path, dict))


def test_rows_refuse_nan(tmp_path):
    with (
        RowWriter(tmp_path / "rows.jsonl") as rows,
        pytest.raises(InvalidAnswer, match=r"NaN or infinity.*query_ms.*nan"),
    ):
        rows.append({"query_ms": float("nan")})
    assert list(read_rows(tmp_path / "rows.jsonl", dict)) == []


@pytest.mark.parametrize("side", [3, 6])
def test_a_covariance_on_the_floor_and_in_space_is_read_again(tmp_path, side):
    found = Localization((RankedPlace("map-0", "hall", 1.0),), np.eye(4), LocalizationStatus.OK, np.eye(side))
    row = {"fold": "all", "query": "q", **answer_row(found), "status": "ok", "error": None}
    with RowWriter(tmp_path / "rows.jsonl") as rows:
        rows.append(row)
    assert [np.array(read.covariance).tolist() for read in read_rows(tmp_path / "rows.jsonl", AnswerRow)] == [
        np.eye(side).tolist()
    ]
    with RowWriter(tmp_path / "rows.jsonl") as rows:
        rows.append({**row, "covariance": [[1.0, 0.0], [0.0, 1.0]]})
    with pytest.raises(
        DataError, match=r"`covariance` of an answer has \d+ rows of lengths .*, expected 3 x 3 or 6 x 6"
    ):
        list(read_rows(tmp_path / "rows.jsonl", AnswerRow))


def test_the_folder_follows_every_setting(fakes, tmp_path):
    assert open_run(tmp_path).directory == open_run(tmp_path).directory
    folders = {
        open_run(tmp_path).directory,
        open_run(tmp_path, seed=1).directory,
        open_run(tmp_path, offset=1).directory,
    }
    assert len(folders) == 3
    assert all(len(folder.name) == len("test-") + 8 for folder in folders)


def test_the_folder_follows_a_components_version(fakes, tmp_path, monkeypatch):
    before = open_run(tmp_path).directory
    monkeypatch.setattr("fake_plugin.Reader.version", "2")
    assert open_run(tmp_path).directory != before


def test_request_yaml_holds_every_setting_and_reads_back(fakes, tmp_path):
    run = open_run(tmp_path, offset=2)
    content = yaml.safe_load((run.directory / "request.yaml").read_text())
    assert content["methods"]["reader"]["offset"] == 2
    assert content["methods"]["reader"]["wrong_from"] == 99
    again = Run.load(run.directory)
    assert again.labels == ["reader"]
    assert again.method("reader", "localizer") == config("localizer", "reader", offset=2)
    assert again.data() == config("dataset", "rooms")


def test_an_edited_request_is_an_error(fakes, tmp_path):
    path = open_run(tmp_path).directory / "request.yaml"
    path.write_text(path.read_text().replace("offset: 0", "offset: 1"))
    with pytest.raises(ConfigError, match="edited"):
        open_run(tmp_path)


def test_a_changed_dataset_is_an_error(fakes, tmp_path):
    run = open_run(tmp_path)
    run.bind("one")
    run.bind("one")
    with pytest.raises(DataError, match="changed"):
        run.bind("two")


def test_no_two_labels_share_a_folder(fakes, tmp_path):
    run = open_run(tmp_path)
    long = "proposed[" + ",".join(f"detector.noise.part_{i}=0.{i}" for i in range(20)) + "]"
    labels = ["a/b", "a_b", "a%2Fb", "a[b=c]", "a", ".", "..", "...", "../a", "/a", long, f"{long}2"]
    assert len({run.folder(label) for label in labels}) == len(labels)
    assert all(run.folder(label).resolve().parent == run.directory.resolve() / "methods" for label in labels)
    for label in labels:
        run.end(label, Outcome(MethodStatus.DONE))


@pytest.mark.parametrize("name", ["", "a/b", ".", ".."])
def test_a_name_with_slashes_is_an_error(fakes, tmp_path, name):
    with pytest.raises(ConfigError, match="slashes"):
        Run.open(tmp_path, name, {"name": "localization"}, resolved(), 0)


def test_environment_lists_versions_and_plugins(fakes):
    found = environment()
    assert {"salframe", "numpy", "scipy"} <= found["packages"].keys()
    assert {"role": "localizer", "name": "reader", "version": "1", "package": "fake_plugin"} in found["plugins"]


def test_an_outcome_reads_back(fakes, tmp_path):
    run = open_run(tmp_path)
    assert run.outcome("reader") is None
    ended = Outcome(MethodStatus.CRASHED, "why", ("range", "rgb"))
    run.end("reader", ended)
    assert run.outcome("reader") == ended


def test_lines_are_counted_by_what_was_added(tmp_path):
    path, lines = tmp_path / "rows.jsonl", LineCounter()
    assert lines.count(path) == 0
    path.write_text("1\n2\n3")
    assert lines.count(path) == 2
    path.write_text("1 2 3")  # as long as what was read before, and without a line: it must not be looked at again
    assert lines.count(path) == 2
    path.write_text("1\n2\n4444\n5\n")
    assert lines.count(path) == 4


def test_a_line_that_is_cut_off_and_written_anew_is_counted_once(tmp_path):
    path, lines = tmp_path / "rows.jsonl", LineCounter()
    path.write_text('{"query": 1}\n{"query": 2, "places": [')
    assert lines.count(path) == 1
    with RowWriter(path) as rows:
        rows.append({"q": 2})
    assert lines.count(path) == 2


def test_notes_are_those_of_the_last_request(fakes, tmp_path):
    run = open_run(tmp_path)
    run.set_notes(["one"])
    run.set_notes(["two"])
    assert Run.load(run.directory).notes() == ["two"]


def test_a_method_at_work_has_not_ended(fakes, tmp_path):
    run = open_run(tmp_path)
    run.end("reader", Outcome(MethodStatus.CRASHED, "the first try"))
    run.begin("reader")
    assert run.outcome("reader") is None


def test_a_run_that_cannot_be_read_stops_no_reuse(fakes, tmp_path):
    other = open_run(tmp_path, seed=1)
    other.begin("reader")
    (other.folder("reader") / "identity.json").write_text("garbage")
    run = open_run(tmp_path)
    run.reuse("reader", "0123")
    assert run.notes() == []


@pytest.mark.parametrize("is_present", [True, False])
def test_answers_of_a_run_folder_with_another_format_are_not_reused(fakes, tmp_path, is_present):
    other = open_run(tmp_path, seed=1)
    other.reuse("reader", "0123")
    with RowWriter(other.folder("reader") / "rows.jsonl") as rows:
        rows.append({"query": "a"})
    if not is_present:
        path = other.directory / "request.yaml"
        path.write_text(path.read_text().replace("format: 2", "format: 1"))
        with pytest.raises(ConfigError, match="format 1 of another version of salframe, expected 2: repeat the run"):
            Run.load(other.directory)
    run = open_run(tmp_path)
    run.reuse("reader", "0123")
    assert (run.folder("reader") / "rows.jsonl").exists() == is_present
    assert len(run.notes()) == is_present


def test_a_run_folder_of_a_newer_version_needs_an_update(fakes, tmp_path):
    path = open_run(tmp_path).directory / "request.yaml"
    path.write_text(path.read_text().replace("format: 2", "format: 3"))
    with pytest.raises(ConfigError, match=r"format 3 .*, expected 2: .* pip install --upgrade salframe$"):
        Run.load(path.parent)
