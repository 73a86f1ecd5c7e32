"""`salframe fit`, and what comes of its file in a comparison."""

from __future__ import annotations

import json

import pytest
import yaml
from command_line import run

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.errors import ConfigError

ROOMS = ("--data", "rooms", "--set", "data.rooms=8")


@pytest.fixture
def fitted(fakes, tmp_path):
    """The score of the first place is 1 above those of the others where the room is in the map, and equal where not."""
    done = run("fit", "clear", *ROOMS, "-o", "fitted.yaml")
    assert done.code == 0, done.err
    assert "fitted.yaml" in done.out
    return yaml.safe_load((tmp_path / "fitted.yaml").read_text())


def test_the_file_holds_the_numbers_and_where_they_come_from(fitted):
    told = fitted["provenance"]
    assert told["method"]["localizer"] == "clear"
    assert [(data["name"], data["queries"]) for data in told["data"]] == [("rooms", 32)]
    assert told["set"] == ["data.rooms=8"]
    gain = told["mean_negative_log_likelihood"]
    assert gain["place"]["answers"] == 16
    assert gain["here"]["answers"] == 32
    assert gain["here"]["before"] == pytest.approx(0.6931, abs=1e-4)  # ln 2: half are here
    assert gain["here"]["after"] < 0.1
    assert fitted["posterior"]["head"]["slope"] > 0


def test_a_method_with_the_file_knows_what_it_does_not(fitted, read):
    plain, known = (
        compare(
            Request(("clear",), "rooms", settings=("data.hide_query_place=true", *settings), engine="inline", name=name)
        )
        for name, settings in (("plain", ()), ("known", ("posterior=fitted.yaml",)))
    )
    before, after = plain.row("clear"), known.row("clear")
    assert (before.queries, before.absent_queries, before.accuracy.value) == (20, 10, 0.5)
    assert (before.present_accuracy.value, before.rejection_rate.value, before.calibration_error) == (1.0, 0.0, None)
    assert before.roc_area.value == 1.0  # 0 where the room is there, -1 where it is not
    assert before.false_accept_rate == 0.0
    assert (after.accuracy.value, after.present_accuracy.value, after.rejection_rate.value) == (1.0, 1.0, 1.0)
    assert after.roc_area.value == 1.0
    assert after.calibration_error < 0.15
    assert after.status == {"ok": 10, "out-of-map": 10}
    assert "the place of 10 of 20 queries is not in the map" in known.notes[0]
    shown, hidden = (read(result.report)[0] for result in (known, plain))
    titles = [[figure["title"] for figure in content["figures"]] for content in (shown, hidden)]
    assert "Reliability" in titles[0]
    assert "Reliability" not in titles[1]
    assert "calibration\\nerror" in json.dumps(shown["tables"])
    rows = [json.loads(line) for line in (known.run / "methods" / "clear" / "rows.jsonl").read_text().splitlines()]
    for row in rows:
        assert sum(row["probabilities"]) + row["out_of_map_probability"] == pytest.approx(1, abs=1e-6)


def test_the_table_tells_of_presence(fitted):
    compare_rooms = ("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline")
    assert "ROC" in run(*compare_rooms, "--set", "data.hide_query_place=true").out
    assert "ROC" not in run(*compare_rooms).out


def test_runs_with_hidden_places_have_another_fingerprint_and_share_descriptions(fakes):
    first, second = (
        compare(Request(("reader",), "rooms", settings=settings, engine="inline", name=name))
        for name, settings in (("a", ()), ("b", ("data.hide_query_place=true",)))
    )
    assert first.environment["dataset_fingerprint"] != second.environment["dataset_fingerprint"]
    assert second.row("reader").queries == 2 * first.row("reader").queries
    assert not any("reused" in note for note in second.notes)
    described = [
        [json.loads(line) for line in (one.run / "methods" / "reader" / "descriptions.jsonl").read_text().splitlines()]
        for one in (first, second)
    ]
    # the times are those of the first computation, kept with the descriptions
    assert {row["frame"]: row["ms"] for row in described[0]} == {row["frame"]: row["ms"] for row in described[1]}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("greedy", "--data", "rooms", "-o", "out.txt"),
            "the output file is out.txt, expected a file name that ends in .yaml or .yml",
        ),
        (("plain", "--data", "rooms", "-o", "out.yaml"), "unknown method 'plain'"),
        (
            ("reader", "--data", "rooms", "--set", "data.rooms=1", "-o", "out.yaml"),
            "0 answers to queries from places outside of the map",
        ),
        (("ranger", "--data", "rooms", "-o", "out.yaml"), "needs range images, which the dataset rooms does not have"),
    ],
)
def test_what_cannot_be_fitted_is_one_line(fakes, tmp_path, arguments, message):
    done = run("fit", *arguments)
    assert done.code == 2
    assert message in done.err
    assert len(done.err.splitlines()) == 1
    assert not (tmp_path / "out.yaml").exists()


