"""Identity of configured components: their settings, versions, and the content of the files that they read.

Results are cached under this identity. It is computed from class attributes and settings, without running a component.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import core_schema, to_jsonable_python

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import ConfigError, DataError, WeightsError, shorten
from salframe.framework.files.bounded import why
from salframe.framework.files.hashes import digest, file_sha256
from salframe.framework.files.onnx_files import SUFFIX, external_files

if sys.platform == "win32":
    from pathlib import WindowsPath as _Path
else:
    from pathlib import PosixPath as _Path

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler

MAX_FOLDER_FILES, MAX_FOLDER_BYTES = 10_000, 1 << 32
"""Maximum number and total size of the files in a folder that a setting names. All of them are hashed."""


class UserFile(_Path):
    """Type of a setting that names a file or folder of the user. `identity` uses the content, not the name."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        paths = core_schema.union_schema([core_schema.str_schema(min_length=1), core_schema.is_instance_schema(Path)])
        return core_schema.no_info_after_validator_function(
            cls._checked, paths, serialization=core_schema.to_string_ser_schema()
        )

    @classmethod
    def _checked(cls, path: str | Path) -> UserFile:
        """Return the path. Raises ValueError if the path is invalid on this file system, for example too long."""
        checked = cls(path)
        try:
            checked.exists()
        except OSError as error:
            raise ValueError(
                f"cannot read the path {shorten(str(path))}: {why(error)}, expected a readable file or folder"
            ) from None
        return checked


class SingleFile(UserFile):
    """Type of a setting that names a file of the user. `identity` rejects a folder, which could be large to hash."""


def identity(config: ComponentConfig, *, describing: bool = False) -> dict[str, Any]:
    """Return the identity of a configured component.

    The identity is JSON-serializable. It has the role, name, version and settings of the component, and the identities
    of the components in its slots. It has the sha256 of every UserFile in the settings and of the weights in use.

    Args:
        config: The configuration.
        describing: Whether to leave out the settings that affect only matching. The result then identifies the
            descriptions (features) that the component computes from panoramas.

    Raises:
        ConfigError: A file cannot be read.
    """
    component = config.component
    component_id = {"role": component.role, "name": component.name, "version": component.version}
    weights = [file.sha256 for network in component.weights_in_use(config) for file in network.files]
    return {
        **component_id,
        "settings": settings_identity(config, describing=describing),
        **({"weights": weights} if weights else {}),
    }


def matters_to_matching_only(field: FieldInfo) -> bool:
    """Return whether a setting is declared `match_only`, so that descriptions (features) of panoramas do not depend on
    it."""
    extra = field.json_schema_extra
    return isinstance(extra, Mapping) and bool(extra.get("match_only"))


def matching_settings(model: BaseModel) -> dict[str, Any]:
    """Return the settings that affect only matching (declared `match_only`) and differ from their defaults."""
    fields = type(model).model_fields.items()
    match_fields = {name: field for name, field in fields if matters_to_matching_only(field)}
    values = {name: getattr(model, name) for name in match_fields}
    return {name: _value(value, False) for name, value in values.items() if value != match_fields[name].get_default()}


def has_added_default(field: FieldInfo, value: Any) -> bool:
    """Return whether a setting was added after the first release of its component (see `added`), and has its default
    value."""
    extra = field.json_schema_extra
    return isinstance(extra, Mapping) and bool(extra.get("added")) and value == field.default


def settings_identity(model: BaseModel, *, describing: bool = False) -> dict[str, Any]:
    """Return the settings of a component in the form in which `identity` contains them.

    Files are replaced by their hashes and slots by the identities of their components.

    Args:
        model: The settings.
        describing: Whether to leave out the settings that affect only matching.

    Raises:
        ConfigError: A file cannot be read.
    """
    settings = {}
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if (
            name != "kind"
            and not (describing and matters_to_matching_only(field))
            and not has_added_default(field, value)
        ):
            settings[name] = _value(value, describing)
    return settings


def _value(value: Any, describing: bool) -> Any:
    """Return a JSON-serializable form of the value of a setting, for the cache key."""
    if isinstance(value, ComponentConfig):
        return identity(value, describing=describing)
    if isinstance(value, BaseModel):
        return settings_identity(value, describing=describing)
    if isinstance(value, SingleFile) and value.is_dir():
        raise ConfigError(f"the path {value} is a folder, expected a file: change the setting that has this path")
    if isinstance(value, UserFile):
        return content_sha256(value) or str(value)
    if isinstance(value, Mapping):
        return {str(key): _value(part, describing) for key, part in value.items()}
    if isinstance(value, tuple | list):
        return [_value(part, describing) for part in value]
    if isinstance(value, set | frozenset):  # the order of a set differs between processes
        return sorted((_value(part, describing) for part in value), key=lambda part: json.dumps(part, sort_keys=True))
    return to_jsonable_python(value)


def content_sha256(path: Path) -> str | None:
    """Return the sha256 (hex) of a file, or of the names and contents of all files in a folder.

    The hash of an ONNX file with external data includes the other files. Returns None if there is no file or folder of
    this name.

    Raises:
        ConfigError: A file cannot be read, or a folder holds too many or too large files.
    """
    try:
        if path.is_file():
            external = external_files(path) if path.suffix.lower() == SUFFIX else ()
            sha256 = file_sha256(path)
            return digest([sha256, _hash_files(path.parent, external)]) if external else sha256
        if not path.is_dir():
            return None
        return digest(_hash_files(path, sorted(_list_files(path))))
    except (DataError, WeightsError) as error:
        raise ConfigError(str(error)) from None
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read the file or folder {path}: {why(error)}") from None


def _hash_files(folder: Path, files: Sequence[Path]) -> list[list[str]]:
    return [[file.relative_to(folder).as_posix(), file_sha256(file)] for file in files]


def _list_files(folder: Path) -> list[Path]:
    """Return all files below a folder, without reading them. Raises ConfigError if they are too many or too large."""
    files, size = [], 0
    for file in folder.rglob("*"):
        if file.is_file():
            files.append(file)
            size += file.stat().st_size
        if len(files) > MAX_FOLDER_FILES or size > MAX_FOLDER_BYTES:
            raise ConfigError(
                f"a setting has the path of the folder {folder}, which contains more than {MAX_FOLDER_FILES} files or "
                f"{MAX_FOLDER_BYTES >> 30} GiB: set it to the path of the required file, or of a folder with only the "
                "required files"
            )
    return files
