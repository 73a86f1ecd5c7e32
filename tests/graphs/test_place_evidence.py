"""The setting `evidence` of `saliency-places`, its weights, and evidence of another plugin in it."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from salframe_graphs.places.evidence import PlaceEvidence, shipped_weights
from salframe_graphs.places.evidence_components import LabelEvidence
from salframe_graphs.places.localizer import SaliencyPlacesLocalizer

from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import changed_settings, list_settings
from salframe.framework.errors import ConfigError, SalframeError
from salframe.localization.describing import describe_frame
from salframe.localization.evidence_model import PlaceHypotheses
from salframe.localization.map import LocalizationMap
from salframe.panoramas.geometry import invert_pose
from salframe.testing.rooms import map_frames, query_frames, query_truths

DEFAULT = ["likelihood", "outline", "panorama", "labels"]
PAINT = {"evidence": [*DEFAULT, "paint"], "weights": {"zero": 1.0}}


@pytest.fixture(autouse=True)
def plugins(monkeypatch):
    """The components of evidence_plugin and of salframe_graphs."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "salframe_graphs,salframe_annotations,evidence_plugin")
    registry.cache_clear()
    yield
    registry.cache_clear()


def config(**settings):
    return configure("localizer", "saliency-places", {"detector": "annotations", **settings})


def build(**settings):
    return LocalizationMap.build(SaliencyPlacesLocalizer(config(**settings)), map_frames())


def test_the_weights_are_those_of_the_columns_listed():
    shipped = shipped_weights()
    assert config().weights == shipped
    assert list(config(evidence=["labels", "outline"]).weights) == [
        "detected_labels",
        "labels_shared",
        "bearing_detected_labels",
        "outline",
    ]
    assert config(evidence=["outline"]).weights == {"outline": shipped["outline"]}
    assert config(evidence=["repainted"]).weights == {"paint": 4.0}  # the component's own
    assert config(weights={"outline": 0.5}).weights == {**shipped, "outline": 0.5}
    assert config(**PAINT).weights == {**shipped, "paint": 4.0, "zero": 1.0}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"evidence": ["outline"], "weights": {"panorama": 1.0}},
            "received a weight with the unknown name 'panorama', expected names of the columns that the setting "
            "`evidence` selects: outline",
        ),
        (
            {"evidence": ["paint"]},
            "received no weight for the evidence zero, expected one for each number that the components in the setting "
            "`evidence` compute: set weights.zero, or fit all weights with `salframe fit`",
        ),
        (
            {"evidence": ["repainted", "paint"]},
            "components in the setting `evidence` compute a number .column. named 'paint', expected different names",
        ),
        ({"weights": None}, "received None, expected a dictionary"),
        ({"weights": {"outline": "heavy"}}, "received 'heavy', expected a number"),
        ({"evidence": []}, r"received \[\], expected a list with at least one evidence"),
        ({"evidence": ["paintt"]}, "unknown evidence 'paintt', did you mean 'paint'"),
    ],
)
def test_wrong_weights_and_lists_are_refused_in_one_line(settings, message):
    with pytest.raises(SalframeError, match=message) as error:
        config(**settings)
    assert "\n" not in str(error.value)


def test_a_file_has_the_weights_of_all_columns(tmp_path):
    path = tmp_path / "fitted.yaml"
    path.write_text(yaml.safe_dump({"weights": {"outline": 0.5, "paint": 2.0}}))
    assert config(evidence=["repainted", "outline"], weights=str(path)).weights == {"paint": 2.0, "outline": 0.5}
    with pytest.raises(ConfigError, match="received a weight with the unknown name 'paint'"):
        config(evidence=["outline"], weights=str(path))
    with pytest.raises(
        ConfigError, match="received no weight for the evidence detected_labels, labels_shared, bearing_detected_labels"
    ):
        config(evidence=["repainted", "outline", "labels"], weights=str(path))


def test_descriptions_are_known_by_what_is_stored_of_the_evidence():
    of_list = {
        names: SaliencyPlacesLocalizer(config(evidence=names.split(), weights={})).describe_identity()
        for names in ("outline", "outline likelihood", "labels", "labels outline", "outline repainted")
    }
    assert of_list["outline"] == of_list["outline likelihood"] == of_list["labels outline"]
    assert of_list["outline"] != of_list["labels"]
    assert of_list["outline"] != of_list["outline repainted"]