def test_a_method_without_the_setting_is_refused(fakes, monkeypatch, tmp_path):
    (tmp_path / "mute_plugin.py").write_text(MUTE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,mute_plugin")
    from salframe.framework.components.registry import registry

    registry.cache_clear()
    done = run("fit", "mute", "--data", "rooms", "-o", "out.yaml")
    assert "mute has no setting `posterior`" in done.err
    done = run("fit", "constant", "--data", "rooms", "-o", "out.yaml")
    assert "constant cannot be fitted: in each answer, all places have the same score" in done.err


def test_settings_are_tried_and_evidence_is_weighed(fakes, monkeypatch, tmp_path):
    """A method that is wrong by a room as it is set, one of whose two parts of evidence tells nothing."""
    (tmp_path / "weighing_plugin.py").write_text(WEIGHING)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,weighing_plugin")
    from salframe.framework.components.registry import registry

    registry.cache_clear()
    command = ("fit", "weighing", *ROOMS, "--set", "offset=1", "-o", "out.yaml")
    done = run(*command, "--try", "scales.b=1", "--try", "offset=2,0,3")
    assert done.code == 0, done.err
    found = yaml.safe_load((tmp_path / "out.yaml").read_text())
    assert found["offset"] == 0
    assert found["scales"] == {"a": 1.0, "b": 1.0}  # the whole setting, also where a part of it was tried
    assert found["weights"]["near"] > 1
    assert found["weights"]["same"] == pytest.approx(0, abs=1e-6)
    assert found["provenance"]["try"] == ["scales.b=1", "offset=2,0,3"]
    gain = found["provenance"]["mean_negative_log_likelihood"]["evidence"]
    assert gain["before"] == pytest.approx(2.0794, abs=1e-4)  # ln 8: as many rooms
    assert gain["after"] < 0.3
    assert "posterior" in found
    assert (
        run(
            "fit",
            "weighing",
            *ROOMS,
            "--set",
            "weights.near=1",
            "--set",
            "scales.b=1",
            "-o",
            "only.yaml",
            "--posterior-only",
        ).code
        == 0
    )
    assert set(yaml.safe_load((tmp_path / "only.yaml").read_text())) == {"posterior", "provenance"}
    both = run("fit", "weighing", *ROOMS, "-o", "no.yaml", "--posterior-only", "--try", "offset=1")
    assert (both.code, len(both.err.splitlines())) == (2, 1)
    assert "received both --try and --posterior-only" in both.err
    refused = run("fit", "weighing", *ROOMS, "-o", "no.yaml", "--try", "colour=1")
    assert (refused.code, len(refused.err.splitlines())) == (2, 1)
    assert (
        "--try received colour=1, which changes the descriptions (features) of panoramas, expected settings of the "
        "matching" in refused.err
    )


WEIGHING = """
import numpy as np
import salframe
from salframe.framework.component import match_only
from salframe.framework.validation import Settings
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.localization.evidence import Evidence
from salframe.localization.ranking import rank_places
from fake_plugin import Reader

class Weights(Settings):
    near: float = 0.1
    same: float = 0.0

class Scales(Settings):
    a: float = 1.0
    b: float = 0.0

class Weighing(Reader):
    "Weighs how near a room's number is."
    name = "weighing"
    class Config(Reader.Config):
        weights: Weights = match_only(Weights())
        scales: Scales = match_only(Scales())
        colour: int = 0

    def describe_identity(self):
        return {"name": self.name, "colour": self.config.colour}

    def evidence(self, description):
        near = -np.abs(self.rooms - (description["room"][0] + self.config.offset)) ** self.config.scales.b
        return Evidence([frame.place for frame in self.frames], {"near": near, "same": np.ones(len(near))})

    def match(self, description):
        places = rank_places(self.frames, self.evidence(description).scores(self.config.weights.model_dump()))
        return Localization(places, None, LocalizationStatus.NO_POSE)

@salframe.hookimpl
def salframe_provides():
    return [Weighing]
"""

MUTE = '''
from dataclasses import replace
import salframe
from salframe.framework.component import ComponentConfig
from fake_plugin import Reader

class Mute(Reader):
    """Carries no probabilities."""
    name = "mute"
    class Config(ComponentConfig):
        pass

class Constant(Reader):
    """Likes all places alike."""
    name = "constant"
    def match(self, description):
        answer = super().match(description)
        return replace(answer, places=tuple(place._replace(score=1.0) for place in answer.places))

@salframe.hookimpl
def salframe_provides():
    return [Mute, Constant]
'''


def test_no_data_is_no_fit(fakes, tmp_path):
    from salframe.evaluation.studies.fitting import fit_method

    with pytest.raises(ConfigError, match="received no tuning data"):
        fit_method("reader", [], tmp_path / "out.yaml")
