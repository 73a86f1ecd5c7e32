"""What `auto` becomes on which data, who is told of it, and where it is kept."""

from __future__ import annotations

import html
from pathlib import Path

import pytest
import yaml
from auto_plugin import ABSENT
from command_line import run as salframe

from salframe.evaluation.runs.request import Request, resolve
from salframe.evaluation.tasks.localization.task import compare
from salframe.evaluation.tasks.navigation.task import navigate
from salframe.framework.components.auto import Choice
from salframe.framework.components.defaults import auto_order
from salframe.framework.components.presets import configure, configure_default
from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError, InputMissing, RequirementMissing, SalframeError
from salframe.localization.map import open_map
from salframe.localization.map_files import map_config

REMARK = auto_order("detector")["panoseg"]
BARE, NO_RANGE = "data.instances=false", "data.ranges=false"


@pytest.fixture
def detectors(plugins):
    plugins("matching_plugin", "auto_plugin", "salframe_objects", "salframe_engines")


def request(*methods, settings=(), **given):
    return Request(methods or ("objects",), "furnished", settings=settings, engine="inline", **given)


def taken(*settings):
    """The name that `auto` became, and the notes."""
    found = resolve(request(settings=settings))
    return found.methods["objects"].detector.kind, found.notes


def test_annotations_come_first(detectors):
    assert taken() == ("annotations", ("objects: 'auto' selected the detector 'annotations'",))


def test_segments_come_next_where_their_weights_are(detectors):
    assert taken(BARE) == ("segments", ("objects: 'auto' selected the detector 'segments'",))
    ABSENT.touch()
    assert taken(BARE) == ("panoseg", (f"objects: 'auto' selected the detector 'panoseg' ({REMARK})",))


def test_a_name_that_nobody_brings_is_left_out(plugins):
    plugins("matching_plugin", "salframe_panoseg", "salframe_objects", "salframe_engines")
    assert taken(BARE)[0] == "panoseg"
    assert taken()[0] == "panoseg"


def test_where_none_can_one_line_says_why_for_each(detectors):
    ABSENT.touch()
    Path("named.yaml").write_text("kind: objects\ndetector: blind\n")
    result = compare(request("objects", "named.yaml", settings=(BARE, NO_RANGE)))
    row = result.row("objects")
    assert not row.available
    assert row.reason == (
        "'auto' cannot select a detector for furnished, because none can run: "
        "'annotations': needs annotations, which the data does not have; "
        "'segments': no file ade20k.tflite; get it with: salframe weights fetch ade20k; "
        "'panoseg': needs range images, which the data does not have"
    )
    assert result.row("named").measured
    with pytest.raises(InputMissing, match=r"'auto' cannot select a detector .*; 'segments': no file"):
        resolve(request(settings=(BARE, NO_RANGE, "detector.noise=none")))


def test_settings_go_to_what_it_became_or_are_refused_in_its_name(detectors):
    assert resolve(request(settings=("detector.noise=none",))).methods["objects"].detector.noise == "none"
    ABSENT.touch()
    found = resolve(request(settings=(BARE, "detector.min_score=0.5")))
    assert found.methods["objects"].detector.min_score == 0.5
    with pytest.raises(
        ConfigError, match=r"unknown setting detector\.noise .* \('auto' selected the detector 'panoseg'\)"
    ):
        resolve(request(settings=(BARE, "detector.noise=none")))
    with pytest.raises(
        ConfigError, match=r"detector\.min_score: received 'x'.* \('auto' selected the detector 'panoseg'\)"
    ):
        resolve(request(settings=(BARE, "detector.min_score=x")))


def test_a_named_detector_is_taken_as_it_is(detectors):
    assert taken("detector.kind=panoseg") == ("panoseg", ())
    assert taken("detector=auto")[0] == "annotations"
    Path("mine.yaml").write_text("kind: objects\ndetector: {kind: auto, noise: none}\n")
    found = resolve(request("mine.yaml", "objects"))
    assert found.methods["mine"].detector.noise == "none"
    assert found.notes == ("mine, objects: 'auto' selected the detector 'annotations'",)


def test_it_is_told_in_table_json_and_report_and_is_what_ran(detectors):
    note = "objects: 'auto' selected the detector 'annotations'"
    asked = ("compare", "--methods", "objects", "--data", "furnished", "--engine", "inline")
    printed = salframe(*asked)
    assert printed.code == 0
    assert note in printed.out.splitlines()
    given = salframe(*asked, "--json").json
    assert given["notes"] == [note]
    assert note in html.unescape(Path(given["report"]).read_text())
    run = Path(given["run"])
    assert yaml.safe_load((run / "request.yaml").read_text())["methods"]["objects"]["detector"]["kind"] == "annotations"
    named = salframe(*asked, "--json", "--set", "detector.kind=annotations").json
    assert named["run"] == given["run"]
    assert named["notes"] == []
    other = salframe(*asked, "--json", "--set", BARE).json
    assert other["run"] != given["run"]
    assert other["rows"][0]["input"] == ["rgb"]


