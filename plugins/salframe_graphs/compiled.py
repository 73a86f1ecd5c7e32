"""How much candidates resemble a query, compiled by numba: the same scores of `TripletMatcher` but for rounding."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.table import GraphNodes
from salframe_graphs.compiled_features import structures
from salframe_graphs.features import Histograms
from salframe_graphs.verification import BASE_WORTH, LEAST_BASE_M, LONGEST_BASE_M, MOST_HYPOTHESES, Verified

__all__ = ["first_of", "jaccard", "score_candidates", "structures"]

_NODE = np.dtype(
    [("label", "i8"), *((name, "f8") for name in ("weight", "saliency", "x", "y", "z", "length", "height", "range"))]
)
_PAIR = np.dtype(
    [
        *((name, "i8") for name in ("i", "j")),
        *((name, "f8") for name in ("x", "y", "similarity", "tolerance_m")),
        *((name, "f4") for name in ("sharpness", "kernel")),
    ]
)
_compile = numba.njit(nogil=True, error_model="numpy")
_compile_and_keep = numba.njit(cache=True, nogil=True, error_model="numpy")


class _Numbers(NamedTuple):
    """What similarity and verification take from settings and from constants of other modules: what is kept compiled
    does not see those change."""

    length_scale: float
    box_height_scale: float
    height_scale_m: float
    keep: float
    saliency_weight: float
    structure_weight: float
    least_similarity: float
    similarity_score: float
    geometry_score: float
    tolerance_m: float
    tolerance_share: float
    largest_shift_m: float
    least_base_m: float = LEAST_BASE_M
    longest_base_m: float = LONGEST_BASE_M
    base_worth: float = BASE_WORTH
    most_hypotheses: int = MOST_HYPOTHESES


_OF_SETTINGS = _Numbers._fields[_Numbers._fields.index("height_scale_m") : _Numbers._fields.index("least_base_m")]
"""Those that bear a setting's name."""


@_compile_and_keep
def jaccard(asked, count, weight, sizes, label, rarity, once):  # type: ignore[no-untyped-def]
    """As `_jaccard` of a `TripletMatcher`, of graphs of sizes (K,) with their nodes' labels (N,), graph by graph;
    asked, count, weight (J,) as of its `_asked_labels`."""
    index, first, own = np.zeros(len(sizes)), 0, (weight * count).sum()
    wanted, left = np.zeros(len(rarity), np.int64), np.zeros(len(rarity), np.int64)
    seen = np.zeros(len(rarity), np.bool_)
    for j in range(len(asked)):
        if asked[j] >= 0:
            wanted[asked[j]] = count[j]
    for k in range(len(sizes)):
        shared, there = 0.0, 0.0
        left[:], seen[:] = wanted, False
        for one in label[first : first + sizes[k]]:
            if once and seen[one]:
                continue
            there, seen[one] = there + rarity[one], True
            if left[one] > 0:
                shared, left[one] = shared + rarity[one], left[one] - 1
        union, first = there + own - shared, first + sizes[k]
        index[k] = shared / union if union > 0 else 0.0
    return index


def score_candidates(
    query: SaliencyGraph,
    known: np.ndarray,
    weight: np.ndarray,
    there: GraphNodes,
    reference: np.ndarray,
    structure: tuple[Histograms, Histograms, np.ndarray],
    jaccard: np.ndarray,
    config: Any,
    most: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Verified]:
    """The best of K graphs (T,), at most so many, best first, positions among them, with their scores (T,) under the
    settings of a `TripletMatcher`, the similarity (T, n, m) of nodes that are alike enough, and what was verified.

    known, weight (n,) of the query's nodes, known a label's number or -1; reference (N,), the weight of the graphs'
    nodes; structure: structural features of the query's nodes, those of many nodes, and the row in them of each of the
    graphs' (N,); jaccard (K,), which graphs are matched, and which of two of one score comes first.
    """
    own, histograms, rows = structure
    best, score, alike, yaw_rad, shift_m, kernel = _score_candidates(
        (known, weight, query.saliency, query.range_m, query.centroid_m, query.size_m),
        (own.start, own.column, own.count, own.norm, own.width),
        there.count,
        (there.label, reference, there.saliency, there.centroid_m, there.size_m),
        (histograms.start, histograms.column, histograms.count, histograms.norm, rows),
        jaccard,
        _Numbers(*config.size_scale, *(getattr(config, name) for name in _OF_SETTINGS)),
        most,
    )
    return best, score, alike, Verified(yaw_rad, shift_m, kernel)


