"""What a command answered, whether another answer differs from it, and whether a damaged file could be a sound one."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow.parquet as pq
import yaml

MAX_SHIFT_M = 0.25
MAX_NUMBER = 1e12
_RECORDS = ("viewpoints/episodes.json", "experiment.yaml", "answers.json", "REVERIE_val.json", "BBox/*.json")
"""Files of records, of which there may be any number: without one, or with one twice, they are sound."""
_FIGURES = (
    *("method", "queries", "pairs", "panoramas", "accuracy", "precision", "recall", "overall"),
    *("episodes", "success_rate", "oracle_success_rate", "spl", "collisions", "scores"),
    *("SR", "OSR", "SPL", "RGS", "RGSPL"),
    *("folds", "reference_frames", "mapped_places", "queried_places"),
    *("objects", "detected"),
)


class CommandOutput(NamedTuple):
    """What a command printed: its JSON or text without times, and its lines on stderr."""

    out: Any
    err: str


def has_other_answer(sound: CommandOutput, output: CommandOutput) -> bool:
    """Whether it answers another place or figure, or a position or length over 0.25 m away."""
    before, after = _answers(sound.out), _answers(output.out)
    if [place for place, _ in before] != [place for place, _ in after]:
        return True
    pairs = [(one, other) for (_, one), (_, other) in zip(before, after, strict=True)]
    return any(len(one) != len(other) or math.dist(one, other) > MAX_SHIFT_M for one, other in pairs)


def has_new_remark(sound: CommandOutput, output: CommandOutput) -> bool:
    """Whether a line on stderr, a note, a status or a reason tells what the sound input's answer does not tell."""
    return bool(_remarks(output) - _remarks(sound))


def is_plausible(sound: Path, damaged: Path) -> bool:
    """Whether the damage left syntax, types, names, numbers of values, and the bounds of every number as they were,
    so that the file could be a sound one of other content."""
    try:
        before, after = _structure(sound), damaged.is_file() and _structure(damaged)
        if isinstance(before, frozenset):
            return bool(after) and after <= before
        return before == after
    except Exception:  # whatever a library raises: it cannot be read
        return False


def _answers(out: Any) -> list[tuple[Any, tuple[float, ...]]]:
    """Places or figures, each with a position in m where there is one."""
    if isinstance(out, list):
        return [answer for part in out for answer in _answers(part)]
    if not isinstance(out, dict):
        return []
    if "rows" in out:
        return _answers(out["rows"])
    if "tables" in out:
        return _answers(list(out["tables"].values()))
    if "sensor" in out:
        return _answers(out["sensor"]["provenance"])
    if "places" in out:
        best, pose = [place["place"] for place in out["places"][:1]], out["pose"]
        return [(best, (pose["x_m"], pose["y_m"]) if pose else ()), *_answers(out.get("route"))]
    if "nodes" in out:
        return [(out["nodes"], (out["length_m"],))]
    if "images" in out:
        return [([detection["label"] for detection in image["objects"]], ()) for image in out["images"]]
    lengths_m = tuple(out[name] for name in ("median_translation_m", "path_m") if out.get(name) is not None)
    figures = [out[name] for name in _FIGURES if name in out]
    return [(figures, lengths_m)] if figures else []


def _remarks(output: CommandOutput) -> set[str]:
    remarks = set(output.err.splitlines())
    if isinstance(output.out, dict):
        remarks |= {f"{output.out['queries_without_truth']} without truth"} if "folds" in output.out else set()
        remarks |= set(output.out.get("notes", ()))
        for part in (output.out, *output.out.get("rows", ())):
            status = part.get("status", ())
            remarks |= {status} if isinstance(status, str) else set(status)
            remarks |= {part["reason"]} if part.get("reason") else set()
    return remarks


def _structure(path: Path) -> Any:
    if path.suffix in (".json", ".yaml"):
        content = yaml.safe_load(path.read_text()) if path.suffix == ".yaml" else json.loads(path.read_text())
        records = any(map(path.match, _RECORDS))
        return (
            frozenset(_shape(content, records)) if records and isinstance(content, list) else _shape(content, records)
        )
    if path.suffix == ".jsonl":
        return [_shape(json.loads(line)) for line in path.read_text().splitlines()]
    if path.suffix == ".npy":
        return _array(np.load(path))
    if path.suffix == ".npz":
        return {name: _array(array) for name, array in np.load(path).items()}
    if path.suffix == ".parquet":
        table = pq.read_table(path)
        counts = [(len(set(column)), column.null_count) for column in table.columns]
        return table.schema.names, table.schema.types, len(table), counts
    if path.suffix in (".csv", ".house", ".conf"):
        return [[_word(word) for word in re.split("[, ]", line)] for line in path.read_text().splitlines()]
    if path.suffix == ".jpg":  # its content has no checksum
        return path.suffix
    return path.read_bytes()


def _shape(value: Any, records: bool = False) -> Any:
    """The types in a value; with `records`, the different ones of a list, and of a mapping of lists and mappings."""
    if isinstance(value, dict | list):
        parts = value.values() if isinstance(value, dict) else value
        shapes = [_shape(part, records) for part in parts]
        if records and shapes and (isinstance(value, list) or all(isinstance(part, dict | list) for part in parts)):
            return sorted(set(map(repr, shapes)))
        return dict(zip(value, shapes, strict=True)) if isinstance(value, dict) else shapes
    if isinstance(value, int | float) and not isinstance(value, bool):
        return "number" if abs(value) <= MAX_NUMBER else "beyond"
    if isinstance(value, str):
        return "text" if value.strip() and value.isprintable() and len(value) < 1000 else "odd text"
    return type(value).__name__


def _word(word: str) -> str:
    try:
        return "number" if abs(float(word)) <= MAX_NUMBER else "beyond"
    except ValueError:
        return "text"


def _array(array: np.ndarray) -> Any:
    numbers = np.abs(array[np.isfinite(array)]) if array.dtype.kind in "iuf" else np.zeros(0)
    return array.dtype, array.shape, len(numbers), bool((numbers > MAX_NUMBER).any())
