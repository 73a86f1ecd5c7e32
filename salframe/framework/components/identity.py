"""What a configured component is known by: settings, versions, and the content of the files it reads. Follows from how
it is declared."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import core_schema, to_jsonable_python

from salframe.framework.component import ComponentConfig
from salframe.framework.errors import ConfigError, DataError
from salframe.framework.files.bounded import why
from salframe.framework.files.hashes import digest, file_sha256

if sys.platform == "win32":
    from pathlib import WindowsPath as _Path
else:
    from pathlib import PosixPath as _Path

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler


class UserFile(_Path):
    """A setting that names a file or folder of the user's: its content, not its name, is part of the identity."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        paths = core_schema.union_schema([core_schema.str_schema(min_length=1), core_schema.is_instance_schema(Path)])
        return core_schema.no_info_after_validator_function(
            cls, paths, serialization=core_schema.to_string_ser_schema()
        )


def identity(config: ComponentConfig, *, describing: bool = False) -> dict[str, Any]:
    """What a configured component is known by: role, name, version, settings (those of its slots included), the sha256
    of every UserFile among them and of the weights in use.

    `describing`: without the settings that matter to matching only, so what a description of a panorama depends on.
    """
    component = config.component
    known = {"role": component.role, "name": component.name, "version": component.version}
    weights = [file.sha256 for used in component.weights_in_use(config) for file in used.files]
    return {
        **known,
        "settings": settings_identity(config, describing=describing),
        **({"weights": weights} if weights else {}),
    }


def matters_to_matching_only(field: FieldInfo) -> bool:
    """Whether a setting is declared `match_only`: descriptions of panoramas do not depend on it."""
    extra = field.json_schema_extra
    return isinstance(extra, Mapping) and bool(extra.get("match_only"))


def matching_settings(model: BaseModel) -> dict[str, Any]:
    """The settings declared `match_only` whose values are not the defaults."""
    fields = type(model).model_fields.items()
    declared = {name: field for name, field in fields if matters_to_matching_only(field)}
    values = {name: getattr(model, name) for name in declared}
    return {name: _value(values[name], False) for name in declared if values[name] != declared[name].get_default()}


def is_as_before(field: FieldInfo, value: Any) -> bool:
    """Whether a setting is declared `added` and has its default."""
    extra = field.json_schema_extra
    return isinstance(extra, Mapping) and bool(extra.get("added")) and value == field.default


def settings_identity(model: BaseModel, *, describing: bool = False) -> dict[str, Any]:
    """What a model of settings is known by, as in `identity`: its settings, files by their content, slots by the
    identity of the component in them. Raises ConfigError on a file that cannot be read."""
    chosen = {}
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if name != "kind" and not (describing and matters_to_matching_only(field)) and not is_as_before(field, value):
            chosen[name] = _value(value, describing)
    return chosen


def _value(value: Any, describing: bool) -> Any:
    if isinstance(value, ComponentConfig):
        return identity(value, describing=describing)
    if isinstance(value, BaseModel):
        return settings_identity(value, describing=describing)
    if isinstance(value, UserFile):
        return content_sha256(value) or str(value)
    if isinstance(value, Mapping):
        return {str(key): _value(part, describing) for key, part in value.items()}
    if isinstance(value, tuple | list):
        return [_value(part, describing) for part in value]
    if isinstance(value, set | frozenset):  # their order is another one in every process
        return sorted((_value(part, describing) for part in value), key=lambda part: json.dumps(part, sort_keys=True))
    return to_jsonable_python(value)


def content_sha256(path: Path) -> str | None:
    """Sha256 (hex) of a file, or of the names and contents of all files in a folder; None where there is neither.

    Raises ConfigError where it cannot be read.
    """
    try:
        if path.is_file():
            return file_sha256(path)
        if not path.is_dir():
            return None
        inside = sorted(file for file in path.rglob("*") if file.is_file())
        return digest([[file.relative_to(path).as_posix(), file_sha256(file)] for file in inside])
    except DataError as error:
        raise ConfigError(str(error)) from None
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read {path}: {why(error)}") from None
