"""The graph matcher: candidates, node alignment, weighted triplets, geometric verification (method.md 3)."""

from __future__ import annotations

import importlib.util
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from salframe.framework.array_files import map_array
from salframe.framework.config import ComponentConfig
from salframe.framework.errors import DataError, RequirementMissing
from salframe.framework.files import reading
from salframe.framework.registry import registry
from salframe.framework.slots import slot
from salframe.graphs.graph import SaliencyGraph, without_range
from salframe.graphs.matcher import GraphMatch, GraphMatcher, RankedGraphs
from salframe.graphs.scene_index import SceneIndex, SceneLookup
from salframe.graphs.table import GraphBatch, GraphNodes, GraphTable, HeldGraphs, MappedGraphs
from salframe_graphs import compilation
from salframe_graphs.alignment import align
from salframe_graphs.bearings import verify_bearings
from salframe_graphs.features import Histograms, node2vec, ring_hop_histograms
from salframe_graphs.verification import ScaleBound, Verified, verify

_CHUNK = 256
"""So many graphs' structural features are computed at once."""
_FEW = 1000
"""Of so many graphs on disk they are all computed when these are opened, of more those of each query's candidates."""
_RARITY, _SCENES = "rarity.npy", "scenes"


@dataclass(frozen=True, eq=False)
class GraphIndex:
    """A map's graphs laid out for matching. scenes: what candidates are looked up in, None where all graphs are; rarity
    (L,), inverse document frequency of each label; structure: the structural features of all nodes, None where those of
    candidates are computed for each query."""

    graphs: GraphTable
    scenes: SceneLookup | None
    rarity: np.ndarray
    structure: Histograms | None


def _ascending(edges_m: tuple[float, ...]) -> tuple[float, ...]:
    if any(low >= high for low, high in pairwise((0.0, *edges_m))):
        raise ValueError("expected edges above 0, each above the one before")
    return edges_m


