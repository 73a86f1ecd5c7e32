"""Data sets that each break one rule, and the message of the conformance suite about each."""

from __future__ import annotations

from dataclasses import replace

from salframe.panoramas.folder import FolderDataset
from salframe.panoramas.frames import Fold


class Leaky(FolderDataset):
    """Broken."""

    def folds(self):
        (fold,) = super().folds()
        return [replace(fold, queries=fold.references)]


class Questionless(FolderDataset):
    """Broken."""

    def folds(self):
        (fold,) = super().folds()
        return [Fold(fold.id, fold.references, ())]


class Ambiguous(FolderDataset):
    """Broken."""

    def folds(self):
        (fold,) = super().folds()
        return [replace(fold, queries=fold.queries + fold.queries[:1])]


class Truthless(FolderDataset):
    """Broken."""

    def truth(self, query_id):
        raise KeyError(query_id)


class Agreeable(FolderDataset):
    """Broken."""

    def truth(self, query_id):
        return super().truth("bedroom-query")


class Promising(FolderDataset):
    """Broken."""

    def folds(self):
        (fold,) = super().folds()
        return [
            replace(
                fold,
                references=tuple(replace(f, load=lambda f=f: replace(f.load(), rgb=None)) for f in fold.references),
            )
        ]


class Anonymous(FolderDataset):
    """Broken."""

    def folds(self):
        (fold,) = super().folds()
        return [
            replace(
                fold,
                references=tuple(replace(f, load=lambda f=f: replace(f.load(), id="frame")) for f in fold.references),
            )
        ]


class Changing(FolderDataset):
    """Broken."""

    @property
    def fingerprint(self):
        return str(id(self))


class Late(FolderDataset):
    """Broken."""

    prepared = False

    def prepare(self, progress):
        self.prepared = True

    @property
    def provides(self):
        return super().provides if self.prepared else frozenset({"rgb"})


BROKEN_DATASETS = [
    (Leaky, "the repeated frame ids bedroom-map"),
    (Questionless, "received 3 reference frames and 0 queries, expected at least one of each"),
    (Ambiguous, "received the repeated frame ids bedroom-query"),
    (Truthless, "truth of bedroom-query: received KeyError"),
    (Agreeable, "truth of an unknown query: received an answer, expected DataError"),
    (Promising, r"load of bedroom-map: received {.*}, expected all parts that the dataset provides"),
    (Anonymous, "received a panorama with id 'frame', expected id 'bedroom-map'"),
    (Late, r"provides after prepare: received {.*}, expected {'rgb'} as before prepare"),
    (Changing, "fingerprint of another instance: received"),
]
