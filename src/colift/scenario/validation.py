"""Messages for validation errors of pydantic: location, allowed values, given value."""

from __future__ import annotations

import contextlib
import functools
import re
from collections.abc import Generator, Sequence
from typing import Any, Literal

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from colift.scenario.errors import ErrorMessage, Location, ScenarioError, format_value, suggestion
from colift.scenario.former_settings import relocation_hint
from colift.scenario.schema_docs import Schema, format_range, unit_of

MAX_MESSAGES = 100  # mistakes that one message lists

MESSAGE_TEMPLATES = {
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "int_parsing": "must be a whole number",
    "bool_parsing": "must be true or false",
    "bool_type": "must be true or false",
    "finite_number": "must be finite",
    "int_type": "must be a whole number",
    "string_type": "must be text",
    "tuple_type": "must be a list",
    "dict_type": "must be settings by name",
    "model_type": "must be settings by name",
    "model_attributes_type": "must be settings by name",
    "string_pattern_mismatch": "must be a name: a letter, then letters, digits, - or _",
    "json_invalid": "must be JSON ({error})",
    "string_too_long": "must have at most {max_length} characters",
    "greater_than": "must exceed {gt:g}",  # of a user-defined part; built-in settings state range and reason
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
}


@contextlib.contextmanager
def raise_scenario_errors(model: type[BaseModel]) -> Generator[None]:
    """Convert pydantic errors to ScenarioError, one line per error: `path [unit]: allowed values`."""
    try:
        yield
    except ValidationError as error:
        schema, found = schema_of(model), errors(error)
        lines = [
            f"{location_label(_without_variants(schema, e['loc']), schema)}: {error_message(e, schema)}"
            for e in found[:MAX_MESSAGES]
        ]
        raise ScenarioError("\n".join([*dict.fromkeys(lines), *truncation_note(len(found))])) from None


def errors(error: ValidationError) -> list[ErrorDetails]:
    """Return the errors of pydantic, except for lists that are too short only because invalid entries were omitted."""
    return [
        e
        for e in error.errors(include_url=False)
        if e["type"] != "too_short" or len(e["input"]) < e.get("ctx", {})["min_length"]
    ]


def validation_messages(error: ValidationError, model: type[BaseModel], data: Any) -> list[ErrorMessage]:
    """Convert the errors of pydantic in the data of a model to messages, by location in the data."""
    schema = schema_of(model)
    return [(location(data, e["loc"], e["type"]), error_message(e, schema)) for e in errors(error)]


def truncation_note(count: int) -> list[str]:
    """Return a last line if there are more errors than are listed."""
    return [f"and {count - MAX_MESSAGES} more errors"] if count > MAX_MESSAGES else []


@functools.cache
def schema_of(model: type[BaseModel]) -> Schema:
    """Return the schema of a model; it is cached."""
    return Schema(model)


def as_validation_error(
    messages: Sequence[ErrorMessage], kind: Literal["mistake", "worded"] = "mistake"
) -> ValidationError:
    """Convert messages to a pydantic error: `mistake` between sections, `worded` for a message within a section."""
    return ValidationError.from_exception_data(
        "Settings",
        [
            InitErrorDetails(type=PydanticCustomError(kind, "{message}", {"message": text}), loc=loc, input=None)
            for loc, text in messages
        ],
    )


def location(data: Any, loc: tuple[int | str, ...], kind: str) -> Location:
    """Return the location of an error in the data: a pydantic location without the variants of unions."""
    if kind == "mistake":  # of a consistency check; the setting may be absent
        return loc
    found: list[int | str] = []
    for i, key in enumerate(loc):
        listed = isinstance(data, list) and isinstance(key, int) and 0 <= key < len(data)
        if listed or (isinstance(data, dict) and key in data):
            data = data[key]
        elif i < len(loc) - 1 or kind not in ("missing", "worded"):
            continue
        found.append(key)
    return tuple(found)


def location_label(at: Location, schema: Schema) -> str:
    """Format a location as `path [unit]`."""
    path = "".join(f".{key}" if isinstance(key, str) and _plain(key) else f"[{format_value(key)}]" for key in at)
    unit = unit_of(schema.at(at), at)
    return f"{path.lstrip('.') or 'scenario'}{f' [{unit}]' if unit else ''}"


def _plain(key: str) -> bool:
    return key.replace("-", "_").replace("_", "a").isalnum() and key.isascii() and len(key) <= 60


def error_message(error: ErrorDetails, schema: Schema) -> str:
    """Describe an error and the allowed values; other errors keep the message of pydantic."""
    kind, given, about = error["type"], error["input"], error.get("ctx", {})
    last = error["loc"][-1] if error["loc"] else ""
    if kind == "extra_forbidden":
        if (hint := relocation_hint(error["loc"], given)) is not None:
            return hint
        allowed = schema.sibling_settings(error["loc"])
        return "is not a setting here" + (suggestion(last, allowed) or f"; known: {', '.join(allowed)}")
    if kind == "missing":
        return "is required" if isinstance(last, str) else f"is missing: the list must have more than {last} values"
    if kind in ("union_tag_invalid", "literal_error"):
        allowed = re.findall("'([^']*)'", str(about.get("expected_tags", about.get("expected"))))
        tag = about.get("tag", given)
        key = f"{about['discriminator']} ".replace("'", "") if "discriminator" in about else ""
        return f"{key}must be one of {', '.join(allowed)}, got {format_value(tag)}{suggestion(tag, allowed)}"
    if kind == "union_tag_not_found":
        return f"{str(about['discriminator']).strip(chr(39))} is required: it selects the variant"
    if kind in ("mistake", "worded", "value_error"):
        return str(about.get("message", about.get("error")))
    return _requirement(error, schema) + f", got {format_value(given)}"


def _requirement(error: ErrorDetails, schema: Schema) -> str:
    kind, about = error["type"], error.get("ctx", {})
    node = schema.leaf(error["loc"])
    if "why" in node and kind.startswith(("greater_than", "less_than")):
        return f"must be {format_range(node)} ({node['why']})"
    if kind in ("too_long", "too_short"):
        size = about.get("max_length", about.get("min_length", 0))
        return f"must have {'at most' if kind == 'too_long' else 'at least'} {size} value{'s' * (size != 1)}"
    return MESSAGE_TEMPLATES.get(kind, f"is not allowed ({kind.replace('_', ' ')})").format(**about)


def _without_variants(schema: Schema, loc: tuple[int | str, ...]) -> Location:
    """Return a pydantic location without the variants of unions."""
    return tuple(key for i, key in enumerate(loc) if not schema.is_variant(loc[:i], key))
