"""YAML text as plain data, with the line of every value.

The reader accepts numbers, text, lists, settings by name, anchors and merge keys. It rejects tags, so that a text
cannot create other objects.
"""

from __future__ import annotations

import contextlib
import dataclasses
import warnings
from collections.abc import Callable, Generator
from typing import Any, NoReturn

from ruamel.yaml import YAML
from ruamel.yaml.composer import MaxDepthExceededError
from ruamel.yaml.error import MantissaNoDotYAML1_1Warning, MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from colift.runtime.text import is_encodable
from colift.scenario.errors import ErrorMessage, Location, ScenarioError, format_value

MAX_BYTES = 2_000_000  # a scenario has some 3 kB, and the knots of a table of poses up to 1.2 MB
MAX_VALUES = 10_000  # every use of an alias counts: a few lines can expand to billions of values
MAX_DEPTH = 20  # levels; a scenario has eight
TAG = "tag:yaml.org,2002:"  # prefix of the standard YAML tags


@dataclasses.dataclass(frozen=True)
class Tree:
    """Plain data, the line of every location (0 for an override), and the errors of its form."""

    file: str  # name of the file, for messages
    data: dict[str, Any]  # plain data
    lines: dict[Location, int]  # line of every location; 0 for an override
    errors: list[ErrorMessage]  # errors of the form of the text

    def line(self, location: Location) -> int:
        """Return the line of a setting, or of the section without it; 0 for an override."""
        return next((self.lines[location[:n]] for n in range(len(location), 0, -1) if location[:n] in self.lines), 1)

    def at(self, location: Location) -> str:
        """Return the position of a setting for messages: `file:line:`, or `--set`."""
        line = self.line(location)
        return f"{self.file}:{line}:" if line else "--set"


def read(text: str, file: str) -> Tree:
    """Read a text; errors of single values are collected.

    Args:
        text: YAML text.
        file: Name of the file, for messages.

    Returns:
        Data, lines and errors.

    Raises:
        ScenarioError: If the text is not valid YAML, not a mapping, or too large.
    """
    reader = _Reader(lambda line: f"{file}:{line}")
    node = reader.compose(text)
    if not isinstance(node, MappingNode):
        reader.fail(1, "must be settings by name (`name: value`), one per line")
    data = reader.value(node, ())
    return Tree(file, data, reader.lines, reader.errors)


def read_valid(text: str) -> dict[str, Any]:
    """Read a text; the first error of its form is raised.

    Args:
        text: YAML text.

    Returns:
        Plain data.

    Raises:
        ScenarioError: If the text has not the form that `read` accepts; the message states the line.
    """
    reader = _Reader(lambda line: f"line {line}")
    node = reader.compose(text)
    if not isinstance(node, MappingNode):
        raise ScenarioError("a scenario is a mapping of settings")
    data = reader.value(node, ())
    for location, message in reader.errors[:1]:
        reader.fail(Tree("", {}, reader.lines, []).line(location), message)
    return data


def with_setting(tree: Tree, change: str) -> Tree:
    """Return the tree with one setting replaced, such as `payload.mass_kg=2`; missing sections are created.

    The value is YAML. A section replaces the entire section. An entry of a list is identified by its `name`, if all
    entries have one, or by its index from zero.

    Args:
        tree: Data of a scenario.
        change: Path and value.

    Returns:
        The changed tree.

    Raises:
        ScenarioError: As `read`, and if the path does not exist.
    """
    path, equals, text = change.partition("=")
    reader = _Reader(lambda _line: f"--set {path}")
    if not (equals and path):
        raise ScenarioError(f"--set {format_value(change)}: must be `path=value`, for example payload.mass_kg=2")
    if path.count(".") >= MAX_DEPTH:
        raise ScenarioError(f"--set {format_value(path)}: is nested more than {MAX_DEPTH} deep")
    node = reader.compose(text)
    value = None if node is None else reader.value(node, ())
    changed, location = _with_value(tree, path, value)
    return dataclasses.replace(
        changed, errors=changed.errors + [((*location, *at), message) for at, message in reader.errors]
    )


def with_value(tree: Tree, path: str, value: Any) -> Tree:
    """Return the tree with one setting replaced by a value; the path is as in `with_setting`.

    Args:
        tree: Data of a scenario.
        path: Path of the setting.
        value: Plain data.

    Returns:
        The changed tree.

    Raises:
        ScenarioError: If the path does not exist.
    """
    return _with_value(tree, path, value)[0]


def location_of(tree: Tree, path: str) -> Location:
    """Return the location of a setting; the path is as in `with_setting`.

    Args:
        tree: Data of a scenario.
        path: Path of the setting.

    Raises:
        ScenarioError: If the path does not exist.
    """
    return _locate(tree, path)[0]


def _locate(tree: Tree, path: str) -> tuple[Location, list[Location]]:
    """Return the location of a setting, and those of its sections that the tree does not contain."""
    data, location, missing = tree.data, (), []
    for name in path.split("."):
        if isinstance(data, list):
            key = _index(name, data, path)
            data = data[key]
        elif isinstance(data, dict):
            key = name
            if name not in data:
                missing.append((*location, name))
            data = data.get(name, {})
        else:
            raise ScenarioError(
                f"--set {path}: {'.'.join(map(str, location))} is {format_value(data)}, which holds no settings"
            )
        location = (*location, key)
    return location, missing


