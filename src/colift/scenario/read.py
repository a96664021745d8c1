"""From a YAML file to settings, or to every mistake in it at once, each with its line."""

from __future__ import annotations

import difflib
import math
import re
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from colift.scenario.describe import Schema, unit_of
from colift.scenario.from_urdf import AgentTypeFromUrdf, expand
from colift.scenario.references import Mistake, Place, mistakes
from colift.scenario.settings import Settings

SHIPPED = resources.files("colift") / "scenarios"
SUFFIXES = (".yaml", ".yml")


class ScenarioError(ValueError):
    """A scenario that cannot be used; the message is for a person, one line a mistake."""


def names() -> list[str]:
    """Names of the shipped scenarios."""
    return sorted(Path(file.name).stem for file in SHIPPED.iterdir() if file.name.endswith(SUFFIXES))


def load(name_or_path: str | Path) -> Settings:
    """The settings of a shipped scenario, by name, or of a YAML file, by path.

    Raises ScenarioError: an unknown name, a file that cannot be read, or every mistake in it, one a line, as
    `file:line: path [unit]: what is allowed`.
    """
    given = str(name_or_path)
    if given in names():
        return parse((SHIPPED / f"{given}.yaml").read_text(encoding="utf-8"), f"{given}.yaml")
    path = Path(given).expanduser()
    if path.suffix not in SUFFIXES and not path.exists():
        close = difflib.get_close_matches(given, names(), n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        raise ScenarioError(
            f"there is no scenario {given!r} (shipped: {', '.join(names())}; or the path of a .yaml file){hint}"
        )
    try:
        return parse(path.read_text(encoding="utf-8"), given)
    except OSError as error:
        raise ScenarioError(f"{given}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{given}: cannot be read: not UTF-8 text (byte {error.start})") from None


def parse(text: str, file: str) -> Settings:
    """The settings that a text states; `file` names it in messages. Raises ScenarioError as `load` does."""
    tree = _compose(text, file)
    data, wrong = _expanded(_plain(tree), Path(file).parent)
    unread = {place[:2] for place, _ in wrong}
    try:
        settings = Settings.model_validate(data)
    except ValidationError as error:
        schema = Schema(Settings)
        found = [e for e in error.errors() if e["loc"][:2] not in unread]
        wrong += [(_place(data, e["loc"], e["type"]), _sentence(e, schema)) for e in found]
        # references are checked by the model only once all sections are valid: check them here as well
        wrong += mistakes(data) if not unread else []
    else:
        return settings
    lines = dict.fromkeys(_line(file, tree, place, sentence, schema) for place, sentence in wrong)
    raise ScenarioError("\n".join(sorted(lines, key=lambda line: int(line.removeprefix(file).split(":")[1]))))


def _expanded(data: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Mistake]]:
    """The data with agent types from URDF in plain numbers, those without mistakes; and the mistakes."""
    kinds, wrong = data.get("agent_types"), []
    if not isinstance(kinds, dict):
        return data, []
    written = dict(kinds)
    for name, kind in kinds.items():
        if not isinstance(kind, dict) or "urdf" not in kind:
            continue
        try:
            written[name], found = expand(kind, folder)
        except ValidationError as error:
            schema = Schema(AgentTypeFromUrdf)
            found = [(_place(kind, e["loc"], e["type"]), _sentence(e, schema)) for e in error.errors()]
        wrong += [(("agent_types", name, *place), sentence) for place, sentence in found]
    return data | {"agent_types": written}, wrong


def _compose(text: str, file: str) -> CommentedMap:
    """The YAML tree with line numbers; only a mapping at the top is accepted."""
    try:
        tree = YAML(typ="rt").load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        problem = " ".join(str(error.problem or error.context).split())
        raise ScenarioError(f"{file}:{line}: not valid YAML: {problem}") from None
    except (YAMLError, ValueError, RecursionError) as error:
        raise ScenarioError(f"{file}:1: not valid YAML: {' '.join(str(error).split())}") from None
    if not isinstance(tree, CommentedMap):
        raise ScenarioError(f"{file}:1: must be settings by name (`name: value`), one a line")
    return tree


def _plain(node: Any) -> Any:
    if isinstance(node, CommentedMap):
        return {str(key): _plain(value) for key, value in node.items()}
    return [_plain(value) for value in node] if isinstance(node, CommentedSeq) else node


