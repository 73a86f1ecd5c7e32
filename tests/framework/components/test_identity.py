"""What a configured component is known by, and what that follows."""

from __future__ import annotations

import hashlib
import json
import pickle
from pathlib import Path

import pytest
from pydantic import Field, ValidationError

from salframe.framework.component import ComponentConfig, added, match_only
from salframe.framework.components.identity import (
    UserFile,
    content_sha256,
    identity,
    matching_settings,
    settings_identity,
)
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.framework.errors import ConfigError
from salframe.framework.files.hashes import digest
from salframe.framework.files.weights import Download, NetworkWeights, WeightsFile
from salframe.framework.validation import Settings, validate
from salframe.graphs.saliency import SaliencyModel

SMALL, LARGE = (
    NetworkWeights(name, "MIT", (WeightsFile(f"{name}.pt", sha256, 1),), Download(("file:///nowhere",)))
    for name, sha256 in (("small", "5" * 64), ("large", "1" * 64))
)


class Later(Settings):
    """With settings that came later."""

    since: int = added(1)
    view: int = added(2, match_only=True)


def test_settings_that_came_later_count_where_they_are_set():
    assert settings_identity(Later()) == {}
    assert settings_identity(Later(since=5, view=6)) == {"since": 5, "view": 6}
    assert settings_identity(Later(since=5, view=6), describing=True) == {"since": 5}
    assert matching_settings(Later(since=5, view=6)) == {"view": 6}


class Part(Settings):
    table: UserFile | None = None
    tables: tuple[UserFile, ...] = ()
    limit: int = match_only(3)


class Model(SaliencyModel):
    """Settings of every kind."""

    name = "model"
    version = "7"
    weights = (SMALL, LARGE)

    class Config(ComponentConfig):
        share: float = 0.5
        table: UserFile | None = None
        part: Part = Part()
        parts: dict[str, Part] = Field(default_factory=dict)
        network: str | None = None
        tries: int = match_only(3)

    @classmethod
    def weights_in_use(cls, config):
        return tuple(weights for weights in cls.weights if weights.name == config.network)

    def score(self, detections):
        return detections.scores


class Outer(SaliencyModel):
    """Holds components."""

    name = "outer"
    version = "1"

    class Config(ComponentConfig):
        inner: slot("saliency", "model")
        judge: slot("saliency", "model", match_only=True)

    def score(self, detections):
        return detections.scores


@pytest.fixture
def models(fakes):
    for component in (Model, Outer):
        registry().add(component, "test")


def of(**settings) -> str:
    return digest(identity(Model.Config(**settings)))


def test_it_says_role_name_version_and_settings():
    assert identity(Model.Config(share=0.25)) == {
        "role": "saliency",
        "name": "model",
        "version": "7",
        "settings": {
            "share": 0.25,
            "table": None,
            "part": {"table": None, "tables": [], "limit": 3},
            "parts": {},
            "network": None,
            "tries": 3,
        },
    }


def test_each_setting_and_the_version_change_it(monkeypatch):
    known = {of(), of(share=0.25), of(tries=4), of(part=Part(limit=4)), of(parts={"a": Part()})}
    monkeypatch.setattr(Model, "version", "8")
    assert len(known | {of()}) == 6


def test_the_content_of_a_file_is_part_of_it_and_its_name_is_not(tmp_path):
    (tmp_path / "table.csv").write_bytes(b"chair, 1")
    before = identity(Model.Config(table=tmp_path / "table.csv"))
    assert before["settings"]["table"] == hashlib.sha256(b"chair, 1").hexdigest()
    (tmp_path / "elsewhere").mkdir()
    moved = (tmp_path / "table.csv").rename(tmp_path / "elsewhere" / "renamed.csv")
    assert identity(Model.Config(table=str(moved))) == before
    moved.write_bytes(b"chair, 1; table, 2")
    assert identity(Model.Config(table=moved)) != before


def test_a_folder_counts_by_the_names_and_contents_in_it(tmp_path):
    folder = tmp_path / "tables"
    (folder / "more").mkdir(parents=True)
    (folder / "a.csv").write_text("chair")
    (folder / "more" / "b.csv").write_text("table")
    before = of(table=folder)
    moved = folder.rename(tmp_path / "moved")
    assert of(table=moved) == before
    (moved / "more" / "b.csv").write_text("sofa, bed")
    changed = of(table=moved)
    (moved / "more" / "b.csv").rename(moved / "more" / "c.csv")
    renamed = of(table=moved)
    (moved / "a.csv").unlink()
    assert len({before, changed, renamed, of(table=moved)}) == 4