def test_a_run_is_another_one_once_it_becomes_another(detectors):
    with_segments = compare(request(settings=(BARE,)))
    ABSENT.touch()
    without = compare(request(settings=(BARE,)))
    assert with_segments.run != without.run
    assert without.row("objects").input == ("rgb", "range")


def test_a_map_holds_what_it_became_and_opens_without_the_data(detectors):
    done = salframe("build", "furnished", "-o", "map", "--method", "objects")
    assert (done.code, done.err) == (0, "objects: 'auto' selected the detector 'annotations'\n")
    assert map_config(Path("map")).detector.kind == "annotations"
    assert open_map(Path("map")).localizer.config.detector.kind == "annotations"
    asked = salframe("localize", "map", "bedroom-query", "--data", "furnished")
    assert (asked.code, asked.err) == (0, "detector of the map: annotations\n")
    ABSENT.touch()
    refused = salframe("build", "furnished", "-o", "none", "--method", "objects", "--set", BARE, "--set", NO_RANGE)
    assert (refused.code, refused.out, refused.err.count("\n")) == (2, "", 1)
    assert (
        "'auto' cannot select a detector for furnished, because none can run: 'annotations': needs annotations"
        in refused.err
    )


def test_it_is_varied_by_an_ablation(detectors):
    plan = {"method": "objects", "data": "furnished", "vary": {"detector.kind": ["auto", "panoseg"]}}
    Path("kinds.yaml").write_text(yaml.safe_dump(plan))
    done = salframe("ablate", "kinds.yaml", "--engine", "inline", "--json")
    assert [row["input"] for row in done.json["rows"]] == [["annotations"], ["rgb", "range"]]
    assert "objects[detector.kind=auto]: 'auto' selected the detector 'annotations'" in done.json["notes"]


def test_without_data_it_stays_undecided_and_is_not_built(detectors):
    config = configure_default("localizer", "objects")
    assert config.detector.kind == "auto"
    with pytest.raises(
        ConfigError, match=r"'auto' selects a detector only when the dataset is known.*\(annotations, seg"
    ):
        registry().build("localizer", config)
    with pytest.raises(
        ConfigError, match=r"detector\.noise cannot be set, because .* 'auto' selects .* one of annotations"
    ):
        configure("localizer", "objects", {"detector": {"noise": "none"}})
    choice = Choice("mine", lambda: frozenset({"annotations"}))
    decided = configure("localizer", "objects", {}, [{"detector": {"noise": "none"}}], choice)
    assert (decided.detector.kind, decided.detector.noise) == ("annotations", "none")
    assert configure("localizer", "objects", config.model_dump(mode="json"), (), choice).detector.kind == "annotations"


def test_a_listing_says_whether_anything_could_run(detectors, plugins):
    (entry,) = [one for one in salframe("methods", "--json").json if one["name"] == "objects"]
    assert entry["available"]
    plugins("salframe_objects")
    (entry,) = [one for one in salframe("methods", "--json").json if one["name"] == "objects"]
    assert (
        entry["missing"] == "'auto' cannot select a detector, because none can run on this machine: none is installed"
    )
    with pytest.raises(RequirementMissing, match="none is installed"):
        registry().build("localizer", configure_default("localizer", "objects"))


def test_no_component_may_be_called_so():
    from auto_plugin import Named

    with pytest.raises(SalframeError, match="name is 'auto', a reserved word for automatic selection"):
        registry().add(type("Auto", (Named,), {"name": "auto"}), "a-package")


def test_where_agents_walk_and_topologies_are_made_the_same_is_said(plugins):
    plugins(
        "apartment_plugin",
        "auto_plugin",
        "salframe_objects",
        "salframe_engines",
        "salframe_planners",
        "salframe_trackers",
        folders=(".", "navigation"),
    )
    reason = "'auto' cannot select a detector for apartment, because none can run: 'annotations': needs annotations, "
    walked = navigate(Request(("objects",), "apartment", engine="inline"), episodes=2)
    assert walked.row("objects").reason.startswith(reason)
    made = salframe("map", "build", "apartment", "-o", "map", "--method", "objects")
    assert (made.code, made.out) == (2, "")
    assert made.err.startswith(f"error: {reason}")
    assert not Path("map").exists()
