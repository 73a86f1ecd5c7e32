"""Models of the Hugging Face hub: downloaded on request only, at a pinned commit, with the hash of every file."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field
from pydantic_core import core_schema

from salframe.framework.errors import DataError, RequirementMissing, WeightsError, one_line, shorten
from salframe.framework.files.cache import cache_home
from salframe.framework.files.hashes import file_sha256
from salframe.framework.files.reading import read_as, read_model
from salframe.framework.files.weights import ByteProgress, Download, NetworkWeights, WeightsFile
from salframe.framework.files.writing import new_folder, write_json
from salframe.framework.validation import Settings

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler

PREFIX = "hf:"
"""Start of the name of a model on the Hugging Face hub: hf:ORG/MODEL or hf:ORG/MODEL@REVISION."""
MANIFEST, REVISIONS = "salframe-hub.json", "revisions.json"
"""Names of the file that lists the files of a downloaded model, and of the file that pins revisions to commits."""
_NAME = re.compile(r"^hf:[\w.-]+/[\w.-]+(@[\w./-]+)?$")
_COMMIT = r"[0-9a-f]{40}"
_WEIGHTS = re.compile(r"model\.safetensors|model-\d+-of-\d+\.safetensors")
_TEXTS = (".json", ".txt")
"""Suffixes of the other files that a model needs: configurations and vocabularies."""
EXTRA = "salframe[transformers]"


class HubName(str):
    """Type of a setting that names a model of the Hugging Face hub: hf:ORG/MODEL or hf:ORG/MODEL@REVISION."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_after_validator_function(cls, core_schema.str_schema(pattern=_NAME.pattern))


@dataclass(frozen=True)
class HubReference:
    """A model on the Hugging Face hub.

    Attributes:
        repository: ORG/MODEL.
        revision: A branch, tag or commit.
    """

    repository: str
    revision: str = "main"

    @classmethod
    def parse(cls, name: str) -> HubReference:
        """Return the model with a name like hf:ORG/MODEL@REVISION. Raises WeightsError if the name has another form."""
        if not _NAME.match(name):
            raise WeightsError(
                f"{shorten(name)!r} is not a name of a Hugging Face model, expected hf:ORG/MODEL[@REVISION]"
            )
        return cls(*name.removeprefix(PREFIX).split("@"))

    def __str__(self) -> str:
        return f"{PREFIX}{self.repository}" + (f"@{self.revision}" if self.revision != "main" else "")

    @property
    def folder(self) -> Path:
        """The folder of all downloaded commits of the model."""
        return hub_home() / self.repository.replace("/", "--")

    @property
    def commit(self) -> str | None:
        """The commit of the revision. If the revision is a branch or a tag, it is the commit that was downloaded, or
        None if nothing was downloaded."""
        if re.fullmatch(_COMMIT, self.revision):
            return self.revision
        return _read_revisions(self.folder).get(self.revision)


@dataclass(frozen=True)
class HubWeights(NetworkWeights):
    """A downloaded model of the hub.

    Attributes:
        folder: The folder of the files.
    """

    folder: Path = Path()

    @property
    def directory(self) -> Path:
        """The folder of the files."""
        return self.folder


class _ManifestFile(Settings):
    name: str = Field(pattern=r"^[\w.-]+$")
    sha256: str = Field(pattern="^[0-9a-f]{64}$")
    size_bytes: int


class _HubManifest(Settings):
    """Files of a downloaded model, and their licence."""

    repository: str
    commit: str = Field(pattern=f"^{_COMMIT}$")
    licence: str
    files: tuple[_ManifestFile, ...]


def hub_home() -> Path:
    """Return the folder of all downloaded models of the Hugging Face hub."""
    return cache_home() / "weights" / "hub"


def is_hub_name(name: str) -> bool:
    """Return whether a name of weights has the prefix `hf:`, which names a model of the Hugging Face hub."""
    return name.startswith(PREFIX)


