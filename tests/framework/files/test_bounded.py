"""What is read stays within bounds, and is no more than data."""

from __future__ import annotations

import io
import os
import pickle

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.framework.files.array_files import map_array, parse_arrays
from salframe.framework.files.bounded import MAX_DEPTH, MAX_NODES, parse_json, parse_yaml, read_bytes
from salframe.framework.files.image_files import read_image

PARSERS = {"json": parse_json, "yaml": parse_yaml}


@pytest.mark.parametrize("parse", PARSERS.values(), ids=PARSERS.keys())
def test_nesting_is_bounded(parse):
    assert parse(b"[" * MAX_DEPTH + b"]" * MAX_DEPTH) != 0
    with pytest.raises(ValueError, match=rf"{MAX_DEPTH + 1} levels"):
        parse(b"[" * (MAX_DEPTH + 1) + b"]" * (MAX_DEPTH + 1))


def test_brackets_in_text_do_not_nest():
    text = "[" * 5000 + '\\"' + "{" * 5000
    assert parse_json(f'{{"a": "{text}"}}'.replace("\\\\", "\\").encode())["a"].count("[") == 5000


@pytest.mark.parametrize("parse", PARSERS.values(), ids=PARSERS.keys())
@pytest.mark.parametrize("number", ["9" * 5000, str(1 << 64), str(-(1 << 63) - 1)])
def test_integers_have_64_bits(parse, number):
    with pytest.raises(ValueError, match=r"64 bits|digits"):
        parse(f"[{number}]".encode())
    assert parse(f"[{(1 << 64) - 1}, {-(1 << 63)}]".encode()) == [(1 << 64) - 1, -(1 << 63)]


@pytest.mark.parametrize(
    "text", ['{"a": NaN}', '{"a": -Infinity}', '{"a": 1e999}', r'{"a": "\ud800"}', '{"a": "\xff"}', "", "{"]
)
def test_json_that_is_none(text):
    with pytest.raises(ValueError, match=r"finite|UTF|utf|Expecting"):
        parse_json(text.encode("latin-1"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: !!binary aGk=", "tag"),
        ("a: !!set {b}", "tag"),
        ("a: !!python/object/apply:os.system [ls]", "tag"),
        ("a: 2020-01-01", "key a: received the date 2020-01-01, expected text"),
        ("a: {b: [1, .nan]}", r"key a\.b\.1: received the number nan, expected a finite number"),
        ("a: .nan", "finite"),
        ("a: &b [*b]", r"\*b refers to a value that contains this alias"),
        ("? [1]\n: 2", "key"),
        ("1.5: a", "the key 1.5, expected a key that is text or an integer"),
    ],
)
def test_yaml_that_is_no_plain_data(text, message):
    with pytest.raises(ValueError, match=message):
        parse_yaml(text)


def test_aliases_do_not_multiply():
    assert parse_yaml("a: &a [1, 2]\nb: *a") == {"a": [1, 2], "b": [1, 2]}
    laughs = "a0: &a0 [1]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12))
    with pytest.raises(ValueError, match=f"more than {MAX_NODES} values"):
        parse_yaml(laughs)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no FIFOs")
def test_only_regular_files_are_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(ValueError, match="a pipe, socket or device, expected a regular file"):
            read_bytes(tmp_path / path)
    with pytest.raises(ValueError, match="a folder, expected a regular file"):
        read_bytes(tmp_path)
    (tmp_path / "large").write_bytes(bytes(11))
    with pytest.raises(ValueError, match="11 bytes, expected at most 10"):
        read_bytes(tmp_path / "large", 10)


def archive(**arrays) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def test_no_pickle_is_run(tmp_path):
    with pytest.raises(ValueError, match="Python objects"):
        parse_arrays(archive(a=np.array([{1}], object)))
    np.save(tmp_path / "a.npy", np.array([{1}], object), allow_pickle=True)
    with pytest.raises(ValueError, match="Python objects"):
        map_array(tmp_path / "a.npy")
    with pytest.raises(ValueError, match="not a zip file"):
        parse_arrays(pickle.dumps([1]))


def test_a_header_is_held_against_the_bytes(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(3.0))
    content = (tmp_path / "a.npy").read_bytes()
    huge = content.replace(b"(3,), }" + b" " * 11, b"(100000000000,), }")
    assert len(huge) == len(content)
    (tmp_path / "a.npy").write_bytes(huge)
    with pytest.raises(ValueError, match=r"24 bytes of values, expected 800000000000 for dtype float64"):
        map_array(tmp_path / "a.npy")
    np.testing.assert_array_equal(parse_arrays(archive(a=np.arange(6).reshape(2, 3)))["a"], [[0, 1, 2], [3, 4, 5]])


def test_a_picture_of_too_many_pixels_is_not_decoded(tmp_path):
    from PIL import Image

    Image.new("1", (20000, 20000)).save(tmp_path / "a.png")
    with pytest.raises(
        DataError, match="20000 x 20000, expected at most 268435456 pixels in total: reduce the size of the image"
    ):
        read_image(tmp_path / "a.png", 0)
