"""Reading a site file: everything is checked at the door, and everything wrong is said at once."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from fieldlink.registers import Tag
from fieldlink.site.errors import Problem, SiteError, nearest
from fieldlink.site.models import SiteFile
from fieldlink.site.register_map import read_register_map
from fieldlink.site.resolved import Site
from fieldlink.site.rules import find_problems
from fieldlink.site.toml_source import TomlSource

__all__ = ["load_site", "schema"]


def load_site(path: str | Path) -> Site:
    """Read a site file and the files it names.

    Raises:
        SiteError: with every problem found, its file, line or key, value and remedy.
    """
    source = TomlSource(Path(path))
    file = _validate(source)
    maps, problems = _read_maps(source, file)
    site = Site(source.path, file, maps)
    problems.extend(find_problems(site, source))
    if problems:
        raise SiteError(problems)
    return site


def schema() -> dict[str, Any]:
    """Return the JSON Schema of a site file."""
    return SiteFile.model_json_schema()


def _validate(source: TomlSource) -> SiteFile:
    # As JSON, because only there strict types and TOML agree: arrays make tuples, strings make
    # paths, and neither "5" nor true is a number. A date becomes a string and is refused as one.
    text = json.dumps(source.data, default=str)
    try:
        return SiteFile.model_validate_json(text, strict=True)
    except ValidationError as error:
        raise SiteError(_problem(source, detail) for detail in error.errors()) from error


def _read_maps(
    source: TomlSource, file: SiteFile
) -> tuple[dict[str, Mapping[str, Tag]], list[Problem]]:
    maps: dict[str, Mapping[str, Tag]] = {}
    problems: list[Problem] = []
    for name, device in file.devices.items():
        if device.register_map is None:
            continue
        try:
            maps[name] = read_register_map(
                source.path.parent / device.register_map,
                word_order=device.word_order,
                byte_order=device.byte_order,
            )
        except SiteError as error:
            problems.extend(error.problems)
    return maps, problems


def _problem(source: TomlSource, detail: ErrorDetails) -> Problem:
    key, kind, value = detail["loc"], detail["type"], detail["input"]
    model, field = _find_field(key)
    if kind == "extra_forbidden":
        return source.problem(key, "unknown key", nearest(str(key[-1]), model.model_fields))
    if kind == "missing":
        return source.problem(key, "is missing", f"add it{_meaning(field)}")
    if kind == "too_short":
        return source.problem(key, "is empty", f"give at least one{_meaning(field)}")
    if kind == "value_error":
        message, _, remedy = detail["msg"].removeprefix("Value error, ").partition("; ")
        return source.problem(key, message, remedy)
    if kind == "literal_error" and field is not None:
        return source.problem(key, f"{value!r} is unknown", nearest(str(value), _choices(field)))
    shown = repr(value) if not isinstance(value, dict | list) else f"a {type(value).__name__}"
    message = f"{shown}: {detail['msg'].replace('Input should', 'should')}"
    return source.problem(key, message, f"correct it{_meaning(field)}")


def _find_field(key: tuple[str | int, ...]) -> tuple[type[BaseModel], FieldInfo | None]:
    """Return the table that holds ``key`` and the field the key is of, None for an unknown key."""
    table: type[BaseModel] = SiteFile
    inner: type[BaseModel] | None = SiteFile
    field: FieldInfo | None = None
    name_comes = False
    for part in key:
        if name_comes:
            name_comes = False
            continue
        if inner is None:
            break
        table = inner
        field = table.model_fields.get(str(part))
        if field is None:
            return table, None
        inner = _model_of(field)
        name_comes = get_origin(field.annotation) is Mapping
    return table, field


def _model_of(field: FieldInfo) -> type[BaseModel] | None:
    for candidate in (field.annotation, *get_args(field.annotation)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None


def _choices(field: FieldInfo) -> list[str]:
    options = [field.annotation, *get_args(field.annotation)]
    literals = [option for option in options if get_origin(option) is Literal]
    return [name for literal in literals for name in get_args(literal)]


def _meaning(field: FieldInfo | None) -> str:
    """Return what the key means, in brackets."""
    if field is None or field.description is None:
        return ""
    return f" ({field.description.rstrip('.')})"