@_compile
def first_of(value, most):  # type: ignore[no-untyped-def]
    """(N,) whether each of the values is among the `most` largest, ties in order."""
    first = np.empty(len(value), np.bool_)
    for a in range(len(value)):
        before = 0
        if len(value) > most:
            for b in range(len(value)):
                before += value[b] > value[a] or (value[b] == value[a] and b < a)
        first[a] = before < most
    return first


@_compile_and_keep
def _score_candidates(query, own, count, there, histograms, jaccard, numbers, most):  # type: ignore[no-untyped-def]
    """Candidates are verified in the order of what geometry can bring them at best, until none of the rest can be among
    the first."""
    query, own = _nodes(*query), _unit(*own)
    candidates, n, nodes = len(count), len(query), count.sum()
    alike, kernel = np.zeros((n, nodes)), np.zeros((n, nodes))
    start, bound = np.zeros(candidates + 1, np.int64), np.empty(candidates)
    score, pose = np.full(candidates, -np.inf), np.full((candidates, 3), np.nan)
    least = numbers.keep * jaccard.max() if candidates else 0.0
    for k in range(candidates):
        start[k + 1], bound[k] = start[k] + count[k], -np.inf
        if jaccard[k] <= 0 or jaccard[k] < least:
            continue
        part = slice(start[k], start[k + 1])
        _compare(query, part, there, own, histograms, numbers, alike[:, part])
        score[k] = numbers.similarity_score * _shared(query, there[1][part], alike[:, part])
        for i in range(n):
            for j in range(start[k], start[k + 1]):
                if alike[i, j] < numbers.least_similarity:
                    alike[i, j] = 0
        bound[k] = score[k] + numbers.geometry_score * _shared(query, there[1][part], alike[:, part])
    best, held = np.empty(min(most, candidates), np.int64), 0
    for _ in range(candidates):
        k = np.argmax(bound)
        if bound[k] == -np.inf or (held == len(best) and bound[k] < score[best[-1]] - 1e-9):
            break
        bound[k] = -np.inf
        part = slice(start[k], start[k + 1])
        _verify(query, there[3][part], alike[:, part], numbers, kernel[:, part], pose[k])
        score[k] += numbers.geometry_score * _shared(query, there[1][part], kernel[:, part])
        row = held
        while row > 0 and _is_before(k, best[row - 1], score, jaccard):
            row -= 1
        held = min(held + 1, len(best))
        for later in range(held - 1, row, -1):
            best[later] = best[later - 1]
        if row < held:
            best[row] = k
    best = best[:held]
    width = count[best].max() if held else 0
    alike_there, explained = np.zeros((held, n, width)), np.zeros((held, n, width))
    for row in range(held):
        k = best[row]
        alike_there[row, :, : count[k]] = alike[:, start[k] : start[k + 1]]
        explained[row, :, : count[k]] = kernel[:, start[k] : start[k + 1]]
    return best, score[best], alike_there, pose[best, 2], pose[best, :2], explained


@_compile
def _nodes(label, weight, saliency, range_m, centroid_m, size_m):  # type: ignore[no-untyped-def]
    """(n,) of _NODE."""
    nodes = np.empty(len(label), _NODE)
    for i in range(len(label)):
        node = nodes[i]
        node.label, node.weight, node.saliency, node.range = label[i], weight[i], saliency[i], range_m[i]
        node.x, node.y, node.z = centroid_m[i]
        node.length, node.height = size_m[i, 0], size_m[i, 2]
    return nodes