def _with_value(tree: Tree, path: str, value: Any) -> tuple[Tree, Location]:
    """Return the changed tree and the location of the setting."""
    location, missing = _locate(tree, path)
    lines = tree.lines | dict.fromkeys(missing, 0)
    inside = lambda at: at[: len(location)] == location  # noqa: E731
    changed = Tree(
        tree.file,
        _put(tree.data, location, value),
        {at: line for at, line in lines.items() if not inside(at)} | {location: 0},
        [mistake for mistake in tree.errors if not inside(mistake[0])],
    )
    return changed, location


def diff_tree(base: Tree, tree: Tree) -> Tree:
    """Merge a tree that contains only differences into its base.

    Sections are merged setting by setting, lists entry by entry by `name`. Any other value, and a section of another
    `kind`, replaces the value of the base. Errors in the base have the line of the setting `extends`.

    Args:
        base: Tree that is extended.
        tree: Differences.

    Returns:
        The merged tree.
    """
    merged = _Merged(tree.lines, dict.fromkeys(base.lines, tree.line(("extends",))))
    differences = {key: value for key, value in tree.data.items() if key != "extends"}
    data = merged.value(base.data, differences, (), ())
    return Tree(tree.file, data, merged.lines, [(merged.location(at), message) for at, message in tree.errors])


class _Merged:
    """One pass over two trees: lines of the result, and locations of the second tree in the result."""

    def __init__(self, new_lines: dict[Location, int], lines: dict[Location, int]) -> None:
        self.new_lines, self.lines = new_lines, lines
        self.moved: dict[Location, Location] = {(): ()}

    def value(self, base: Any, new: Any, at: Location, old: Location) -> Any:
        """Return the merged value at a location, for a value `new` of the second tree at `old`."""
        self.moved[old] = at
        if isinstance(base, dict) and isinstance(new, dict) and new.get("kind", base.get("kind")) == base.get("kind"):
            return base | {key: self.value(base.get(key), x, (*at, key), (*old, key)) for key, x in new.items()}
        names = _names(base)
        if names and _names(new):
            out = list(base)
            for i, entry in enumerate(new):
                j = names.index(entry["name"]) if entry["name"] in names else len(out)
                value = self.value(out[j] if j < len(out) else None, entry, (*at, j), (*old, i))
                out[j : j + 1] = [value]
            return out
        self.lines = {location: line for location, line in self.lines.items() if location[: len(at)] != at}
        inside = {location: line for location, line in self.new_lines.items() if location[: len(old)] == old}
        self.lines |= {(*at, *location[len(old) :]): line for location, line in inside.items()}
        return new

    def location(self, at: Location) -> Location:
        """Return the location in the result of a location of the second tree."""
        prefix = next(at[:n] for n in range(len(at), -1, -1) if at[:n] in self.moved)
        return (*self.moved[prefix], *at[len(prefix) :])


def _names(entries: Any) -> list[str]:
    """Return the names of the entries of a list, if all have one and they are unique; else an empty list."""
    if not isinstance(entries, list) or not all(
        isinstance(x, dict) and isinstance(x.get("name"), str) for x in entries
    ):
        return []
    names = [entry["name"] for entry in entries]
    return names if len(set(names)) == len(names) else []


def _index(name: str, entries: list[Any], path: str) -> int:
    names, size = _names(entries), len(entries)
    if name in names:
        return names.index(name)
    if not (name.isdecimal() and name.isascii() and len(name) < 10 and int(name) < size):
        indices = f"entries 0 to {size - 1}" if size else "no entries"
        named = f" ({', '.join(map(format_value, names))})" if names else ""
        raise ScenarioError(f"--set {path}: must be one of the list's {indices}{named}, got {format_value(name)}")
    return int(name)


def _put(data: Any, location: Location, value: Any) -> Any:
    """Return the data with another value at a location."""
    if not location:
        return value
    key, *below = location
    if isinstance(data, list):
        return [_put(entry, tuple(below), value) if i == key else entry for i, entry in enumerate(data)]
    return data | {key: _put(data.get(key, {}), tuple(below), value)}


