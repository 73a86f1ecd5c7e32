"""Lines of methods as JSON: flat keys, which files of other versions have too."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from salframe.evaluation.runs.run_folder import MethodStatus
from salframe.evaluation.statistics import Estimate
from salframe.evaluation.studies.experiment import experiment_names, read_experiment
from salframe.evaluation.studies.stored import read_results, stored_rows
from salframe.evaluation.tasks.detection.table import Counts, DetectionRow
from salframe.evaluation.tasks.localization.table import LocalizationRow
from salframe.framework.errors import DataError

RESULTS = Path(__file__).parents[3] / "docs" / "results"


def test_an_estimate_is_three_keys():
    row = LocalizationRow(method="m", queries=4, accuracy=Estimate(0.5, 0.25, 0.75), input=("range",))
    content = json.loads(json.dumps(row.to_json()))
    assert (content["accuracy"], content["accuracy_low"], content["accuracy_high"]) == (0.5, 0.25, 0.75)
    assert (content["roc_area"], content["roc_area_low"], content["roc_area_high"]) == (None, None, None)
    assert LocalizationRow.from_json(content) == row


def test_a_row_of_another_version_is_read():
    row = LocalizationRow.from_json(
        {"method": "m", "queries": 4, "accuracy": 0.5, "ended": "crashed", "colour": "red", "precision_at": [1, None]}
    )
    assert row.accuracy == Estimate(0.5)
    assert (row.ended, row.precision_at, row.scene_accuracy) == (MethodStatus.CRASHED, (1.0, None), None)


def test_the_precision_of_a_detector_stands_among_its_counts():
    counts = Counts.of(10, 8, 6)
    row = DetectionRow(
        method="d", panoramas=2, overall=counts, precision=Estimate(0.75, 0.5, 1.0), recall=Estimate(0.6, 0.5, 0.7)
    )
    content = row.to_json()
    assert content["overall"]["precision"] == 0.75
    assert "precision" not in content
    assert content["precision_low"] == 0.5
    assert DetectionRow.from_json(content) == row


def test_a_row_that_is_wrong_is_told():
    with pytest.raises(DataError, match=r"metrics\.json.*queries"):
        LocalizationRow.from_json({"method": "m", "queries": "many"}, "metrics.json")


@pytest.mark.parametrize("name", experiment_names())
def test_kept_rows_are_read_as_they_were_measured(name):
    experiment, results = read_experiment(name), read_results(RESULTS / f"{name}.json")
    for table, study in experiment.tables.items():
        for kept in (results.whole.get(table), results.quick.get(table)):
            for row, content in zip(stored_rows(study, kept), kept.rows, strict=True) if kept else ():
                assert row.measured == content["measured"]
                written = json.loads(json.dumps(row.to_json()))
                assert {key: written[key] for key in content.keys() & written.keys()} == {
                    key: content[key] for key in content.keys() & written.keys()
                }