@_compile
def _unit(start, column, count, norm, width):  # type: ignore[no-untyped-def]
    """(n, width) rows at length 1."""
    rows = np.zeros((len(norm), width))
    for i in range(len(norm)):
        for e in range(start[i], start[i + 1]):
            rows[i, column[e]] = count[e] / max(norm[i], 1e-12)
    return rows


@_compile
def _is_before(k, other, score, jaccard):  # type: ignore[no-untyped-def]
    """Whether a candidate is ranked before another: by score, Jaccard index and number."""
    if score[k] != score[other]:
        return score[k] > score[other]
    return jaccard[k] > jaccard[other] or (jaccard[k] == jaccard[other] and k < other)


@_compile
def _compare(query, part, there, own, histograms, numbers, similarity):  # type: ignore[no-untyped-def]
    """Fill in the similarity (n, m) of the query's nodes to a part of the others where their labels are the same."""
    label, saliency, centroid_m, size_m = there[0][part], there[2][part], there[3][part], there[4][part]
    (start, column, number, norm), rows = histograms[:4], histograms[4][part]
    whole = 1 + numbers.saliency_weight + numbers.structure_weight
    for i in range(len(query)):
        a = query[i]
        for j in range(len(label)):
            if a.label < 0 or a.label != label[j]:
                continue
            value = 1.0
            if numbers.saliency_weight > 0:
                low, high = min(a.saliency, saliency[j]), max(a.saliency, saliency[j])
                value += numbers.saliency_weight * low / max(high, 1e-12)
            if numbers.structure_weight > 0:
                structure, node = 0.0, rows[j]
                for e in range(start[node], start[node + 1]):
                    structure += own[i, column[e]] * number[e]
                value += numbers.structure_weight * structure / max(norm[node], 1e-12)
            value /= whole
            value /= 1 + ((a.z - centroid_m[j, 2]) / numbers.height_scale_m) ** 2
            value /= 1 + (np.log(a.length / size_m[j, 0]) / numbers.length_scale) ** 2
            value /= 1 + (np.log(a.height / size_m[j, 2]) / numbers.box_height_scale) ** 2
            similarity[i, j] = value


@_compile
def _shared(query, reference, similarity):  # type: ignore[no-untyped-def]
    """Jaccard index over nodes, each shared by its similarity to the most similar node of the other graph."""
    here, there, whole = 0.0, 0.0, 0.0
    for i in range(len(query)):
        most = 0.0
        for j in range(len(reference)):
            most = max(most, similarity[i, j])
        here += most * query[i].weight
        whole += query[i].weight
    for j in range(len(reference)):
        most = 0.0
        for i in range(len(query)):
            most = max(most, similarity[i, j])
        there += most * reference[j]
        whole += reference[j]
    shared = min(here, there)
    return shared / (whole - shared) if whole > shared else 0.0


@_compile
def _verify(query, map_m, similarity, numbers, kernel, pose):  # type: ignore[no-untyped-def]
    """Fill in the pose (3,), x, y and yaw, that explains most, and what it explains (n, m), if there is one."""
    n, m = similarity.shape
    pairs, count, rest = np.empty(n * m, _PAIR), 0, np.zeros(n + 1)
    for i in range(n):
        for j in range(m):
            if similarity[i, j] > 0:
                x, y, z = map_m[j]
                range_m = np.hypot(query[i].range, np.sqrt(x * x + y * y + z * z))
                pair = pairs[count]
                pair.i, pair.j, pair.similarity = i, j, similarity[i, j]
                pair.x, pair.y = x, y
                pair.tolerance_m = numbers.tolerance_m + numbers.tolerance_share * range_m
                pair.sharpness = 1 / (pair.tolerance_m * pair.tolerance_m)
                count += 1
    pairs = pairs[:count]
    for i in range(n - 1, -1, -1):
        most = 0.0
        for j in range(m):
            most = max(most, similarity[i, j])
        rest[i] = rest[i + 1] + query[i].weight * most
    poses, rank = _two_point(query, pairs, numbers)
    best, most = -1, -1.0
    for h in range(len(poses)):
        support = _explain(query, pairs, poses[h], rest, most)
        if support > most or (support == most and rank[h] > rank[best]):
            best, most = h, support
    if best < 0:
        return
    for axis in range(3):
        pose[axis] = poses[best, axis]
    _explain(query, pairs, pose, rest, -np.inf)
    for p in range(count):
        kernel[pairs[p].i, pairs[p].j] = pairs[p].kernel


