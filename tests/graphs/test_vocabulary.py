from collections import Counter

import pytest

from salframe.framework.config import read_yaml
from salframe.graphs.vocabulary import NAMES, common_label


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("sofa", "sofa"),
        ("couch", "sofa"),  # COCO
        ("windowpane", "window"),  # ADE20K
        ("conference table", "table"),  # house
        ("tv", "television"),
        ("Potted Plant", "plant"),
        ("harpsichord", "harpsichord"),
    ],
)
def test_other_names_of_the_same_are_one(label, name):
    assert common_label(label) == name


def test_every_name_and_alias_stands_for_one_thing():
    names = read_yaml(NAMES)
    every = Counter([*names, *(alias for aliases in names.values() for alias in aliases)])
    assert {label for label, count in every.items() if count > 1} == set()
    assert all(common_label(name) == name for name in names)
    assert all(label == label.lower() for label in every)


def test_the_vocabulary_knows_every_label_of_house():
    from salframe_house.furniture import CLASSES

    assert len(CLASSES) > 80
    unknown = {label for label in CLASSES if common_label(label) not in read_yaml(NAMES)}
    assert unknown == set()
