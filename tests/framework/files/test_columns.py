"""Rows of named arrays as packed columns."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.framework.errors import DataError
from salframe.framework.files import columns
from salframe.framework.files.columns import check_kinds, read_columns, write_columns

PAIR = np.dtype([("near", "u1"), ("at_mm", "<i2", 3)])


def scene(count: int) -> dict[str, np.ndarray]:
    """Arrays of all sorts, `count` rows long where they may be."""
    rng = np.random.default_rng(count)
    pairs = np.zeros(count, PAIR)
    pairs["at_mm"] = rng.integers(-999, 999, (count, 3))
    return {
        "labels": rng.choice(["bed", "Schönbett", ""], count).astype(np.str_),
        "name": np.array(f"scene {count}"),
        "count": np.array(count),
        "pairs": pairs,
        "table": rng.normal(size=(count, 3)).astype(np.float32),
        "square": rng.normal(size=(count, count)) > 0,
        "a/b .": rng.normal(size=4),
    }


def test_rows_are_read_back_exactly(tmp_path):
    rows = [scene(count) for count in (3, 0, 7, 1)]
    write_columns(tmp_path / "rows", iter(rows))
    read = read_columns(tmp_path / "rows")
    assert [read[-1]["name"], len(read[::2])] == ["scene 1", 2]
    for row, back in zip(rows, read, strict=True):
        assert list(back) == list(row)
        for name, array in row.items():
            np.testing.assert_array_equal(back[name], array, strict=name not in ("labels", "name"))
            assert back[name].dtype.kind == array.dtype.kind


def test_rows_in_pieces_make_the_same_files(tmp_path, monkeypatch):
    """Whatever words and types come late, and where the first row that has a name is."""
    rows = [*({"late": np.array(name)} for name in "qa"), *({**scene(count), "few": np.ones(2)} for count in (3, 0, 7))]
    rows += [{"count": np.array(0.5)}, {"late": np.array("Z")}]
    monkeypatch.setattr(columns, "_CHUNK", 100)
    write_columns(tmp_path / "whole", rows)
    for chunk in (1, 3):
        monkeypatch.setattr(columns, "_CHUNK", chunk)
        write_columns(tmp_path / str(chunk), rows)
        for path in (tmp_path / "whole").iterdir():
            assert (tmp_path / str(chunk) / path.name).read_bytes() == path.read_bytes()
    (late, counts) = (read_columns(tmp_path / "1").columns[name] for name in ("late", "count"))
    assert late.words == ("", "Z", "a", "q")
    assert counts.values.tolist() == [0, 0, 3, 0, 7, 0.5, 0]
    assert sorted(counts.absent) == [0, 1, 6]


def test_what_a_row_does_not_have_it_does_not_get(tmp_path):
    rows = [{"a": np.arange(3)}, {"b": np.array("x")}, {}, {"a": np.arange(4), "b": np.array("y")}]
    write_columns(tmp_path / "rows", rows)
    back = read_columns(tmp_path / "rows")
    assert [sorted(row) for row in back] == [["a"], ["b"], [], ["a", "b"]]
    assert (back[3]["a"].tolist(), str(back[3]["b"])) == ([0, 1, 2, 3], "y")


def test_no_row_and_rows_of_nothing(tmp_path):
    for number, rows in enumerate(([], [{}, {}])):
        write_columns(tmp_path / str(number), rows)
        assert list(read_columns(tmp_path / str(number))) == rows


def test_a_table_that_lost_its_rows_is_one_line(tmp_path):
    write_columns(tmp_path / "rows", [{"a": np.arange(3)}, {"a": np.arange(4)}])
    table = tmp_path / "rows" / "columns.json"
    table.write_text(table.read_text().replace('"rows":2', '"rows":0'))
    with pytest.raises(DataError, match=r"a\.npy has an array of shape \(7,\), expected \(\d+,\) according to"):
        read_columns(tmp_path / "rows")


def test_a_table_that_lost_its_words_is_one_line(tmp_path):
    write_columns(tmp_path / "rows", [{"a": np.array("x")}])
    table = tmp_path / "rows" / "columns.json"
    table.write_text(table.read_text().replace('["x"]', "[]"))
    with pytest.raises(DataError, match=r"a\.npy contains the index \d+ into a list of 0 strings, expected an"):
        read_columns(tmp_path / "rows")


@pytest.mark.parametrize(("max_read_bytes", "is_mapped"), [(1 << 26, False), (1, True)])
def test_large_values_are_mapped_into_memory_and_none_can_be_written(tmp_path, monkeypatch, max_read_bytes, is_mapped):
    monkeypatch.setattr("salframe.framework.files.array_files.MAX_READ_BYTES", max_read_bytes)
    write_columns(tmp_path / "rows", [{"a": np.arange(6.0)}, {"a": np.arange(9.0)}])
    first, second = (row["a"] for row in read_columns(tmp_path / "rows"))
    assert first.base is second.base
    holder = first
    while isinstance(holder.base, np.ndarray):
        holder = holder.base
    assert isinstance(holder, np.memmap) == is_mapped
    with pytest.raises(ValueError, match="read-only"):
        first[0] = 1


def test_columns_cost_their_values_and_a_header(tmp_path):
    """1,000 rows of 5 words of 3: a byte a word, a header of 128 bytes, and the table."""
    write_columns(tmp_path / "rows", [{"labels": np.array(["bed", "sofa", "lamp", "bed", "bed"])}] * 1000)
    sizes = {path.name: path.stat().st_size for path in (tmp_path / "rows").iterdir()}
    assert sizes["labels.npy"] == 128 + 5000
    assert sorted(sizes) == ["columns.json", "labels.npy"]
    assert sizes["columns.json"] < 150


def test_arrays_of_other_dimensions_are_refused(tmp_path):
    with pytest.raises(DataError, match=r"arrays 'a' with 1 and 2 dimensions, expected the same"):
        write_columns(tmp_path / "rows", [{"a": np.zeros(3)}, {"a": np.zeros((3, 1))}])


@pytest.mark.parametrize("second", [np.arange(3), np.array([None])])
def test_arrays_that_no_column_holds_are_refused(tmp_path, second):
    with pytest.raises(
        DataError, match=r"arrays 'a' that contain .* and strings, expected either only numbers or only strings"
    ):
        write_columns(tmp_path / "rows", [{"a": np.array(["bed"])}, {"a": second}])


def test_empty_arrays_are_of_any_type(tmp_path):
    write_columns(tmp_path / "rows", [{"a": np.array([])}, {"a": np.array(["bed"])}, {"a": np.array([], int)}])
    assert [row["a"].tolist() for row in read_columns(tmp_path / "rows")] == [[], ["bed"], []]


def test_columns_of_another_kind_than_a_row_are_refused(tmp_path):
    write_columns(tmp_path / "rows", [{"weight": np.ones(2), "labels": np.array(["bed"])}])
    columns = read_columns(tmp_path / "rows")
    check_kinds(columns, {"weight": np.ones(3, np.float32), "labels": np.array(["lamp"]), "other": np.ones(1)})
    check_kinds(columns, {"weight": np.ones(3, int), "labels": np.zeros(0)})
    for row in ({"weight": np.ones(3, bool)}, {"weight": np.ones(3, complex)}, {"labels": np.ones(3)}):
        with pytest.raises(
            DataError, match=rf"{next(iter(row))}\.npy contains .*, expected {next(iter(row.values())).dtype}"
        ):
            check_kinds(columns, row)