def test_files_deep_in_the_settings_count_too(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("one")
    settings = ({"part": {"table": path}}, {"part": {"tables": (path,)}}, {"parts": {"a": {"table": path}}})
    before = [of(**given) for given in settings]
    path.write_text("another")
    assert not set(before) & {of(**given) for given in settings}


def test_a_file_that_is_not_there_is_known_by_its_name(tmp_path):
    assert content_sha256(tmp_path / "absent") is None
    assert identity(Model.Config(table=tmp_path / "absent"))["settings"]["table"] == str(tmp_path / "absent")


def test_descriptions_do_not_depend_on_what_matters_to_matching_only():
    base = identity(Model.Config(), describing=True)
    assert "tries" not in base["settings"]
    assert "limit" not in base["settings"]["part"]
    assert identity(Model.Config(tries=9, part=Part(limit=9)), describing=True) == base
    assert identity(Model.Config(share=0.25), describing=True) != base
    assert "tries" in identity(Model.Config())["settings"]


def test_slots_are_known_by_their_components(models):
    def known(describing: bool = False, **settings) -> dict:
        return identity(Outer.Config(**settings), describing=describing)

    assert known()["settings"]["inner"] == identity(Model.Config())
    assert known(judge={"share": 0.25}) != known()
    assert known(True)["settings"] == {"inner": identity(Model.Config(), describing=True)}
    assert known(True, judge={"share": 0.25}) == known(True)
    assert known(True, inner={"tries": 9}) == known(True)
    assert known(True, inner={"share": 0.25}) != known(True)


def test_weights_in_use_are_part_of_it(models):
    assert "weights" not in identity(Model.Config())
    assert identity(Model.Config(network="small"))["weights"] == ["5" * 64]
    assert identity(Model.Config(network="large"))["weights"] == ["1" * 64]
    inner = identity(Outer.Config(inner={"network": "small"}), describing=True)
    assert inner["settings"]["inner"]["weights"] == ["5" * 64]


def test_it_is_json_and_survives_json(tmp_path):
    config = Model.Config(table=tmp_path, part=Part(tables=(tmp_path,)), parts={"a": Part(table=tmp_path)})
    known = identity(config)
    assert json.loads(json.dumps(known)) == known
    again = Model.Config.model_validate(json.loads(config.model_dump_json()))
    assert again == config
    assert identity(again) == known


def test_a_file_is_a_path_wherever_it_goes(tmp_path):
    (tmp_path / "table.csv").write_text("chair")
    file = Model.Config(table=tmp_path / "table.csv").table
    assert isinstance(file, Path)
    assert type(file) is UserFile
    assert pickle.loads(pickle.dumps(file)) == file
    assert file.read_text() == "chair"
    with pytest.raises(ValidationError):
        Model.Config(table="")
    with pytest.raises(ConfigError, match=r"model\.table.* received 3, expected"):
        validate(Model.Config, {"table": 3}, "model")


def test_the_order_of_keys_does_not_change_a_digest():
    assert digest({"a": 1, "b": [2.5, None]}) == digest({"b": [2.5, None], "a": 1})
    assert digest({"a": 1}) == hashlib.sha256(b'{"a":1}').hexdigest()


class Marks(Settings):
    kept: frozenset[int] = frozenset()
    parts: tuple[Part, ...] = ()


def test_the_order_of_a_set_is_no_part_of_it():
    one, other = Marks(kept=frozenset([0, 8])), Marks(kept=frozenset([8, 0]))
    assert list(one.kept) != list(other.kept)
    assert settings_identity(one) == settings_identity(other) == {"kept": [0, 8], "parts": []}


def test_settings_of_no_component_have_one_too(tmp_path):
    (tmp_path / "table.csv").write_bytes(b"chair, 1")
    marks = Marks(parts=(Part(table=tmp_path / "table.csv"),))
    part = {"table": hashlib.sha256(b"chair, 1").hexdigest(), "tables": []}
    assert settings_identity(marks, describing=True)["parts"] == [part]
    assert settings_identity(marks)["parts"] == [{**part, "limit": 3}]


def test_a_file_that_cannot_be_read_is_one_line(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot read .*: File name too long"):
        validate(Model.Config, {"table": str(tmp_path / ("x" * 300))}, "model")