def find_hub_model(name: str) -> HubWeights:
    """Return a downloaded model of the Hugging Face hub, without verifying its files.

    Args:
        name: hf:ORG/MODEL or hf:ORG/MODEL@REVISION. The default revision is `main`.

    Raises:
        WeightsError: The model was not downloaded. The message has the command that downloads it.
    """
    reference = HubReference.parse(name)
    commit = reference.commit
    if commit is None or not (reference.folder / commit / MANIFEST).is_file():
        command = f"salframe weights fetch {reference}"
        raise WeightsError(f"the model {reference} is not downloaded; download it with: {command}", command)
    return _read_model(reference.folder / commit)


def list_hub_models() -> Iterator[HubWeights]:
    """Yield all downloaded models of the Hugging Face hub, sorted by name."""
    for path in sorted(hub_home().glob(f"[!.]*/[!.]*/{MANIFEST}")):
        yield _read_model(path.parent)


def fetch_hub_model(name: str, progress: ByteProgress = lambda done, total: None) -> HubWeights:
    """Download a model of the hub to the cache of salframe and verify it, unless it was downloaded before.

    The weights must be safetensors. No other format and no code is downloaded. The first download pins the revision to
    its commit: the same name stands for the same files until the folder is removed.

    Args:
        name: hf:ORG/MODEL[@REVISION].
        progress: Called with the number of received bytes and the total.

    Returns:
        The model. Its name contains the commit.

    Raises:
        RequirementMissing: huggingface_hub is not installed.
        WeightsError: The hub cannot be reached, has no such model or no safetensors, or a file is damaged.
    """
    reference = HubReference.parse(name)
    try:
        model = find_hub_model(name)
        model.paths()
        return model
    except WeightsError:
        pass
    if importlib.util.find_spec("huggingface_hub") is None:
        remedy = f"pip install '{EXTRA}'"
        raise RequirementMissing(
            f"the download of {reference} needs the Python package huggingface_hub, which is not installed: {remedy}",
            remedy,
        )
    from huggingface_hub import HfApi

    api = HfApi(endpoint=os.environ.get("HF_ENDPOINT"))
    with _explaining(reference, api.endpoint):
        info = api.model_info(
            reference.repository, revision=reference.commit or reference.revision, files_metadata=True
        )
    commit = info.sha or ""
    if not re.fullmatch(_COMMIT, commit):
        raise WeightsError(
            f"{api.endpoint} returned {commit!r} as the commit of {reference}, expected 40 hex digits: check the "
            "environment variable HF_ENDPOINT (address of the hub)"
        )
    files = _select(reference, info.siblings or [])
    folder = reference.folder / commit
    shutil.rmtree(folder, ignore_errors=True)  # incomplete or damaged, else it would have been found
    with new_folder(folder) as temporary:
        hashes = _download(api, reference, commit, files, temporary, progress)
        manifest = {
            "repository": reference.repository,
            "commit": commit,
            "licence": _licence(info),
            "files": [
                {"name": file.rfilename, "sha256": sha256, "size_bytes": file.size}
                for file, sha256 in zip(files, hashes, strict=True)
            ],
        }
        write_json(temporary / MANIFEST, manifest)
    write_json(reference.folder / REVISIONS, {**_read_revisions(reference.folder), reference.revision: commit})
    return _read_model(folder)


def _read_model(folder: Path) -> HubWeights:
    try:
        manifest = read_model(folder / MANIFEST, _HubManifest)
    except DataError as error:
        raise WeightsError(f"{error}: remove {folder}, and fetch the model again") from None
    files = tuple(WeightsFile(file.name, file.sha256, file.size_bytes) for file in manifest.files)
    name = f"{PREFIX}{manifest.repository}@{manifest.commit}"
    source = Download((f"https://huggingface.co/{manifest.repository}/resolve/{manifest.commit}",))
    return HubWeights(name, manifest.licence, files, source, folder=folder)


def _read_revisions(folder: Path) -> dict[str, str]:
    """Return the commit of each downloaded revision of a model. Raises WeightsError."""
    path = folder / REVISIONS
    try:
        revisions: dict[str, str] = read_as(path, dict[str, str]) if path.is_file() else {}
    except DataError as error:
        raise WeightsError(f"{error}: remove {path}, and fetch the model again") from None
    return revisions


