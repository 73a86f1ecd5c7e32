from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from salframe.framework.config import read_yaml
from salframe.graphs.vocabulary import NAMES, common_label, is_object, near_names, object_label, unknown_labels_note

CLASS_LISTS = read_yaml(Path(__file__).with_name("class_lists.yaml"))

SPELLINGS = [
    *("chair 2", "chair_02", "chair#3", "Chair.001", "chair (4)", "chair2", "chairs-12", "CHAIR", " chair\t"),
    *("Chair\u00a0", "\uff43\uff48\uff41\uff49\uff52", "cha\u200bir", "chairs"),
]


@pytest.mark.parametrize("label", SPELLINGS)
def test_spellings_of_a_label_are_one(label):
    assert object_label(label) == "chair"


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("Ku\u0308hlschrank 3", "k\u00fchlschrank"),  # composed and decomposed
        ("STÜHLE", "stühle"),
        ("椅子2", "椅子"),
        ("кровать_1", "кровать"),
        ("Straße", "strasse"),
        ("harpsichords", "harpsichord"),
        ("tapestries", "tapestry"),
        ("mattresses", "mattress"),
        ("kitchen_bench-tops", "kitchen bench top"),
        ("knives", "knife"),
        ("42", "42"),
        ("_", "_"),
        ("", ""),
    ],
)
def test_labels_outside_the_vocabulary_have_one_spelling(label, name):
    assert object_label(label) == name


@pytest.mark.parametrize(
    "word",
    ["glass", "stairs", "bus", "lens", "gas", "canvas", "scissors", "cactus", "iris", "press", "mattress", "bookcase"],
)
def test_words_that_end_like_a_plural_are_unchanged(word):
    assert object_label(word) == word
    assert object_label(f"{word} 2") == word


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("sofa", "sofa"),
        ("couch", "sofa"),  # COCO
        ("windowpane", "window"),  # ADE20K
        ("tv_monitor", "television"),  # Matterport3D
        ("TVMonitor", "television"),
        ("Potted Plants", "plant"),
        ("bookshelves", "bookcase"),
        ("washing machines", "washing machine"),
    ],
)
def test_synonyms_are_one_label(label, name):
    assert object_label(label) == common_label(label) == name


@pytest.mark.parametrize(("kind", "name"), [("conference table", "table"), ("Kitchen_Cabinets", "cabinet")])
def test_detectors_share_the_name_of_all_kinds_and_maps_tell_them_apart(kind, name):
    assert common_label(kind) == name != object_label(kind)


def test_the_name_of_a_name_is_itself():
    rng, parts = np.random.default_rng(0), [*"abexyz_- #.,;(2)ßİé椅\u0308\u200b", "es", "ies", "ss", "chair", "shelves"]
    for _ in range(5000):
        label = "".join(rng.choice(parts, rng.integers(1, 9)))
        name, shared = object_label(label), common_label(label)
        assert (object_label(name), common_label(shared)) == (name, shared), repr(label)


def test_every_word_stands_for_one_thing():
    vocabulary = read_yaml(NAMES)
    synonyms, kinds = vocabulary["synonyms"], vocabulary["kinds"]
    words = Counter([*synonyms, *(word for words in synonyms.values() for word in words)])
    assert {word for word, count in words.items() if count > 1} == set()
    assert all(object_label(name) == name for name in synonyms)
    every_kind = Counter(kind for several in kinds.values() for kind in several)
    assert {kind for kind, count in every_kind.items() if count > 1} == set()
    assert all(object_label(kind) == kind for kind in every_kind)
    assert kinds.keys() <= synonyms.keys()
    assert set(vocabulary["not_objects"]).isdisjoint({*words, *every_kind})
    assert kinds.keys().isdisjoint(every_kind)
    assert all(word == word.lower() for word in (*words, *every_kind))


@pytest.mark.parametrize("name", CLASS_LISTS)
def test_the_vocabulary_knows_every_class_of_published_lists(name):
    labels = CLASS_LISTS[name].values() if name == "scannet20" else CLASS_LISTS[name]
    assert [label for label in labels if is_object(object_label(label)) is None] == []


@pytest.mark.parametrize(("name", "count"), [("nyu40", 40), ("scannet20", 20), ("scannet200", 200), ("ade20k", 150)])
def test_the_lists_are_complete(name, count):
    assert len(CLASS_LISTS[name]) == count


def test_lists_of_the_same_classes_agree():
    """NYU40 is the list of Structured3D, in the same order, and ScanNet numbers its 20 classes as NYU40 does."""
    nyu40 = CLASS_LISTS["nyu40"]
    assert list(map(object_label, nyu40)) == list(map(object_label, CLASS_LISTS["structured3d"]))
    scannet = CLASS_LISTS["scannet20"]
    assert {number: object_label(nyu40[number - 1]) for number in scannet} == {
        number: object_label(label) for number, label in scannet.items()
    }


def test_the_names_of_coco_and_of_a_ros_detector_agree():
    from salframe_detectors.zoo import COCO_80

    assert list(map(object_label, CLASS_LISTS["darknet_ros"])) == list(map(object_label, COCO_80))


def test_the_categories_of_matterport_are_those_of_nyu40():
    """Where one category of objects is one class, by the table of Matterport3D, detectors share the label."""
    pairs = {category: classes[0] for category, classes in CLASS_LISTS["mpcat40"].items() if len(classes) == 1}
    objects = {category for category in pairs if is_object(object_label(category)) and category != "appliances"}
    assert len(objects) == 20
    assert {c: common_label(pairs[c]) for c in objects} == {c: common_label(c) for c in objects}


def test_a_list_of_synonyms_has_the_name_of_its_class():
    """The classes of ADE20K, with all their synonyms, have the names that the cards of its networks give them."""
    names = read_yaml(Path(NAMES).parents[2] / "plugins/salframe_segments/cards/names/ade20k.yaml")
    objects = names["objects"] | names["fixed"]
    classes = {label: objects[label.split(",")[0]] for label in CLASS_LISTS["ade20k"] if label.split(",")[0] in objects}
    assert len(classes) > 95
    assert {label for label, name in classes.items() if common_label(label) != common_label(name)} == set()
    assert object_label("Sofa;couch;lounge") == object_label("divan, couch") == "sofa"
    assert object_label("harpsichord, spinet") == "harpsichord, spinet"


def test_labels_without_a_class_are_no_objects():
    assert [is_object(object_label(label)) for label in ("Walls", "other_furniture", "unlabeled")] == [False] * 3
    assert is_object("dining table")
    assert is_object("harpsichord") is None


def test_misspelt_labels_resemble_a_name():
    assert near_names("refrigirator")[0] == "refrigerator"
    assert near_names("tellevision")[0] == "television"
    assert near_names("Kühlschrank") == ()


def test_the_vocabulary_knows_every_label_of_house():
    from salframe_house.furniture import CLASSES

    assert len(CLASSES) > 80
    assert {label for label in CLASSES if common_label(label) not in read_yaml(NAMES)["synonyms"]} == set()


def test_a_note_names_a_few_labels():
    assert unknown_labels_note(["Stuhl"]) == "no object of the map has the label 'Stuhl'"
    note = unknown_labels_note([f"label-{letter}" for letter in "abcdefgh"])
    assert "'label-e' and 3 more" in note
    assert "label-f" not in note