class _Reader:
    """One pass over the nodes of a text: values, lines and errors."""

    def __init__(self, at: Callable[[int], str]) -> None:
        self.at = at  # position of a line, for messages
        self.lines: dict[Location, int] = {}
        self.errors: list[ErrorMessage] = []
        self.values, self.depth = 0, 0
        self.yaml = YAML(typ="safe", pure=True)
        self.yaml.max_depth = MAX_DEPTH
        self.yaml.composer.warn_double_anchors = False  # a name may be reused

    def fail(self, line: int, message: str) -> NoReturn:
        """Raise ScenarioError."""
        raise ScenarioError(f"{self.at(line)}: {message}")

    def compose(self, text: str) -> Node | None:
        """Compose the only document of the text, with the line of every node."""
        if len(text) > MAX_BYTES:
            self.fail(1, f"holds more than {MAX_BYTES} characters, the limit of a scenario")
        try:
            return self.yaml.compose(text)
        except MaxDepthExceededError as error:
            self.fail(error.problem_mark.line + 1, f"is nested more than {MAX_DEPTH} deep")
        except ReaderError as error:
            line = text.count("\n", 0, error.position) + 1
            self.fail(line, f"not valid YAML: the character {ord(text[error.position]):#06x} is not text")
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            problem = " ".join(str(error.problem or error.context or error).split())
            self.fail(mark.line + 1 if mark else 1, f"not valid YAML: {problem}")
        except (AssertionError, KeyError):  # of the resolver, for the directive %YAML
            self.fail(1, "not valid YAML: the version of YAML must be 1.1 or 1.2")
        except (YAMLError, ValueError, RecursionError) as error:
            self.fail(1, f"not valid YAML: {' '.join(str(error).split())}")

    def value(self, node: Node, location: Location) -> Any:
        """Convert a node to plain data."""
        line = node.start_mark.line + 1
        self.values, self.depth = self.values + 1, self.depth + 1
        if self.values > MAX_VALUES:
            self.fail(line, f"holds more than {MAX_VALUES} values, aliases counted each time")
        if self.depth > MAX_DEPTH:
            self.fail(line, f"is nested more than {MAX_DEPTH} deep")
        if isinstance(node, MappingNode):
            value = self.mapping(node, location)
        elif isinstance(node, SequenceNode):
            value = self.sequence(node, location)
        else:
            assert isinstance(node, ScalarNode)
            value = self.scalar(node, location)
        self.depth -= 1
        return value

    def sequence(self, node: SequenceNode, location: Location) -> list[Any]:
        """Convert the entries of a list."""
        self.no_tag(node, "seq", location)
        for i, entry in enumerate(node.value):
            self.lines[*location, i] = entry.start_mark.line + 1
        return [self.value(entry, (*location, i)) for i, entry in enumerate(node.value)]

    def mapping(self, node: MappingNode, location: Location) -> dict[str, Any]:
        """Convert the settings of a mapping; they override those of merge keys."""
        self.no_tag(node, "map", location)
        found, written = self.merged(node, location), set()
        for key, value in node.value:
            name, line = key.value, key.start_mark.line + 1
            if _is(key, "merge"):
                continue
            if not _is(key, "str") or not _is_text(name):
                label = format_value(name) if isinstance(name, str) else "a list or section"
                self.errors.append((location, f"the name of a setting must be text, got {label} in line {line}"))
            elif name in written:
                first = self.lines[*location, name]
                self.errors.append(((*location, name), f"occurs twice, in lines {first} and {line}"))
            else:
                self.lines[*location, name] = line
                found[name] = self.value(value, (*location, name))
                written.add(name)
        return found

    def merged(self, node: MappingNode, location: Location) -> dict[str, Any]:
        """Return the settings of merge keys (`<<: *section`, or a list of them); the first section has priority."""
        found: dict[str, Any] = {}
        for value in (value for key, value in node.value if _is(key, "merge")):
            for section in reversed(value.value) if isinstance(value, SequenceNode) else [value]:
                if isinstance(section, MappingNode):
                    found |= self.value(section, location)
                else:
                    self.errors.append(
                        (location, f"`<<` must be a section, or a list of sections, got {format_value(section.value)}")
                    )
        return found

    def no_tag(self, node: Node, kind: str, location: Location) -> bool:
        """Return whether a node has no explicit tag; else add an error."""
        if _is(node, kind):
            return True
        self.errors.append(
            (location, f"tags are not used in a scenario, got {format_value(str(node.tag).replace(TAG, '!!'))}")
        )
        return False

    def scalar(self, node: ScalarNode, location: Location) -> Any:
        """Convert a number, text, truth value or null."""
        plain = node.style is None
        implied = str(self.yaml.resolver.resolve(ScalarNode, node.value, (plain, not plain))).removeprefix(TAG)
        if not self.no_tag(node, implied, location):
            return None
        if not _is_text(node.value):
            self.errors.append((location, f"holds characters that are not text, got {format_value(node.value)}"))
            return None
        if implied not in ("null", "bool", "int", "float"):  # dates and single merge keys are text
            return node.value
        try:
            with without_version_warnings():
                return self.yaml.constructor.construct_object(node)
        except ValueError:
            self.errors.append((location, f"is not a number that can be read, got {format_value(node.value)}"))
            return None


@contextlib.contextmanager
def without_version_warnings() -> Generator[None]:
    """Discard warnings about numbers such as `3e0` in files that state YAML 1.1; they are read as in YAML 1.2.

    Yields:
        Nothing.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MantissaNoDotYAML1_1Warning)
        yield


def _is(node: Node, kind: str) -> bool:
    return str(node.tag) == TAG + kind


def _is_text(value: Any) -> bool:
    """Return whether a value is text without surrogates, which no file can contain."""
    return isinstance(value, str) and is_encodable(value)
