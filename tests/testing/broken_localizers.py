"""Localizers that each break one rule, and the message of the conformance suite about each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_objects.localizer import ObjectSetLocalizer

from salframe.framework.component import match_only
from salframe.framework.components.identity import UserFile, identity
from salframe.panoramas.geometry import pose_2d


class Mixed(SaliencyGraphLocalizer):
    """Broken."""

    def open_index(self, folder, packed, frames):
        self.index([self.unpack(row) for row in packed[::-1]], frames)


class North(SaliencyGraphLocalizer):
    """Broken."""

    def match(self, description):
        answer = super().match(description)
        return (
            answer
            if answer.T_world_query is None
            else replace(answer, T_world_query=pose_2d(*answer.T_world_query[:2, 3], 0.0))
        )


class Scolding(SaliencyGraphLocalizer):
    """Broken."""

    def match(self, description):
        if not len(description["labels"]):
            raise ValueError("no objects")
        return super().match(description)


class Modest(SaliencyGraphLocalizer):
    """Broken."""

    needs = frozenset({"rgb"})


class Boastful(SaliencyGraphLocalizer):
    """Broken."""

    def match(self, description):
        return replace(super().match(description), status="ok")


class Loyal(SaliencyGraphLocalizer):
    """Broken."""

    def match(self, description):
        answer, first = super().match(description), min(self._matching.frames, key=lambda frame: frame.id).place
        places = sorted(answer.places, key=lambda ranked: ranked.place != first)
        best = answer.places[0].score if answer.places else 0.0
        return replace(answer, places=tuple(ranked._replace(score=best) for ranked in places))


class Rooted(SaliencyGraphLocalizer):
    """Broken."""

    def match(self, description):
        answer = super().match(description)
        if answer.T_world_query is None:
            return answer
        pose = answer.T_world_query.copy()
        pose[:2, 3] = np.round(pose[:2, 3])
        return replace(answer, T_world_query=pose)


class Fickle(SaliencyGraphLocalizer):
    """Broken."""

    class Config(SaliencyGraphLocalizer.Config):
        facing: bool = match_only(False)

    def match(self, description):
        answer = super().match(description)
        if answer.T_world_query is None or not self.config.facing:
            return answer
        return replace(answer, T_world_query=pose_2d(*answer.T_world_query[:2, 3], 0.0))


class Remembering(SaliencyGraphLocalizer):
    """Broken."""

    first = None

    def match(self, description):
        if self.first is None:
            self.first = len(description["labels"]) + description["saliency"].max(initial=0)
        answer = super().match(description)
        places = tuple(place._replace(score=place.score + self.first) for place in answer.places)
        return replace(answer, places=places)


class Unordered(SaliencyGraphLocalizer):
    """Broken."""

    def match(self, description):
        answer = super().match(description)
        return replace(answer, places=answer.places + answer.places)


def weighed(answer, probabilities):
    """Return the answer with these probabilities of its first places, 0 for the others, and 0.1 for out-of-map."""
    padded = [*probabilities, *[0.0] * len(answer.places)]
    places = [place._replace(probability=padded[i]) for i, place in enumerate(answer.places)]
    return replace(answer, places=tuple(places), out_of_map_probability=0.1) if len(places) > 1 else answer


class Lavish(ObjectSetLocalizer):
    """Broken."""

    def match(self, description):
        return weighed(super().match(description), [0.7, 0.4])


class Contrary(ObjectSetLocalizer):
    """Broken."""

    def match(self, description):
        return weighed(super().match(description), [0.2, 0.7])


class Swayed(SaliencyGraphLocalizer):
    """Broken."""

    class Config(SaliencyGraphLocalizer.Config):
        lossy: bool = match_only(False)

    def graph(self, detections):
        graph = super().graph(detections)
        return replace(graph, saliency=graph.saliency / 2) if self.config.lossy else graph


class Scrupulous(SaliencyGraphLocalizer):
    """Broken."""

    def describe_identity(self):
        return identity(self.config)


class Inattentive(SaliencyGraphLocalizer):
    """Broken."""

    class Config(SaliencyGraphLocalizer.Config):
        table: UserFile | None = None

    def describe_identity(self):
        return {"name": self.name}


BROKEN_LOCALIZERS = [
    (Loyal, "with permuted and renamed frames: received the best place"),
    (Rooted, "with a moved world: received a pose that is"),
    (Fickle, r"random rooms of seed \d with the random settings .*facing=true"),
    (Remembering, "with another worker: received the places"),
    (Mixed, "with a map that was saved and opened: received"),
    (North, "received a pose that moved .* rad off the rotation"),
    (Scolding, "received ValueError: no objects"),
    (Modest, "describe of a panorama with rgb alone: received InputMissing"),
    (Boastful, "match of a blank panorama: received InvalidAnswer: a localization has the status ok and no place"),
    (Unordered, "expected one entry per place"),
    (Lavish, "received InvalidAnswer: a localization has probabilities that sum to 1.2, expected 1"),
    (Contrary, r"received the probabilities \[0.2, 0.7.*\], expected descending probabilities"),
    (Swayed, "with another lossy: received another description, expected the same description: .* match_only"),
    (Scrupulous, "with another top_k: received another value, expected the same value: .* match_only"),
    (
        Inattentive,
        "describe_identity with another content of the file table: received the same value, expected another",
    ),
]
