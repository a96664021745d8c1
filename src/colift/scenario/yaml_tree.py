"""A YAML text as plain data, with the line of every value; only what a scenario can use is read.

Numbers, text, lists and settings by name, anchors and merge keys. No tags, so that a text makes nothing but these.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NoReturn

from ruamel.yaml import YAML
from ruamel.yaml.composer import MaxDepthExceededError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from colift.scenario.errors import ErrorMessage, Place, ScenarioError, format_value

MAX_BYTES = 100_000  # thirty times the paper's study; read in a second or two
MAX_VALUES = 10_000  # an alias counts each time: a few lines of them can stand for billions
MAX_DEPTH = 20  # levels; a scenario has eight
TAG = "tag:yaml.org,2002:"


@dataclasses.dataclass(frozen=True)
class Tree:
    """Plain data, the line of every place in it, 0 where it was set and not read, and what is wrong with its form."""

    file: str
    data: dict[str, Any]
    lines: dict[Place, int]
    errors: list[ErrorMessage]

    def line(self, place: Place) -> int:
        """The line of a setting, or of the section that lacks it; 0 where that was set."""
        return next((self.lines[place[:n]] for n in range(len(place), 0, -1) if place[:n] in self.lines), 1)

    def at(self, place: Place) -> str:
        """Where a person finds a setting: `file:line:`, or `--set`."""
        line = self.line(place)
        return f"{self.file}:{line}:" if line else "--set"


def read(text: str, file: str) -> Tree:
    """The data of a text; `file` names it in messages.

    Raises ScenarioError at once for what is no YAML, no mapping, or too much; what is wrong with single values is
    collected.
    """
    reader = _Reader(lambda line: f"{file}:{line}")
    node = reader.compose(text)
    if not isinstance(node, MappingNode):
        reader.fail(1, "must be settings by name (`name: value`), one a line")
    data = reader.value(node, ())
    return Tree(file, data, reader.lines, reader.wrong)


def with_setting(tree: Tree, change: str) -> Tree:
    """A tree in which one setting is another: `payload.mass_kg=2`; sections that are not there are made.

    The value is YAML. A section replaces a section as a whole; an entry of a list goes by its `name`, where all of them
    have one, or by its number, 0 the first.
    Raises ScenarioError as `read`, and for a path that leads nowhere.
    """
    path, equals, text = change.partition("=")
    reader = _Reader(lambda _line: f"--set {path}")
    if not (equals and path):
        raise ScenarioError(f"--set {format_value(change)}: must be `path=value`, as payload.mass_kg=2")
    if path.count(".") >= MAX_DEPTH:
        raise ScenarioError(f"--set {format_value(path)}: is nested more than {MAX_DEPTH} deep")
    node = reader.compose(text)
    value = None if node is None else reader.value(node, ())
    lines, data, place = dict(tree.lines), tree.data, ()
    for name in path.split("."):
        if isinstance(data, list):
            key = _index(name, data, path)
            data = data[key]
        elif isinstance(data, dict):
            key = name
            if name not in data:
                lines[*place, name] = 0
            data = data.get(name, {})
        else:
            raise ScenarioError(
                f"--set {path}: {'.'.join(map(str, place))} is {format_value(data)}, which holds no settings"
            )
        place = (*place, key)
    inside = lambda at: at[: len(place)] == place  # noqa: E731
    return Tree(
        tree.file,
        _put(tree.data, place, value),
        {at: line for at, line in lines.items() if not inside(at)} | {place: 0},
        [mistake for mistake in tree.errors if not inside(mistake[0])]
        + [((*place, *at), sentence) for at, sentence in reader.wrong],
    )


def diff_tree(base: Tree, tree: Tree) -> Tree:
    """A tree that says only where it differs from another: settings beside settings, entries of lists by their `name`.

    Any other value takes the place of the other's, and so does a section of another `kind`. What is wrong with what is
    taken over is told where the tree says `extends`.
    """
    merged = _Merged(tree.lines, dict.fromkeys(base.lines, tree.line(("extends",))))
    mine = {key: value for key, value in tree.data.items() if key != "extends"}
    data = merged.value(base.data, mine, (), ())
    return Tree(tree.file, data, merged.lines, [(merged.place(at), sentence) for at, sentence in tree.errors])


class _Merged:
    """One pass over two trees: the lines of what results, and where in it each place of the second is."""

    def __init__(self, theirs: dict[Place, int], lines: dict[Place, int]) -> None:
        self.theirs, self.lines = theirs, lines
        self.moved: dict[Place, Place] = {(): ()}

    def value(self, base: Any, new: Any, at: Place, was: Place) -> Any:
        """What results at a place, where the second tree has `new` at `was`."""
        self.moved[was] = at
        if isinstance(base, dict) and isinstance(new, dict) and new.get("kind", base.get("kind")) == base.get("kind"):
            return base | {key: self.value(base.get(key), x, (*at, key), (*was, key)) for key, x in new.items()}
        names = _names(base)
        if names and _names(new):
            out = list(base)
            for i, entry in enumerate(new):
                j = names.index(entry["name"]) if entry["name"] in names else len(out)
                value = self.value(out[j] if j < len(out) else None, entry, (*at, j), (*was, i))
                out[j : j + 1] = [value]
            return out
        self.lines = {place: line for place, line in self.lines.items() if place[: len(at)] != at}
        inside = {place: line for place, line in self.theirs.items() if place[: len(was)] == was}
        self.lines |= {(*at, *place[len(was) :]): line for place, line in inside.items()}
        return new

    def place(self, at: Place) -> Place:
        """Where a place of the second tree is in what results."""
        known = next(at[:n] for n in range(len(at), -1, -1) if at[:n] in self.moved)
        return (*self.moved[known], *at[len(known) :])


def _names(entries: Any) -> list[str]:
    """Of a list whose entries all have one, each once; else none."""
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
        there = f"entries 0 to {size - 1}" if size else "no entries"
        named = f" ({', '.join(map(format_value, names))})" if names else ""
        raise ScenarioError(f"--set {path}: {format_value(name)} is none of the list's {there}{named}")
    return int(name)


def _put(data: Any, place: Place, value: Any) -> Any:
    """Data with another value at a place."""
    if not place:
        return value
    key, *below = place
    if isinstance(data, list):
        return [_put(entry, tuple(below), value) if i == key else entry for i, entry in enumerate(data)]
    return data | {key: _put(data.get(key, {}), tuple(below), value)}


class _Reader:
    """One pass over the nodes of a text: values, their lines, and what is wrong."""

    def __init__(self, at: Callable[[int], str]) -> None:
        self.at = at  # where a line of the text is, for a person
        self.lines: dict[Place, int] = {}
        self.wrong: list[ErrorMessage] = []
        self.values, self.depth = 0, 0
        self.yaml = YAML(typ="safe", pure=True)
        self.yaml.max_depth = MAX_DEPTH
        self.yaml.composer.warn_double_anchors = False  # a name may be used again

    def fail(self, line: int, sentence: str) -> NoReturn:
        """Raise ScenarioError."""
        raise ScenarioError(f"{self.at(line)}: {sentence}")

    def compose(self, text: str) -> Node | None:
        """The one document, with the line of every node."""
        if len(text) > MAX_BYTES:
            self.fail(1, f"holds more than {MAX_BYTES} characters, which no scenario needs")
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
        except (YAMLError, ValueError, AssertionError, RecursionError) as error:  # asserted: the version of YAML
            self.fail(1, f"not valid YAML: {' '.join(str(error).split())}")

    def value(self, node: Node, place: Place) -> Any:
        """The plain value of a node, all inside it told by its place."""
        line = node.start_mark.line + 1
        self.values, self.depth = self.values + 1, self.depth + 1
        if self.values > MAX_VALUES:
            self.fail(line, f"holds more than {MAX_VALUES} values, aliases counted each time")
        if self.depth > MAX_DEPTH:
            self.fail(line, f"is nested more than {MAX_DEPTH} deep")
        if isinstance(node, MappingNode):
            value = self.mapping(node, place)
        elif isinstance(node, SequenceNode):
            value = self.sequence(node, place)
        else:
            assert isinstance(node, ScalarNode)
            value = self.scalar(node, place)
        self.depth -= 1
        return value

    def sequence(self, node: SequenceNode, place: Place) -> list[Any]:
        """The entries, in order."""
        self.no_tag(node, "seq", place)
        for i, entry in enumerate(node.value):
            self.lines[*place, i] = entry.start_mark.line + 1
        return [self.value(entry, (*place, i)) for i, entry in enumerate(node.value)]

    def mapping(self, node: MappingNode, place: Place) -> dict[str, Any]:
        """The settings by name; those that a merge key brings give way to those written."""
        self.no_tag(node, "map", place)
        found, written = self.merged(node, place), set()
        for key, value in node.value:
            name, line = key.value, key.start_mark.line + 1
            if _is(key, "merge"):
                continue
            if not _is(key, "str") or not _is_text(name):
                said = format_value(name) if isinstance(name, str) else "a list or section"
                self.wrong.append((place, f"the name of a setting must be text, got {said} in line {line}"))
            elif name in written:
                first = self.lines[*place, name]
                self.wrong.append(((*place, name), f"stands twice, in lines {first} and {line}"))
            else:
                self.lines[*place, name] = line
                found[name] = self.value(value, (*place, name))
                written.add(name)
        return found

    def merged(self, node: MappingNode, place: Place) -> dict[str, Any]:
        """What merge keys (`<<: *section`, or a list of them) bring; of several the first section counts."""
        found: dict[str, Any] = {}
        for value in (value for key, value in node.value if _is(key, "merge")):
            for section in reversed(value.value) if isinstance(value, SequenceNode) else [value]:
                if isinstance(section, MappingNode):
                    found |= self.value(section, place)
                else:
                    self.wrong.append(
                        (place, f"`<<` takes a section, or a list of them, got {format_value(section.value)}")
                    )
        return found

    def no_tag(self, node: Node, kind: str, place: Place) -> bool:
        """Whether a node is what it looks like; told where a tag says otherwise."""
        if _is(node, kind):
            return True
        self.wrong.append(
            (place, f"tags are not used in a scenario, got {format_value(str(node.tag).replace(TAG, '!!'))}")
        )
        return False

    def scalar(self, node: ScalarNode, place: Place) -> Any:
        """A number, text, truth value or nothing."""
        plain = node.style is None
        implied = str(self.yaml.resolver.resolve(ScalarNode, node.value, (plain, not plain))).removeprefix(TAG)
        if not self.no_tag(node, implied, place):
            return None
        if not _is_text(node.value):
            self.wrong.append((place, f"holds characters that are not text, got {format_value(node.value)}"))
            return None
        if implied not in ("null", "bool", "int", "float"):  # dates and lone merge keys too are text here
            return node.value
        try:
            return self.yaml.constructor.construct_object(node)
        except ValueError:
            self.wrong.append((place, f"is not a number that can be read, got {format_value(node.value)}"))
            return None


def _is(node: Node, kind: str) -> bool:
    return str(node.tag) == TAG + kind


def _is_text(value: Any) -> bool:
    """Whether it is whole characters: half of one, a surrogate alone, no file can hold."""
    return isinstance(value, str) and not any("\ud800" <= c <= "\udfff" for c in value)
