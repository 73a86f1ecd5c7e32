"""Signs with texts in a map: the node nearest to each sign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.graphs.packing import TEXTS, unpack_nodes
from salframe.graphs.texts import text_key
from salframe.localization.map_files import FRAMES, SCENES, MapParts
from salframe.localization.saved_frames import FRAME_COLUMNS
from salframe.topology.topological_map import MapNode


def nearest_to_signs(parts: MapParts, nodes: Sequence[MapNode]) -> dict[str, str]:
    """Return a mapping from each text in a map (normalized by `text_key`) to the id of a node: the node of the
    reference frame that is nearest to the object with this text.

    A map has texts if its detector reads texts. Frames without a node are ignored.
    """
    if not parts.has(SCENES):
        return {}
    packed = parts.read_table(SCENES)
    if not {TEXTS, "nodes"} <= packed.columns.keys():
        return {}
    ids = parts.read_table(FRAMES, FRAME_COLUMNS).columns["id"]
    node_of = {frame: node.id for node in nodes for frame in node.frames}
    nearest: dict[str, tuple[float, str]] = {}
    for row in range(len(packed)):
        node = node_of.get(ids[row].item())
        if node is None or row in packed.columns[TEXTS].absent:
            continue
        range_m = np.linalg.norm(unpack_nodes(packed.columns["nodes"][row])["centroid_m"], axis=1)
        for text, away_m in zip(packed.columns[TEXTS][row].tolist(), range_m.tolist(), strict=True):
            key = text_key(text)
            if key and (key not in nearest or (away_m, node) < nearest[key]):
                nearest[key] = away_m, node
    return {key: node for key, (_, node) in nearest.items()}