class TripletMatcher(GraphMatcher):
    """Label-set candidates, one-to-one node alignment, weighted triplets, geometric verification of the survivors."""

    name = "triplet"
    version = "3"

    class Config(ComponentConfig):
        labels: Literal["set", "multiset"] = Field(
            "multiset", description="Jaccard index over which labels are there, or how many of each"
        )
        rarity: bool = Field(
            True,
            description="weigh labels by smooth inverse document frequency over the map, ln((1 + S) / (1 + s)) + 1",
        )
        confidence: bool = Field(True, description="a node counts in the score as much as its detector is sure of it")
        keep: float = Field(
            0.25, ge=0, le=1, description="candidates: Jaccard index at least this share of the best (paper: 0.6)"
        )
        most: int | None = Field(
            100, ge=1, description="candidates at most, the first of the scene index; null: all (as in the paper)"
        )
        scene_index: slot("scene-index", "by-size")  # type: ignore[valid-type]
        height_scale_m: float | None = Field(
            0.2, gt=0, description="difference in height that halves node similarity; null: height ignored"
        )
        size_scale: tuple[float, float] | None = Field(
            (0.8, 0.5),
            description="log ratios of box length and box height that halve node similarity; null: size ignored",
        )
        structure: Literal["rings", "node2vec"] = Field("rings", description="structural feature of a node")
        ring_edges_m: Annotated[tuple[float, ...], AfterValidator(_ascending)] = Field(
            (1.0, 2.0, 4.0), description="outer edges of the distance rings, ascending"
        )
        hops: int = Field(2, ge=0, description="context hops whose labels are counted")
        saliency_weight: float = Field(
            0.0, ge=0, description="weight of the saliency ratio in node similarity (label: 1)"
        )
        structure_weight: float = Field(
            0.3, ge=0, description="weight of the structural feature in node similarity (label: 1)"
        )
        least_similarity: float = Field(0.1, ge=0, le=1, description="node pairs below this similarity are rejected")
        normalise: bool = Field(True, description="divide the triplet score by the query's edge mass (paper: raw sum)")
        similarity_score: float = Field(
            1.0, ge=0, description="weight in the score of the Jaccard index over aligned nodes"
        )
        triplet_score: float = Field(0.0, ge=0, description="weight in the score of the triplets")
        edge_weights: Literal["saliency", "unit"] = Field(
            "saliency", description="what a triplet counts: sqrt(S_a S_b), or 1 (an unweighted graph)"
        )
        geometry_score: float = Field(
            2.0, ge=0, description="weight in the score of the nodes consistent with one pose; 0: no verification"
        )
        tolerance_m: float = Field(
            0.3, gt=0, description="verification: distance at which two nodes cannot be one, at no range"
        )
        tolerance_share: float = Field(
            0.05, ge=0, description="verification: added tolerance, a share of the nodes' ranges"
        )
        largest_scale_error: float = Field(
            0.0,
            ge=0,
            lt=1,
            description="verification: all of a query's ranges may be off by one factor, up to this share, which is "
            "estimated with the pose; 0: they are right, as a sensor's are",
        )
        largest_shift_m: float = Field(
            6.0, gt=0, description="verification: a query this far from a map frame is not matched to it"
        )
        seed: int = Field(0, ge=0, description="seed of node2vec")

    @classmethod
    def check(cls, config: Any) -> None:
        super().check(config)
        if config.structure == "node2vec" and importlib.util.find_spec("gensim") is None:
            raise RequirementMissing("structure node2vec needs gensim, not installed: pip install 'salframe[node2vec]'")

    def index(self, graphs: Sequence[SaliencyGraph]) -> GraphIndex:
        table = graphs if isinstance(graphs, GraphTable) else HeldGraphs(graphs)
        scenes = table.scenes
        if scenes is None and self._looks_up(table):
            scenes = self._new_scene_index()
            scenes.take(table)
        return GraphIndex(table, scenes, self._rarity(table), self._structure_of_all(table))

    def write_index(self, graphs: Sequence[SaliencyGraph], folder: Path) -> None:
        table = graphs if isinstance(graphs, GraphTable) else HeldGraphs(graphs)
        folder.mkdir(parents=True)
        np.save(folder / _RARITY, self._rarity(table))
        if self._looks_up(table):
            self._new_scene_index().build(table, folder / _SCENES)

    def open_index(self, graphs: MappedGraphs, folder: Path) -> GraphIndex:
        with reading(folder / _RARITY, "an array of numpy"):
            rarity = np.array(map_array(folder / _RARITY))
        if rarity.shape != (len(graphs.labels),) or rarity.dtype != np.float64:
            raise DataError(f"{folder / _RARITY} is {rarity.dtype} {rarity.shape}, expected a number for each label")
        scenes = graphs.scenes
        if scenes is None and self._looks_up(graphs):
            scenes = self._new_scene_index()
            scenes.open(folder / _SCENES)
        return GraphIndex(graphs, scenes, rarity, self._structure_of_all(graphs))

    def _looks_up(self, table: GraphTable) -> bool:
        """Whether there are more graphs than candidates."""
        return self.config.most is not None and len(table) > self.config.most

    def _new_scene_index(self) -> SceneIndex:
        made: SceneIndex = registry().build(SceneIndex.role, self.config.scene_index)
        return made

    def _rarity(self, table: GraphTable) -> np.ndarray:
        """(L,) inverse document frequency of each label, or 1."""
        if not self.config.rarity:
            return np.ones(len(table.labels))
        rarity: np.ndarray = np.log((1 + len(table)) / (1 + table.having)) + 1
        return rarity

    def _structure_of_all(self, table: GraphTable) -> Histograms | None:
        """The structural features of all nodes; None where those of candidates are computed for each query."""
        if not self._has_rings or not len(table) or (isinstance(table, MappedGraphs) and len(table) > _FEW):
            return None
        by_size = np.argsort(table.sizes, kind="stable")  # graphs of one size pad one another least
        parts = np.split(by_size, range(_CHUNK, len(table), _CHUNK))
        around = self._around(table)
        joined = Histograms.joined(
            [ring_hop_histograms(table.batch(part), table.adjacency(part), *around) for part in parts]
        )
        return joined.take(np.argsort(table.nodes(by_size)))

    def match(self, query: SaliencyGraph, index: GraphIndex, top_k: int) -> list[GraphMatch]:
        scenes, score, alike, found = self._best(query, index, top_k)
        aligned, matches = align(alike, found.kernel), []
        for scene, value, pairs, pose in zip(scenes.tolist(), score.tolist(), aligned, found.poses(), strict=True):
            known = np.isfinite(pose).all()
            scale = self._scale(query, index.graphs, scene, pairs)
            matches.append(GraphMatch(scene, value, pairs, pose if known else None, scale))
        return matches

    def rank(self, query: SaliencyGraph, index: GraphIndex, top_k: int) -> RankedGraphs:
        scenes, score, _, found = self._best(query, index, top_k)
        return RankedGraphs(scenes, score, found.poses())

    def _best(
        self, query: SaliencyGraph, index: GraphIndex, most: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Verified]:
        """The best of a map's graphs (T,), at most so many, best first, with what `_score` tells of them."""
        known = np.array([index.graphs.vocabulary.get(label, -1) for label in query.labels], int)
        if not (known >= 0).any():
            return np.zeros(0, int), np.zeros(0), np.zeros((0, len(query), 0)), Verified.none((0, len(query), 0))
        # A label that the map lacks is as rare as can be.
        rarity = np.where(
            known >= 0, index.rarity[known], np.log(1 + len(index.graphs)) + 1 if self.config.rarity else 1.0
        )
        weight = self._sureness(query) * rarity
        candidates = self._shortlist(query, index)
        fast = None
        if index.scenes is not None and self._compiles and not query.bearings_only:
            fast = compilation.compiled("salframe_graphs.compiled")
        if fast is None:
            jaccard = self._jaccard(query.labels, known, rarity, index, candidates)
            kept = (jaccard > 0) & (jaccard >= self.config.keep * jaccard.max(initial=0))
            candidates, jaccard = candidates[kept], jaccard[kept]
            best, *found = self._score(query, known, weight, index, candidates, jaccard, most)
        else:
            there = index.graphs.take(candidates)
            asked = self._asked_labels(query.labels, known, rarity)
            jaccard = fast.jaccard(*asked, there.count, there.label, index.rarity, self.config.labels == "set")
            reference = self._sureness(there) * index.rarity[there.label]
            structure = fast.structures(query, known, index, candidates, there, *self._around(index.graphs))
            best, *found = fast.score_candidates(
                query, known, weight, there, reference, structure, jaccard, self.config, most
            )
        return candidates[best], *found

    @property
    def _compiles(self) -> bool:
        """Whether these settings are those that are compiled: rings, heights and sizes, one pose and no triplets."""
        chosen = self.config
        looks = self._has_rings and chosen.height_scale_m is not None and chosen.size_scale is not None
        return looks and chosen.geometry_score > 0 and not (chosen.triplet_score or chosen.largest_scale_error)

    def _score(
        self,
        query: SaliencyGraph,
        known: np.ndarray,
        weight: np.ndarray,
        index: GraphIndex,
        candidates: np.ndarray,
        jaccard: np.ndarray,
        most: int,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Verified]:
        """The best of K candidates (T,), at most so many, best first, positions among them, with their scores (T,), the
        similarity (T, n, m) of nodes that are alike enough, and what was verified."""
        batch = index.graphs.batch(candidates)
        reference = self._sureness(batch) * index.rarity[batch.label] * batch.is_node
        similarity = self._similarity(query, known, index, candidates, batch)
        alike = np.where(similarity >= self.config.least_similarity, similarity, 0)
        score = np.zeros(len(candidates))
        found = Verified.none(alike.shape)
        if self.config.similarity_score:
            score += self.config.similarity_score * self._shared(similarity, weight, reference)
        if self.config.geometry_score:
            found = self._verify(query, weight, batch, alike)
            score += self.config.geometry_score * self._shared(found.kernel, weight, reference)
        if self.config.triplet_score:
            pairs = align(alike, found.kernel)
            triplets = [self._triplets(query, index.graphs[s], p) for s, p in zip(candidates, pairs, strict=True)]
            score += self.config.triplet_score * np.array(triplets)
        best = np.lexsort((-jaccard, -score))[:most]
        return best, score[best], alike[best], found.take(best)

    def _sureness(self, graphs: SaliencyGraph | GraphNodes | GraphBatch) -> np.ndarray:
        """What each node counts before its label's rarity: its detector's score, or 1."""
        return graphs.scores if self.config.confidence else np.ones(graphs.scores.shape)

    @property
    def _has_rings(self) -> bool:
        """Whether nodes have structural features of their own; node2vec's are trained with the query."""
        return self.config.structure == "rings" and self.config.structure_weight > 0

    def _around(self, graphs: GraphTable) -> tuple[int, Sequence[float], int]:
        """What histograms around nodes are told of a table's labels and of the settings."""
        return len(graphs.labels), self.config.ring_edges_m, self.config.hops

    def _structures(
        self, query: SaliencyGraph, known: np.ndarray, index: GraphIndex, candidates: np.ndarray, batch: GraphBatch
    ) -> tuple[Histograms, Histograms, np.ndarray]:
        """Structural features of the query's nodes, those of nodes of the map, and the row in these of each of the
        candidates' nodes, one after the other."""
        columns = (getattr(query, name)[None] for name in ("scores", "saliency", "centroid_m", "size_m"))
        asked = GraphBatch(np.array([len(query)]), known[None], *columns)
        around = self._around(index.graphs)
        own = ring_hop_histograms(asked, query.adjacency[None], *around)
        if index.structure is not None:
            return own, index.structure, index.graphs.nodes(candidates)
        there = ring_hop_histograms(batch, index.graphs.adjacency(candidates), *around)
        return own, there, np.arange(batch.count.sum())

    def _shortlist(self, query: SaliencyGraph, index: GraphIndex) -> np.ndarray:
        """(K,) scenes worth matching, in the order of the map."""
        if index.scenes is None:
            return np.arange(len(index.graphs))
        # Heights and sizes are off by the factor that ranges are off by.
        known = without_range(query) if self.config.largest_scale_error and not query.bearings_only else query
        return np.sort(index.scenes.candidates(known, self.config.most).scene)

    def _asked_labels(
        self, labels: Sequence[str], known: np.ndarray, rarity: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the J labels that a query's nodes bear: number or -1, how many bear it, and rarity, (J,) each."""
        number = Counter(labels)
        first, count = np.array([(labels.index(label), number[label]) for label in sorted(number)]).T
        return known[first], np.ones(len(count), int) if self.config.labels == "set" else count, rarity[first]

    def _jaccard(
        self, labels: Sequence[str], known: np.ndarray, rarity: np.ndarray, index: GraphIndex, candidates: np.ndarray
    ) -> np.ndarray:
        """(K,) Jaccard index of the query's labels with each candidate's, weighed by rarity."""
        asked, count, weight = self._asked_labels(labels, known, rarity)
        shape = len(candidates), len(index.rarity)
        of_graph = np.repeat(np.arange(shape[0]), index.graphs.sizes[candidates])
        cell = of_graph * shape[1] + index.graphs.take_labels(candidates)
        counts = np.bincount(cell, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float64)
        if self.config.labels == "set":
            counts = np.minimum(counts, 1)
        shared = np.minimum(counts[:, asked[asked >= 0]], count[asked >= 0]) @ weight[asked >= 0]
        union = counts @ index.rarity + weight @ count - shared
        return np.divide(shared, union, out=np.zeros(len(shared)), where=union > 0)

    def _similarity(
        self, query: SaliencyGraph, known: np.ndarray, index: GraphIndex, candidates: np.ndarray, batch: GraphBatch
    ) -> np.ndarray:
        """(K, n, m) node similarity in [0, 1] of height, size, saliency ratio and structure, 0 where labels differ; of
        a query without range labels are all that can be compared."""
        same = (known[None, :, None] == batch.label[:, None]) & (known >= 0)[None, :, None]
        if query.bearings_only:
            return same.astype(np.float64)
        structure = np.zeros(same.shape)
        if self._has_rings:
            structure = self._rings(query, known, index, candidates, batch)
        elif self.config.structure_weight:
            vectors = node2vec([query, *(index.graphs[s] for s in candidates)], self.config.seed)
            for number, block in enumerate(vectors[1:]):
                structure[number, :, : len(block)] = np.maximum(vectors[0] @ block.T, 0)
        whole = 1 + self.config.saliency_weight + self.config.structure_weight
        k, i, j = np.nonzero(same)
        a, b = query.saliency[i], batch.saliency[k, j]
        ratio = np.minimum(a, b) / np.maximum(np.maximum(a, b), 1e-12)
        value = (1 + self.config.saliency_weight * ratio + self.config.structure_weight * structure[same]) / whole
        if self.config.height_scale_m is not None:
            own = query.centroid_m[i, 2]
            height = own - batch.centroid_m[k, j, 2]
            if self.config.largest_scale_error:  # what a factor within the bound makes of it at best
                height = np.maximum(np.abs(height) - self.config.largest_scale_error * np.abs(own), 0)
            value /= 1 + (height / self.config.height_scale_m) ** 2
        if self.config.size_scale is not None:
            for side, scale in zip((0, 2), self.config.size_scale, strict=True):
                change = np.log(query.size_m[i, side] / batch.size_m[k, j, side])
                value /= 1 + (change / scale) ** 2
        similarity = np.zeros(same.shape)
        similarity[same] = value
        return similarity

    def _rings(
        self, query: SaliencyGraph, known: np.ndarray, index: GraphIndex, candidates: np.ndarray, batch: GraphBatch
    ) -> np.ndarray:
        """(K, n, m) products of the query's structural features with each candidate's."""
        own, there, rows = self._structures(query, known, index, candidates, batch)
        used = np.unique(own.column)
        padded = np.zeros((*batch.label.shape, len(used)))
        padded[batch.is_node] = there.take(rows).unit(used)
        return own.unit(used) @ np.swapaxes(padded, 1, 2)

    def _shared(self, similarity: np.ndarray, weight: np.ndarray, reference: np.ndarray) -> np.ndarray:
        """(K,) Jaccard index over nodes of weight (n,) and reference (K, m), each shared by its similarity to the most
        similar node of the other graph."""
        shared = np.minimum(similarity.max(2) @ weight, (similarity.max(1) * reference).sum(1))
        whole = weight.sum() + reference.sum(1) - shared
        return np.divide(shared, whole, out=np.zeros(len(shared)), where=whole > 0)

    def _verify(self, query: SaliencyGraph, weight: np.ndarray, batch: GraphBatch, similarity: np.ndarray) -> Verified:
        reference = batch.centroid_m
        if query.bearings_only:
            tolerance = self.config.tolerance_m, self.config.tolerance_share
            return verify_bearings(query.bearing, reference, similarity, weight, tolerance, self.config.largest_shift_m)
        ranges = np.hypot(query.range_m[None, :, None], np.linalg.norm(reference, axis=2)[:, None])
        tolerance_m = self.config.tolerance_m + self.config.tolerance_share * ranges
        return verify(
            query.centroid_m[:, :2],
            reference[..., :2],
            similarity,
            tolerance_m,
            weight,
            self.config.largest_shift_m,
            self._scale_bound(query, reference),
        )

    def _scale_bound(self, query: SaliencyGraph, reference: np.ndarray) -> ScaleBound | None:
        """What is taken to be known of the scale of the query's ranges, against map nodes (K, m, 3)."""
        if not self.config.largest_scale_error or query.bearings_only:
            return None
        bound, height_scale_m = self.config.largest_scale_error, self.config.height_scale_m
        return ScaleBound(bound, query.centroid_m[:, 2], reference[..., 2], height_scale_m)

    def _scale(self, query: SaliencyGraph, graphs: GraphTable, scene: int, pairs: np.ndarray) -> float:
        """The factor that gives the query's aligned nodes the spread of a scene's, within the bound."""
        if not self.config.largest_scale_error:
            return 1.0
        reference_m = graphs[scene].centroid_m
        bound = self._scale_bound(query, reference_m[None])
        if bound is None or len(pairs) < 2:
            return 1.0
        nodes = query.centroid_m[pairs[:, 0], :2], reference_m[pairs[:, 1], :2]
        own, there = (float(np.linalg.norm(np.std(some, axis=0))) for some in nodes)
        return float(bound.clip(there / max(own, 1e-9)))

    def _triplets(self, query: SaliencyGraph, reference: SaliencyGraph, pairs: np.ndarray) -> float:
        """I = sum(W o M) over edges present in both graphs between aligned nodes; without edges in the query, the
        aligned saliency."""
        if not len(query.edges):
            return float(query.saliency[pairs[:, 0]].sum())
        a, b = np.triu_indices(len(pairs), 1)
        both = query.adjacency[pairs[a, 0], pairs[b, 0]] & reference.adjacency[pairs[a, 1], pairs[b, 1]]
        if self.config.edge_weights == "unit":
            return float(both.sum()) / (len(query.edges) if self.config.normalise else 1.0)
        weight = np.sqrt(query.saliency[pairs[a, 0]] * query.saliency[pairs[b, 0]])
        return float(weight[both].sum()) / (float(query.weights.sum()) if self.config.normalise else 1.0)
