"""Settings: frozen models that refuse what they do not know.

Defaults are overruled by a YAML file, and both by flags. An unknown key is an error that
names the nearest valid one, because a misspelt setting that is ignored gives a wrong result
that looks right.
"""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from percept.core.errors import ConfigError

__all__ = ["Settings", "load_settings", "load_yaml_mapping", "parse_settings"]

_Model = TypeVar("_Model", bound=BaseModel)
_LARGEST_FILE_BYTES = 4 * 1024 * 1024


class Settings(BaseModel):
    """Base of all settings: frozen, and unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def load_settings(
    model: type[_Model], path: Path | None, overrides: dict[str, Any] | None = None
) -> _Model:
    """Resolve settings: defaults, then the file, then the overrides (flags).

    Args:
        model: The settings class.
        path: A YAML file, or None.
        overrides: Nested values that win over the file; None values are left out.

    Raises:
        ConfigError: If the file is not YAML, or a key or value is not valid.
    """
    values = load_yaml_mapping(path) if path is not None else {}
    return parse_settings(model, _merged(values, overrides or {}), where=path or "settings")


def load_yaml_mapping(path: Path) -> dict[str, Any]:
    """Read a YAML file that holds a mapping, with the safe loader.

    Raises:
        ConfigError: If the file is missing, too large, or no YAML mapping.
    """
    try:
        if path.stat().st_size > _LARGEST_FILE_BYTES:
            raise ConfigError("too large for a settings file", where=path)
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot be read ({error})", where=path) from error
    try:
        values = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError) as error:
        reason = str(error).replace("\n", " ")
        raise ConfigError(f"is not YAML ({reason})", where=path) from error
    if values is None:
        return {}
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        raise ConfigError("must hold a mapping of names to values", where=path)
    return values


def parse_settings(model: type[_Model], values: dict[str, Any], where: object) -> _Model:
    """Validate plain values against a settings class.

    Raises:
        ConfigError: With the first thing that is wrong, and the nearest key where a key is.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place, models = _resolve(model, first["loc"])
        if first["type"] != "extra_forbidden":
            raise ConfigError(f"'{place}': {first['msg'].lower()}", where=where) from error
        valid = sorted({key for found in models for key in found.model_fields})
        near = difflib.get_close_matches(str(first["loc"][-1]), valid, n=1, cutoff=0.0)
        remedy = f"Did you mean '{near[0]}'? Valid keys: {', '.join(valid)}" if near else None
        raise ConfigError(f"unknown key '{place}'", where=where, remedy=remedy) from error


def _resolve(
    model: type[BaseModel], path: tuple[int | str, ...]
) -> tuple[str, list[type[BaseModel]]]:
    """Return a place as a person writes it, and the classes whose keys are valid there.

    Pydantic's path names the chosen member of a tagged union too; that part narrows the
    classes and is left out of the text.
    """
    models: list[type[BaseModel]] = [model]
    parts: list[str] = []
    for part in path:
        tagged = [m for m in models if _has_tag(m, part)]
        if tagged and len(models) > 1:
            models = tagged
            continue
        parts.append(str(part))
        below = [
            found
            for m in models
            if part in m.model_fields
            for found in _models_in(m.model_fields[str(part)].annotation)
        ]
        models = below or models
    return ".".join(parts), models


def _has_tag(model: type[BaseModel], tag: int | str) -> bool:
    return any(tag in get_args(field.annotation) for field in model.model_fields.values())


def _models_in(annotation: object) -> list[type[BaseModel]]:
    """Return the settings classes that an annotation mentions, at any depth."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for inner in get_args(annotation) for found in _models_in(inner)]


def _merged(values: dict[str, Any], overrides: dict[str, Any]) -> dict[str, Any]:
    merged = dict(values)
    for key, value in overrides.items():
        if value is None:
            continue
        if isinstance(value, dict):
            below = merged.get(key)
            merged[key] = _merged(below if isinstance(below, dict) else {}, value)
        else:
            merged[key] = value
    return merged