def test_a_changed_list_is_one_change():
    """The weights of columns that are gone are none; one that was added has its key."""
    changes = dict(changed_settings(config(evidence=["outline"]), config()))
    assert changes == {"evidence": ["outline"]}
    changes = dict(changed_settings(config(**PAINT), config()))
    assert changes == {"evidence": PAINT["evidence"], "weights.paint": 4.0, "weights.zero": 1.0}


def test_each_column_is_a_setting_with_its_meaning():
    rows = {row.key: row for row in list_settings(config(evidence=["outline", "repainted"]))}
    assert rows["evidence"].value == ["outline", "repainted"]
    assert (rows["weights.paint"].value, rows["weights.paint"].default) == (4.0, None)
    assert rows["weights.paint"].help == "weight of the difference (0 to 1)"
    assert rows["weights.outline"].value == rows["weights.outline"].default == shipped_weights()["outline"]
    assert "weights.panorama" not in rows


def test_the_evidence_of_a_plugin_is_weighed(tmp_path):
    """Its column is the difference of the mean colours of the panoramas, also in a map that was saved and opened."""
    built = build(**PAINT)
    built.save(tmp_path / "map")
    opened = LocalizationMap.open(tmp_path / "map")
    means = {frame.place: frame.load().rgb.mean((0, 1)) / 255 for frame in map_frames()}
    for query in query_frames():
        description = describe_frame(built.localizer, query)[0]
        mean = query.load().rgb.mean((0, 1)) / 255
        for localizer in (built.localizer, opened.localizer):
            evidence = localizer.evidence(description)
            assert list(evidence.values) == [*shipped_weights(), "paint", "zero"]
            expected = [-np.abs(means[place] - mean).mean() for place in evidence.places]
            np.testing.assert_allclose(evidence.values["paint"], expected, rtol=1e-12)
        plain = {**evidence.values, "paint": 0 * evidence.values["paint"]}
        weights = built.localizer.config.weights
        difference = evidence.scores(weights) - type(evidence)(evidence.places, plain).scores(weights)
        np.testing.assert_allclose(difference, 4 * np.array(expected), rtol=1e-9)


def test_queries_without_what_evidence_uses_have_no_such_evidence():
    built = build(**PAINT)
    (query, *_) = query_frames(frozenset({"range", "annotations"}))
    evidence = built.localizer.evidence(describe_frame(built.localizer, query)[0])
    assert not evidence.values["paint"].any()
    assert built.localize(query).places[0].place == query_truths()[query.id].place


def test_it_reads_the_parts_that_its_evidence_uses():
    assert SaliencyPlacesLocalizer(config(evidence=["likelihood"])).uses == {"range"}
    assert SaliencyPlacesLocalizer(config(**PAINT)).uses == {"range", "rgb"}


def test_joined_views_have_the_evidence_of_the_last():
    built, truths = build(**PAINT), query_truths()
    frames = [map_frames()[0], query_frames()[0]]
    descriptions = [describe_frame(built.localizer, frame)[0] for frame in frames]
    T_world_query = truths[frames[1].id].T_world_pano
    T_last_view = np.stack([invert_pose(T_world_query) @ frames[0].T_world_pano, np.eye(4)])
    joined = built.localizer.join(descriptions, T_last_view, built.localizer.odometry)
    np.testing.assert_array_equal(joined["paint"], descriptions[1]["paint"])
    answer = built.localizer.match(joined)
    assert answer.places[0].place == truths[frames[1].id].place


def test_evidence_of_objects_needs_a_localizer_with_objects():
    hypotheses = PlaceHypotheses(np.zeros(1, int), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(1))
    with pytest.raises(
        ConfigError, match="'labels' needs objects, so it works only with the localizer saliency-places"
    ):
        LabelEvidence().score({}, hypotheses)


def test_the_step_of_columns_is_that_of_all_evidence(monkeypatch):
    paint, outline = (registry().get("evidence", name) for name in ("paint", "outline"))
    configs = [paint.Config(), outline.Config()]
    for first, second, expected in ((4, 6, 12), (1, None, None), (1, 1, 1)):
        monkeypatch.setattr(paint, "column_step", first)
        monkeypatch.setattr(outline, "column_step", second)
        assert PlaceEvidence(configs).column_step == expected
