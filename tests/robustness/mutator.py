"""Damages files, by a seed: what disks, editors and other programs make of them, and what is meant to harm."""

from __future__ import annotations

import copy
import io
import json
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

STRANGE = (
    None, True, [], {}, [[]], "", "NaN", "x" * 5000, "a\0b", "../../..", -1, 0, 0.5, 10**18, 10**25, 1e300,
    float("nan"), float("inf"), "\ud800", [1, [2, [3, ["four"]]]], {"a": 1}, {"kind": None}, "2020-01-01", " ",
)  # fmt: skip
"""What stands where something else is expected."""
LAUGHS = b"a0: &a0 [1, 1, 1]\n" + b"".join(
    b"a%d: &a%d [%s]\n" % (i, i, b", ".join([b"*a%d" % (i - 1)] * 9)) for i in range(1, 12)
)
RAW = (
    b"[" * 5000 + b"]" * 5000,
    b"{\"a\":" * 5000 + b"1" + b"}" * 5000,
    b"- " * 5000,
    b"9" * 5000,
    b"[1]",
    b"null",
    b"\xff\xfe\x00",
    b"a: &a [*a]",
    b"base: .\n",
    b"base: [x.yaml]\n",
    b"a: !!binary aGVsbG8=\n",
    b"a: !!set {b, c}\n",
    LAUGHS,
    b'{"a": 1e999}',
    b'{"a": ' + b"9" * 5000 + b"}",
    b"<map/>",
    b"PK\x03\x04" + bytes(100),
    b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (100000000000,), }" + b" " * 40 + b"\n",
    b"\x93NUMPY\x01\x00v\x00{'descr': '|O', 'fortran_order': False, 'shape': (1,), }" + b" " * 50 + b"\n",
)  # fmt: skip
"""Contents that are tried whatever the file is."""


def damage(path: Path, rng: np.random.Generator) -> str:
    """Damage a file; returns how."""
    ways = [special, special, raw, truncate, flip, flip, splice]
    ways += {".json": [values] * 8, ".jsonl": [values] * 8, ".yaml": [values] * 8}.get(path.suffix, [])
    ways += {".npy": [arrays] * 6, ".npz": [archive] * 6, ".parquet": [table] * 10}.get(path.suffix, [])
    ways += [words] * 6 if path.suffix in (".csv", ".house", ".conf") else []
    way = ways[rng.integers(len(ways))]
    way(path, rng)
    return way.__name__


def special(path: Path, rng: np.random.Generator) -> None:
    """Something else than a file."""
    path.unlink()
    kind = rng.integers(4)
    if kind == 0:
        os.mkfifo(path)
    elif kind == 1:
        path.symlink_to("/dev/zero")
    elif kind == 2:
        path.mkdir()


def raw(path: Path, rng: np.random.Generator) -> None:
    path.write_bytes(RAW[rng.integers(len(RAW))])


def truncate(path: Path, rng: np.random.Generator) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: rng.integers(len(content))])


def flip(path: Path, rng: np.random.Generator) -> None:
    content = bytearray(path.read_bytes())
    for at in rng.integers(len(content), size=rng.integers(1, 9)):
        content[at] ^= 1 << rng.integers(8)
    path.write_bytes(content)


def splice(path: Path, rng: np.random.Generator) -> None:
    """A piece of the file, or noise, in another place of it."""
    content = path.read_bytes()
    start, end = sorted(rng.integers(len(content), size=2).tolist())
    at = int(rng.integers(len(content)))
    piece = content[start:end] if rng.random() < 0.5 else rng.bytes(min(end - start, 100))
    path.write_bytes(content[:at] + piece + content[at + (len(piece) if rng.random() < 0.5 else 0) :])


def words(path: Path, rng: np.random.Generator) -> None:
    """Another word in a text of words."""
    text = path.read_text().replace(",", " , ").split(" ")
    strange = ("nan", "inf", "", "x", "-1", "9" * 400, "1e400", "\0", "None", "'\"\n")
    text[rng.integers(len(text))] = strange[rng.integers(len(strange))]
    path.write_text(" ".join(text).replace(" , ", ","))


