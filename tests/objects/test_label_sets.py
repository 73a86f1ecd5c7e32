"""The localizers `objects` and `salient-objects`, against Jaccard indices computed by hand."""

import numpy as np
import pytest
from salframe_objects.localizer import ObjectSetLocalizer, SalientObjectsLocalizer

from salframe.framework.components.identity import identity
from salframe.framework.components.presets import configure, settings
from salframe.graphs.detections import Detections
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama


def panorama_of(*objects):
    """Return a panorama with cubes (label, side in metres) 2 m away."""
    labels, side_m = [label for label, _ in objects], np.array([side for _, side in objects], float)
    size_m = np.repeat(side_m[:, None], 3, axis=1)
    detections = Detections(
        labels, np.ones(len(objects)), np.full((len(objects), 3), [2.0, 0, 0]), size_m, np.zeros(len(objects))
    )
    return Panorama(
        "room",
        annotations=Annotations(
            objects=ObjectBoxes(
                detections.labels,
                tuple(map(str, range(len(objects)))),
                detections.centroid_m,
                detections.size_m,
                detections.yaw_rad,
            )
        ),
    )


BEDROOM = (("bed", 2.0), ("lamp", 1.0), ("lamp", 1.0))
OFFICE = (("desk", 2.0), ("lamp", 1.0))
QUERY = (("bed", 2.0), ("lamp", 1.0), ("vase", 1.0))


def scores(localizer, query=QUERY):
    """Return the status, and the score of each room."""
    rooms = {"bedroom": BEDROOM, "office": OFFICE}
    reference_map = LocalizationMap.from_descriptions(
        localizer,
        [localizer.describe(panorama_of(*room)) for room in rooms.values()],
        [ReferenceFrame(name, name, np.eye(4)) for name in rooms],
    )
    answer = reference_map.answer(localizer.describe(panorama_of(*query)))
    return answer.status, {ranked.place: ranked.score for ranked in answer.places}


def exactly(kind, **options):
    return kind(kind.Config(detector={"kind": "annotations", "noise": "none"}, **options))


def test_sets_count_labels():
    # bedroom: bed and lamp of bed, lamp, vase; office: lamp of desk, lamp, bed, vase
    assert scores(exactly(ObjectSetLocalizer)) == ("no-pose", pytest.approx({"bedroom": 2 / 3, "office": 1 / 4}))


def test_multisets_count_objects():
    overrides = {"detector": {"kind": "annotations", "noise": "none"}}
    config = configure("localizer", "objects-multiset", settings("localizer", "objects-multiset"), [overrides])
    # bedroom: bed and one lamp of bed, two lamps, vase; office as before
    assert scores(ObjectSetLocalizer(config)) == ("no-pose", pytest.approx({"bedroom": 2 / 4, "office": 1 / 4}))


def test_salient_objects_weigh_by_share_of_volume():
    # Volumes 8, 1, 1 of 10 in bedroom and query, 8, 1 of 9 in the office.
    expected = {"bedroom": (0.8 + 0.1) / (0.8 + 0.2 + 0.1), "office": 0.1 / (8 / 9 + 1 / 9 + 0.8 + 0.1)}
    assert scores(exactly(SalientObjectsLocalizer, saliency_power=1.0)) == ("no-pose", pytest.approx(expected))


def test_the_cube_root_makes_volumes_lengths():
    # Lengths 2, 1, 1 over the cube root of 10, and 2, 1 over that of 9.
    unit, office = 10 ** (-1 / 3), 9 ** (-1 / 3)
    expected = {"bedroom": 3 / 5, "office": unit / (2 * office + office + 2 * unit + unit)}
    assert scores(exactly(SalientObjectsLocalizer)) == ("no-pose", pytest.approx(expected))


def test_a_power_of_zero_is_the_multiset():
    assert scores(exactly(SalientObjectsLocalizer, saliency_power=0.0)) == scores(
        exactly(ObjectSetLocalizer, labels="multiset")
    )


@pytest.mark.parametrize("kind", [ObjectSetLocalizer, SalientObjectsLocalizer])
def test_nothing_in_common_is_no_match(kind):
    assert scores(exactly(kind), (("bath", 1.0),)) == ("no-match", {})
    assert scores(exactly(kind), ()) == ("no-objects", {})


def test_how_labels_are_counted_matters_to_matching_only():
    sets, multisets = (exactly(ObjectSetLocalizer, labels=labels) for labels in ("set", "multiset"))
    assert identity(sets.config) != identity(multisets.config)
    assert sets.describe_identity() == multisets.describe_identity()
    weights = [exactly(SalientObjectsLocalizer, saliency_power=power).describe_identity() for power in (0.5, 1.0)]
    assert weights[0] != weights[1]
