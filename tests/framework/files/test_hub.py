"""Models of a hub on the loopback: downloaded on request, pinned, hashed, and never anything but safetensors."""

import hashlib
import importlib.util
import json

import pytest
from command_line import run
from hub_server import COMMIT, hub
from loopback import serving

from salframe.framework.components.installation import fetch_weights, find_weights, list_weights
from salframe.framework.components.registry import registry
from salframe.framework.errors import RequirementMissing, WeightsError
from salframe.framework.files.hub import MANIFEST

pytest.importorskip("huggingface_hub")

NAME = "hf:org/model"
FILES = {
    "config.json": b'{"model_type": "segformer"}',
    "preprocessor_config.json": b"{}",
    "vocab.txt": b"a\nb\n",
    "model.safetensors": b"numbers" * 1000,
    "pytorch_model.bin": b"pickle",
    "modeling.py": b"print(1)",
    "README.md": b"# model",
}
DOWNLOADED = ["config.json", "model.safetensors", "preprocessor_config.json", "vocab.txt"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The files on the hub; the cache of salframe is empty."""
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("HF_TOKEN", raising=False)
    folder = tmp_path / "served"
    folder.mkdir()
    for name, content in FILES.items():
        (folder / name).write_bytes(content)
    return folder


@pytest.fixture
def serve(folder, monkeypatch):
    """Start the hub; returns the requests that it receives."""
    started = []

    def start(**settings) -> list[str]:
        requests: list[str] = []
        server = serving(hub(folder, requests=requests, **settings))
        monkeypatch.setenv("HF_ENDPOINT", server.__enter__())
        started.append(server)
        return requests

    yield start
    for server in started:
        server.__exit__(None, None, None)


def test_a_fetched_model_is_pinned_to_its_commit_with_the_hash_of_every_file(serve, folder, tmp_path):
    serve()
    calls = []
    paths = fetch_weights(NAME, lambda *call: calls.append(call))
    assert [path.name for path in paths] == DOWNLOADED
    assert {path.parent for path in paths} == {tmp_path / "cache/weights/hub/org--model" / COMMIT}
    assert [path.read_bytes() for path in paths] == [FILES[name] for name in DOWNLOADED]
    assert sorted(path.name for path in paths[0].parent.iterdir()) == sorted([*DOWNLOADED, MANIFEST])
    size = sum(len(FILES[name]) for name in DOWNLOADED)
    assert calls[0] == (0, size)
    assert calls[-1] == (size, size)
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    for name in (NAME, f"{NAME}@{COMMIT}"):
        weights = find_weights(name, registry())
        assert weights.name == f"{NAME}@{COMMIT}"
        assert weights.licence == "apache-2.0"
        assert [file.sha256 for file in weights.files] == [
            hashlib.sha256(FILES[name]).hexdigest() for name in DOWNLOADED
        ]
        assert weights.paths() == paths
    assert list_weights(registry())[-1] == weights


def test_a_pinned_model_stays_the_same_when_the_branch_moves(serve, folder):
    serve()
    first = fetch_weights(NAME)
    (folder / "config.json").write_bytes(b'{"model_type": "other"}')
    requests = serve(commit="f" * 40)
    assert fetch_weights(NAME) == first
    assert requests == []
    newer = fetch_weights(f"{NAME}@{'f' * 40}")
    assert newer[0].read_bytes() == b'{"model_type": "other"}'
    assert first[0].read_bytes() == FILES["config.json"]


def test_a_damaged_file_is_reported_and_fetched_again(serve):
    serve()
    path = fetch_weights(NAME)[1]
    path.write_bytes(b"else")
    with pytest.raises(
        WeightsError, match=r"has the sha256 hash .*, expected .*: salframe weights fetch hf:org/model@c0ffee"
    ):
        find_weights(NAME, registry()).paths()
    assert fetch_weights(NAME)[1].read_bytes() == FILES["model.safetensors"]


@pytest.mark.parametrize("name", ["model.safetensors", "config.json"])
def test_a_file_with_another_hash_than_the_hub_states_is_refused(serve, folder, name, tmp_path):
    serve()
    (folder / name).write_bytes(FILES[name].replace(b"e", b"i"))
    with pytest.raises(WeightsError, match=f"{name} of hf:org/model has the hash .*, expected .*: try again"):
        fetch_weights(NAME)
    assert not list((tmp_path / "cache").glob("**/*.safetensors"))
    with pytest.raises(WeightsError, match="the model hf:org/model is not downloaded"):
        find_weights(NAME, registry())


def test_weights_in_parts_are_downloaded(serve, folder):
    (folder / "model.safetensors").unlink()
    index = {"weight_map": {"a": "model-00001-of-00002.safetensors", "b": "model-00002-of-00002.safetensors"}}
    (folder / "model.safetensors.index.json").write_text(json.dumps(index))
    for name in index["weight_map"].values():
        (folder / name).write_bytes(name.encode())
    serve()
    names = [path.name for path in fetch_weights(NAME)]
    assert set(index["weight_map"].values()) | {"model.safetensors.index.json"} <= set(names)


@pytest.mark.parametrize("name", ["model.safetensors", "config.json"])
def test_a_model_without_safetensors_or_configuration_is_refused(serve, folder, name):
    (folder / name).unlink()
    requests = serve()
    with pytest.raises(
        WeightsError, match=f"hf:org/model has no {name}, expected both config.json and model.safetensors"
    ):
        fetch_weights(NAME)
    assert not any("resolve" in request for request in requests)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("hf:org/gone", r"http://\S+ has no public model org/gone, expected a public model as hf:ORG/MODEL"),
        ("hf:org/model@v9", r"http://\S+/org/model has no revision 'v9', expected a branch, tag or commit"),
        (
            "hf:org/gated",
            r"hf:org/gated is restricted to registered users: accept its terms at http://\S+/org/gated, and ",
        ),
        ("hf:model", r"'hf:model' is not a name of a Hugging Face model, expected hf:ORG/MODEL\[@REVISION\]"),
        ("hf:../../etc", r"'hf:../../etc' is not a name of a Hugging Face model, expected"),
    ],
)
def test_what_the_hub_does_not_have_is_one_line(serve, name, message):
    serve()
    with pytest.raises(WeightsError, match=message) as caught:
        fetch_weights(name)
    assert "\n" not in str(caught.value)


def test_without_a_hub_one_line_names_the_ways_out(folder, monkeypatch):
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")
    printed = run("weights", "fetch", NAME)
    assert printed.code != 0
    (line,) = printed.err.strip().splitlines()
    assert line.startswith("error: cannot download the model hf:org/model from http://127.0.0.1:9 (")
    assert "download it on another machine" in line
    assert "local folder" in line


def test_without_huggingface_hub_one_line_says_how_to_install_it(folder, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "huggingface_hub" else find(name))
    with pytest.raises(
        RequirementMissing,
        match=r"needs the Python package huggingface_hub, which is not installed: pip install 'salframe\[trans",
    ):
        fetch_weights(NAME)


def test_the_commands_print_the_pinned_commit_and_the_licence(serve):
    serve(licence="mit")
    printed = run("weights", "where", NAME)
    assert printed.code != 0
    assert printed.err.strip().endswith("is not downloaded; download it with: salframe weights fetch hf:org/model")
    printed = run("weights", "fetch", NAME)
    assert printed.code == 0
    assert f"hf:org/model@{COMMIT}: mit" in printed.err
    assert run("weights", "where", NAME).out == printed.out
    row = run("weights", "list", "--json").json[-1]
    assert (row["name"], row["licence"], row["state"]) == (f"hf:org/model@{COMMIT}", "mit", "ready")
