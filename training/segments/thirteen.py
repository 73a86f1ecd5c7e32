"""The 13 classes of NYU Depth v2 (Couprie et al., Indoor Semantic Segmentation using depth information, ICLR 2013), and
the mapping of detector labels to them."""

from __future__ import annotations

from salframe.graphs.vocabulary import common_label

CLASSES = (
    "unknown",
    "bed",
    "books",
    "ceiling",
    "chair",
    "floor",
    "furniture",
    "objects",
    "picture",
    "sofa",
    "table",
    "tv",
    "wall",
    "window",
)
STRUCTURE = ("wall", "floor", "ceiling")
_NAMES = {
    "bed": ("bed", "cradle"),
    "books": ("book",),
    "ceiling": ("ceiling",),
    "chair": ("chair", "armchair", "office chair", "stool", "bench"),
    "floor": ("floor", "rug"),
    "furniture": (
        *("cabinet", "wardrobe", "chest of drawers", "counter", "shelf", "bookcase", "nightstand", "refrigerator"),
        *("display case", "ottoman", "coat rack"),
    ),
    "picture": ("picture",),
    "sofa": ("sofa",),
    "table": ("table", "desk", "coffee table", "pool table"),
    "tv": ("television",),
    "wall": ("wall", "building", "door", "column"),
    "window": ("window", "curtain"),
}
"""Labels of each class, following the mapping of the 894 labels of NYU Depth v2 to 40 and to 13 classes: doors and
pillars are wall, rugs are floor, blinds and curtains are window. All other labels are `objects`."""
_CLASS_OF = {name: label for label, names in _NAMES.items() for name in names}


def class_of(name: str) -> str:
    """Return the class of the label of an object, or of a part of the building such as a wall."""
    return _CLASS_OF.get(common_label(name), "objects")
