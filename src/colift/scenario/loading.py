"""Conversion of a YAML file to settings, or to all its errors, each with its line."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from colift.runtime import bounded_read
from colift.scenario import from_csv, from_table, from_urdf, plugins, validation, yaml_tree
from colift.scenario.cross_checks import consistency_errors
from colift.scenario.errors import ErrorMessage, Location, ScenarioError, format_value, suggestion
from colift.scenario.from_csv import WaypointsFromFile
from colift.scenario.from_table import SampledFromFile
from colift.scenario.from_urdf import AgentTypeFromUrdf
from colift.scenario.migration import SCHEMA
from colift.scenario.schema import Scenario, Section
from colift.scenario.shipped import SUFFIXES, shipped_names, shipped_text

SCENARIO_ADAPTER = TypeAdapter(Scenario)  # validation of plain data


def load_scenario(name_or_path: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """Load a shipped scenario by name, or a YAML file by path.

    Args:
        name_or_path: Name of a shipped scenario, or path of a file.
        overrides: Settings that replace those of the file before validation, such as `payload.mass_kg=2`.

    Returns:
        The settings.

    Raises:
        ScenarioError: If the name is unknown, the file cannot be read, or the file contains errors. The message has one
            line per error, `file:line: path [unit]: allowed values`, or `--set path ...` for an override.
    """
    given = str(name_or_path)
    if given in shipped_names():
        return resolve(_shipped(given, 0), overrides)
    file = given if len(given) <= 200 else f"{given[:200]}..."
    try:
        path = Path(given).expanduser()
        if not given or (path.suffix not in SUFFIXES and not path.exists()):
            raise _unknown(given)
        raw = bounded_read.read_bytes(path, 4 * yaml_tree.MAX_BYTES)
        return parse(raw.decode("utf-8-sig"), file, overrides)
    except OSError as error:
        raise ScenarioError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise ScenarioError(f"{file}:{line}: cannot be read: not UTF-8 text (byte {error.start})") from None
    except ScenarioError:
        raise
    except (ValueError, RuntimeError) as error:  # a NUL in the path, or an unknown home directory
        raise ScenarioError(f"{format_value(given)}: cannot be read: {error}") from None


def _unknown(given: str) -> ScenarioError:
    return ScenarioError(
        f"there is no scenario {format_value(given)} (shipped: {', '.join(shipped_names())}; "
        f"or the path of a .yaml file){suggestion(given, shipped_names())}"
    )


def parse(text: str, file: str, overrides: Sequence[str] = ()) -> Scenario:
    """Parse the text of a scenario.

    Args:
        text: YAML text.
        file: Name of the file, for messages.
        overrides: As in `load_scenario`.

    Returns:
        The settings.

    Raises:
        ScenarioError: As in `load_scenario`.
    """
    return resolve(_whole(text, file), overrides)


def resolve(tree: yaml_tree.Tree, overrides: Sequence[str] = ()) -> Scenario:
    """Convert the data of a scenario to settings.

    Args:
        tree: Data of the whole scenario, without its entry ``schema``.
        overrides: As in `load_scenario`.

    Returns:
        The settings.

    Raises:
        ScenarioError: As in `load_scenario`.
    """
    tree = functools.reduce(yaml_tree.with_setting, overrides, tree)
    folder = Path(tree.file).parent
    data, from_files = _expanded(tree.data, folder)
    unread = {location[: 2 if location[0] == "agent_types" else 1] for location, _ in from_files}
    found: dict[Location, list[str | ErrorDetails]] = {}
    for location, message in (*tree.errors, *from_files):
        found.setdefault(location, []).append(message)
    try:
        with plugins.plugin_path(folder):
            settings = SCENARIO_ADAPTER.validate_python(data)
    except ValidationError as error:
        invalid = [e for e in validation.errors(error) if not {e["loc"][:1], e["loc"][:2]} & unread]
        _add(found, [(validation.location(data, e["loc"], e["type"]), e) for e in invalid])
        # pydantic checks consistency only if all sections are valid; check it here as well
        _add(found, [] if unread else consistency_errors(data))
    else:
        if not found:
            for name in _types_from_files(tree.data):
                settings.agent_types[name].mark_as_from_file()
            return settings
    raise _scenario_error(found, tree)


MAX_INHERITANCE_DEPTH = 4  # files that extend one another


def _whole(text: str, file: str, depth: int = 0) -> yaml_tree.Tree:
    """Return the data of a text, merged with the scenario that it extends."""
    tree = _of_schema_2(yaml_tree.read(text, file))
    base = tree.data.get("extends")
    if base is None:
        return tree
    at = tree.at(("extends",))
    if not isinstance(base, str):
        raise ScenarioError(f"{at} extends: must be the name of a shipped scenario or the path of a .yaml file")
    if depth == MAX_INHERITANCE_DEPTH:
        raise ScenarioError(f"{at} extends: {MAX_INHERITANCE_DEPTH} files that extend one another are the limit")
    if base in shipped_names():
        return yaml_tree.diff_tree(_shipped(base, depth + 1), tree)
    path = Path(file).parent / base
    try:
        base_text = bounded_read.read_text(path, 4 * yaml_tree.MAX_BYTES) if path.suffix in SUFFIXES else None
    except (OSError, ValueError) as error:
        raise ScenarioError(f"{at} extends: {format_value(base)} cannot be read: {error}") from None
    if base_text is None:
        raise ScenarioError(f"{at} extends: {_unknown(base)}")
    return yaml_tree.diff_tree(_whole(base_text, str(path), depth + 1), tree)


@functools.cache  # reading the text takes 15 ms, five times as long as its validation
def _shipped(name: str, depth: int) -> yaml_tree.Tree:
    """Return the data of a shipped scenario, merged with the scenario that it extends."""
    return _whole(shipped_text(name), f"{name}.yaml", depth)


def _of_schema_2(tree: yaml_tree.Tree) -> yaml_tree.Tree:
    """Return the tree without its entry ``schema``; refuse a file of another schema."""
    if (stated := tree.data.get("schema")) != SCHEMA:
        found = "states none" if stated is None else f"states {format_value(stated)}"
        raise ScenarioError(
            f"{tree.at(('schema',))} schema: must be {SCHEMA}; the file {found}. "
            f"`colift migrate {tree.file}` rewrites a file of schema 1"
        )
    return dataclasses.replace(tree, data={key: value for key, value in tree.data.items() if key != "schema"})


def _add(found: dict[Location, list[str | ErrorDetails]], more: Sequence[tuple[Location, str | ErrorDetails]]) -> None:
    """Add errors at locations that have none yet; consequences of an error are omitted."""
    known_locations = set(found)
    for location, message in more:
        if location not in known_locations:
            found.setdefault(location, []).append(message)


def _scenario_error(found: dict[Location, list[str | ErrorDetails]], tree: yaml_tree.Tree) -> ScenarioError:
    """Return an exception with the first errors in the order of the file, each once."""
    schema = validation.schema_of(Scenario)
    lines, count = [], sum(len(message) for message in found.values())
    ordered = sorted(
        ((location, message) for location in found for message in found[location]), key=lambda it: tree.line(it[0])
    )
    for location, message in ordered[: validation.MAX_MESSAGES]:
        text = message if isinstance(message, str) else validation.error_message(message, schema)
        lines.append(f"{tree.at(location)} {validation.location_label(location, schema)}: {text}")
    return ScenarioError("\n".join([*dict.fromkeys(lines), *validation.truncation_note(count)]))


def _expanded(data: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[ErrorMessage]]:
    """Return the data with the content of other files in plain numbers, and the errors in these files."""
    kinds, path, errors = data.get("agent_types"), data.get("reference"), []
    if isinstance(kinds, dict):
        written = dict(kinds)
        for name, kind in kinds.items():
            if isinstance(kind, dict) and "urdf" in kind:
                written[name], found = _read(AgentTypeFromUrdf, from_urdf.expand, kind, folder)
                errors += [(("agent_types", name, *location), message) for location, message in found]
        data = data | {"agent_types": written}
    if isinstance(path, dict) and path.get("kind") in ("waypoints", "sampled"):
        expanded, found = path, []
        if path["kind"] == "waypoints" and "file" in path:
            expanded, found = _read(WaypointsFromFile, from_csv.expand, path, folder)
        elif path["kind"] == "sampled" and "tables" not in path:
            expanded, found = _read(SampledFromFile, from_table.expand, path, folder)
        errors += [(("reference", *location), message) for location, message in found]
        data = data | {"reference": expanded}
    return data, errors


def _types_from_files(data: dict[str, Any]) -> list[str]:
    """Return the names of the agent types that refer to a file."""
    kinds = data.get("agent_types")
    return [name for name, kind in kinds.items() if "urdf" in kind] if isinstance(kinds, dict) else []


G = TypeVar("G", bound=Section)


def _read(
    section: type[G],
    expand: Callable[[G, Path], tuple[dict[str, Any], list[ErrorMessage]]],
    written: dict[str, Any],
    folder: Path,
) -> tuple[dict[str, Any], list[ErrorMessage]]:
    """Return a section that refers to a file in plain numbers, and its errors; the result is not validated."""
    try:
        return expand(TypeAdapter(section).validate_python(written), folder)
    except ValidationError as error:
        return written, validation.validation_messages(error, section, written)[: validation.MAX_MESSAGES]