def _place(data: Any, loc: tuple[int | str, ...], kind: str) -> Place:
    """Where an error is in the data: pydantic names the variant of a union on the way, the data do not."""
    place: list[int | str] = []
    for i, key in enumerate(loc):
        listed = isinstance(data, list) and isinstance(key, int) and 0 <= key < len(data)
        if listed or (isinstance(data, dict) and key in data):
            data = data[key]
        elif i < len(loc) - 1 or kind != "missing":
            continue
        place.append(key)
    return tuple(place)


def _line(file: str, tree: CommentedMap, place: Place, sentence: str, schema: Schema) -> str:
    """`file:line: path [unit]: sentence`; the line of the setting, or of the section that lacks it."""
    line: int = 0
    node: Any = tree
    for key in place:
        if isinstance(node, CommentedMap) and key in node and key in (node.lc.data or {}):
            line = node.lc.key(key)[0]
        elif isinstance(node, CommentedSeq) and isinstance(key, int) and key < len(node):
            line = node.lc.item(key)[0]
        else:
            break
        node = node[key]
    path = "".join(
        f".{key}" if re.fullmatch(r"[\w-]+", str(key)) and isinstance(key, str) else f"[{key!r}]" for key in place
    )
    unit = unit_of(schema.at(place), place)
    return f"{file}:{line + 1}: {path.lstrip('.') or 'scenario'}{f' [{unit}]' if unit else ''}: {sentence}"


def _sentence(error: Any, schema: Schema) -> str:
    """What is wrong and what is allowed, in words; pydantic's own where they serve."""
    kind, given, about = error["type"], error["input"], error.get("ctx", {})
    last = error["loc"][-1] if error["loc"] else ""
    if kind == "extra_forbidden":
        known = schema.settings_beside(error["loc"])
        close = difflib.get_close_matches(str(last), known, n=1, cutoff=0.5)
        return "is not a setting here" + (f"; did you mean {close[0]!r}?" if close else f"; known: {', '.join(known)}")
    if kind == "missing":
        return "is required" if isinstance(last, str) else f"is missing: the list must have more than {last} values"
    if kind in ("union_tag_invalid", "literal_error"):
        allowed = [part.strip("' ") for part in str(about.get("expected_tags", about.get("expected"))).split(",")]
        tag = about.get("tag", given)
        close = difflib.get_close_matches(str(tag), allowed, n=1, cutoff=0.5)
        key = f"{about['discriminator']} ".replace("'", "") if "discriminator" in about else ""
        return f"{key}must be one of {', '.join(allowed)}, got {tag!r}" + (
            f"; did you mean {close[0]!r}?" if close else ""
        )
    if kind == "union_tag_not_found":
        return f"{str(about['discriminator']).strip(chr(39))} is required: it says which of the variants this is"
    if kind in ("mistake", "value_error"):
        return str(about.get("message", about.get("error")))
    return _wanted(kind, about) + f", got {_shown(given)}"


def _wanted(kind: str, about: dict[str, Any]) -> str:
    words = {
        "float_type": "must be a number",
        "finite_number": "must be finite",
        "int_type": "must be a whole number",
        "string_type": "must be text",
        "tuple_type": "must be a list",
        "dict_type": "must be settings by name",
        "model_type": "must be settings by name",
        "model_attributes_type": "must be settings by name",
        "string_pattern_mismatch": "must be a name: a letter, then letters, digits, - or _",
    }
    bounds = {"greater_than": ("gt", "greater than"), "greater_than_equal": ("ge", "at least")}
    if kind in bounds:
        key, relation = bounds[kind]
        return f"must be {relation} {about[key]:g}"
    if kind in ("too_long", "too_short"):
        size = about.get("max_length", about.get("min_length"))
        return f"must have {'at most' if kind == 'too_long' else 'at least'} {size} values"
    return words.get(kind, f"is not allowed ({kind.replace('_', ' ')})")


def _shown(given: Any) -> str:
    if isinstance(given, list | tuple):
        return f"{len(given)} value{'s' * (len(given) != 1)}"
    if isinstance(given, dict):
        return "settings by name"
    if isinstance(given, float) and not math.isfinite(given):
        return str(given)
    return "nothing" if given is None else repr(given)