def values(path: Path, rng: np.random.Generator) -> None:
    """Another value, key or order in a document."""
    lines = path.suffix == ".jsonl"
    text = path.read_text()
    content = [json.loads(line) for line in text.splitlines()] if lines else yaml.safe_load(text)
    for _ in range(rng.integers(1, 3)):
        content = _changed(content, rng)
    if lines and isinstance(content, list):
        path.write_text("".join(json.dumps(line) + "\n" for line in content))
    else:
        path.write_text(json.dumps(content, ensure_ascii=True))


def _changed(value, rng: np.random.Generator):
    if not isinstance(value, dict | list) or not value or rng.random() < 0.15:
        return copy.deepcopy(STRANGE[rng.integers(len(STRANGE))])
    keys = list(value) if isinstance(value, dict) else range(len(value))
    key = keys[rng.integers(len(keys))]
    way = rng.random()
    if way < 0.1:
        del value[key]
    elif way < 0.2 and isinstance(value, list):
        rng.shuffle(value)
    elif way < 0.2:
        value["strange" if rng.random() < 0.5 else "a\0\ud800"] = value.pop(key)
    elif way < 0.3 and isinstance(value, list):
        value.append(value[key])
    else:
        value[key] = _changed(value[key], rng)
    return value


def arrays(path: Path, rng: np.random.Generator) -> None:
    _save(path, _other(np.load(path), rng))


def archive(path: Path, rng: np.random.Generator) -> None:
    """Missing, extra or other arrays; one array in the place of several."""
    content = dict(np.load(path))
    name = sorted(content)[rng.integers(len(content))]
    way = rng.random()
    if way < 0.2:
        del content[name]
    elif way < 0.4:
        content["extra"] = np.zeros(3)
    elif way < 0.5:
        _save(path, content[name])
        return
    else:
        content[name] = _other(content[name], rng)
    file = io.BytesIO()
    np.savez_compressed(file, **content)
    path.write_bytes(file.getvalue())


def _save(path: Path, array: np.ndarray) -> None:
    with path.open("wb") as file:
        np.save(file, array)


def _other(array: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    numbers = array if array.dtype.kind in "iufb" else np.arange(array.size).reshape(array.shape)
    choices = (
        lambda: numbers.astype(bool),
        lambda: numbers.astype(float) * np.nan,
        lambda: numbers.astype(float) * 1e300,
        lambda: array.astype("U9"),
        lambda: numbers.astype(np.complex64),
        lambda: array.ravel()[:-1],
        lambda: array[None],
        lambda: array.ravel()[::-1],
        lambda: np.zeros((0, 10**9)),
        lambda: numbers.astype(float) - 7,
        lambda: np.full(array.shape, 255, np.uint8),
        lambda: np.zeros(array.shape, "M8[s]"),
    )
    return choices[rng.integers(len(choices))]()


def table(path: Path, rng: np.random.Generator) -> None:
    """Null, nested, text, empty, absent or repeated."""
    content = pq.read_table(path)
    ids, labels = content["instance_id"].to_pylist(), content["label"].to_pylist()
    choices = (
        {"instance_id": list(map(str, ids)), "label": labels},
        {"instance_id": list(map(float, ids)), "label": labels},
        {"instance_id": [None, *ids[1:]], "label": labels},
        {"instance_id": [[one] for one in ids], "label": labels},
        {"instance_id": [True] * len(ids), "label": labels},
        {"instance_id": [-one for one in ids], "label": labels},
        {"instance_id": [ids[0]] * len(ids), "label": labels},
        {"instance_id": ids, "label": [None, *labels[1:]]},
        {"instance_id": ids, "label": ids},
        {"instance_id": ids, "label": [{"a": one} for one in labels]},
        {"instance_id": pa.array([], pa.int64()), "label": pa.array([], pa.string())},
        {"label": labels},
        {"instance_id": ids, "label": [one.encode() + b"\xff" for one in labels]},
    )
    pq.write_table(pa.table(choices[rng.integers(len(choices))]), path)