@_compile
def _two_point(query, pairs, numbers):  # type: ignore[no-untyped-def]
    """Poses (H, 3), x, y and yaw, under which the middle of two nodes and the direction between them are those of two
    of the map that are alike; and what the two pairs are worth (H,)."""
    bases, count = len(pairs) * (len(pairs) - 1) // 2, 0
    pose, rank = np.empty((bases, 3)), np.empty(bases)
    for p in range(len(pairs)):
        for q in range(p + 1, len(pairs)):
            a, b = pairs[p], pairs[q]
            if a.i == b.i or a.j == b.j:
                continue
            here, further = query[a.i], query[b.i]
            x, y = further.x - here.x, further.y - here.y
            x_there, y_there = b.x - a.x, b.y - a.y
            length, length_there = np.sqrt(x * x + y * y), np.sqrt(x_there * x_there + y_there * y_there)
            too_far = abs(length - length_there) >= a.tolerance_m + b.tolerance_m
            if too_far or min(length, length_there) <= numbers.least_base_m:
                continue
            both = length * length_there
            c, s = (x * x_there + y * y_there) / both, (x * y_there - y * x_there) / both
            yaw = np.arctan2(s, c)
            x, y = (here.x + further.x) / 2, (here.y + further.y) / 2
            pose[count, 0] = (a.x + b.x) / 2 - (c * x - s * y)
            pose[count, 1] = (a.y + b.y) / 2 - (s * x + c * y)
            pose[count, 2] = yaw
            rank[count] = a.similarity + b.similarity + numbers.base_worth * min(length, numbers.longest_base_m)
            count += 1
    first, kept = first_of(rank[:count], numbers.most_hypotheses), 0
    for h in range(count):
        if first[h] and np.hypot(pose[h, 0], pose[h, 1]) < numbers.largest_shift_m:
            rank[kept] = rank[h]
            for axis in range(3):
                pose[kept, axis] = pose[h, axis]
            kept += 1
    return pose[:kept], rank[:kept]


@_compile
def _explain(query, pairs, pose, rest, least):  # type: ignore[no-untyped-def]
    """How much a pose explains, -1 where it is less than `least`; fill in the kernel of pairs, in single precision.
    rest (n + 1,): what the query's nodes from each on are worth at best."""
    c, s, support, most = np.cos(pose[2]), np.sin(pose[2]), 0.0, np.float32(0)
    x_here, y_here = np.float32(0), np.float32(0)
    for p in range(len(pairs)):
        pair = pairs[p]
        if p == 0 or pair.i != pairs[p - 1].i:
            node, most = query[pair.i], np.float32(0)
            x_here = np.float32(node.x * c - node.y * s + pose[0])
            y_here = np.float32(node.x * s + node.y * c + pose[1])
        x, y = x_here - np.float32(pair.x), y_here - np.float32(pair.y)
        kernel = max(np.float32(1) - (x * x + y * y) * pair.sharpness, np.float32(0)) * np.float32(pair.similarity)
        pair.kernel = kernel
        most = max(most, kernel)
        if p + 1 == len(pairs) or pairs[p + 1].i != pair.i:
            support += most * query[pair.i].weight
            if support + rest[pair.i + 1] < least - 1e-9:
                return -1.0
    return support