def _select(reference: HubReference, files: Sequence[Any]) -> list[Any]:
    """Return the files of a repository to download: weights as safetensors, configurations and vocabularies."""
    names = {file.rfilename for file in files}
    weights = {name for name in names if _WEIGHTS.fullmatch(name)}
    if "config.json" not in names or not weights:
        missing = "no config.json" if "config.json" not in names else "no model.safetensors"
        raise WeightsError(
            f"the model {reference} has {missing}, expected both config.json and model.safetensors (other formats can "
            "execute code): choose another model, or a revision of this model with both files (hf:ORG/MODEL@REVISION)"
        )
    texts = {name for name in names if re.fullmatch(r"[\w.-]+", name) and name.endswith(_TEXTS) and name != MANIFEST}
    return sorted((file for file in files if file.rfilename in weights | texts), key=lambda file: file.rfilename)


def _download(
    api: Any, reference: HubReference, commit: str, files: Sequence[Any], folder: Path, progress: ByteProgress
) -> list[str]:
    """Download files to a folder and return the sha256 (hex) of each file.

    Raises:
        WeightsError: The download failed, or the hash of a file differs from the hash that the hub states.
    """
    total, before, hashes = sum(file.size for file in files), 0, []
    for file in files:
        progress(before, total)
        bar = _progress_bar(partial(_report, progress, before, total))
        with _explaining(reference, api.endpoint):
            path = Path(
                api.hf_hub_download(
                    reference.repository, file.rfilename, revision=commit, local_dir=folder, tqdm_class=bar
                )
            )
        hashes.append(file_sha256(path))
        received, expected = (hashes[-1], file.lfs.sha256) if file.lfs else (_git_hash(path), file.blob_id)
        if received != expected:
            raise WeightsError(
                f"the downloaded file {file.rfilename} of {reference} has the hash {received}, expected {expected}: "
                "try again"
            )
        before += file.size
    progress(total, total)
    shutil.rmtree(folder / ".cache", ignore_errors=True)  # of huggingface_hub
    return hashes


def _report(progress: ByteProgress, before: int, total: int, received: int) -> None:
    progress(min(before + received, total), total)


def _progress_bar(report: Callable[[int], None]) -> type:
    """Return a progress bar for huggingface_hub that prints nothing and reports the number of received bytes."""
    from huggingface_hub.utils import tqdm

    class ByteCounter(tqdm):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **{**kwargs, "disable": True})
            self._received = 0

        def update(self, n: float | None = 1) -> None:
            self._received += int(n or 0)
            report(self._received)

    return ByteCounter


def _git_hash(path: Path) -> str:
    """Return the hash (hex) of a file's content in git, which the hub states for small files."""
    content = path.read_bytes()
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def _licence(info: Any) -> str:
    """Return the licence that the model's card states."""
    licence = getattr(info.card_data, "license", None)
    return str(licence) if licence else "not stated on the hub"


@contextmanager
def _explaining(reference: HubReference, endpoint: str) -> Iterator[None]:
    """Replace the exceptions of huggingface_hub by a WeightsError of one line."""
    from huggingface_hub import errors

    try:
        yield
    except errors.GatedRepoError:
        raise WeightsError(
            f"the model {reference} is restricted to registered users: accept its terms at "
            f"{endpoint}/{reference.repository}, and set the environment variable HF_TOKEN to your access token"
        ) from None
    except errors.RepositoryNotFoundError:
        raise WeightsError(
            f"{endpoint} has no public model {reference.repository}, expected a public model as hf:ORG/MODEL: check "
            "the name"
        ) from None
    except errors.RevisionNotFoundError:
        raise WeightsError(
            f"{endpoint}/{reference.repository} has no revision {reference.revision!r}, "
            "expected a branch, tag or commit"
        ) from None
    except Exception as error:  # the exceptions of its HTTP client have no common base class
        reason = shorten(one_line(error), 120) or type(error).__name__
        raise WeightsError(
            f"cannot download the model {reference} from {endpoint} ({reason}): download it on another machine and "
            f"copy the folder {reference.folder} to this machine, or use a local folder of the model"
        ) from None
