"""Mutations of valid inputs for the fuzz harness: bytes, tables, XML and JSON. A seed determines each of them."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

Rng = np.random.Generator

WORDS = (
    *("0", "-0.0", "1", "-1", "5e-324", "1e-300", "1e300", "1e999", "-1e999", "nan", "NaN", "inf", "-inf", "Infinity"),
    *("1e", "1.5.5", "0x10", "1_000", "9" * 400, "0." + "1" * 2000, "1e-400", "9223372036854775808", "", " ", "true"),
    *("null", "none", "a b", "1 2", "1 2 3", "1 2 3 4", "nan nan nan", "1e300 1e300 1e300", "0 0 0", "1,5", "x" * 5000),
    *("\ufeff", "\u00e9", "\u2028", "\U0001f681", "\x7f", "../..", "/dev/zero", "base", "&amp;", "%", "#", '"', "'"),
)
"""Texts that replace values: limits of numbers, wrong types, characters with a meaning in a format."""
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2**63, 10**400, -(10**400), 1e308, -1e308, 5e-324, float("nan"), float("inf")),
    *("", "x", "nan", "1", "colift-run-0123456789ab", "C3", "\ud800", "x" * 5000, [], {}, [[]], [None], {"": None}),
    *([1, 2, 3], {"a": 1}, [float("nan")] * 3, {"force": 1}, {"C1": {}}, ["energy"], "a_priori"),
)
"""Values that replace entries of JSON."""


def pick(rng: Rng, of: Sequence[Any]) -> Any:
    """Return a random element."""
    return of[int(rng.integers(len(of)))]


def mutate_bytes(rng: Rng, content: bytes, seeds: Sequence[bytes], words: Sequence[str] = WORDS) -> bytes:
    """Return content with one change of its bytes: flips, deletion, repetition, insertion, truncation, splice."""
    if not content:
        return pick(rng, seeds)
    i, n = int(rng.integers(len(content))), int(rng.integers(1, 40))
    kind = int(rng.integers(9))
    if kind == 0:
        return content[:i] + bytes([content[i] ^ (1 << int(rng.integers(8)))]) + content[i + 1 :]
    if kind == 1:
        return content[:i] + content[i + n :]
    if kind == 2:
        return content[:i] + int(rng.integers(2, 30)) * content[i : i + n] + content[i + n :]
    if kind == 3:
        return content[:i] + pick(rng, words).encode("utf-8", "surrogatepass") + content[i:]
    if kind == 4:
        return content[:i]
    if kind == 5:
        other = pick(rng, seeds)
        return content[:i] + other[int(rng.integers(len(other))) :]
    if kind == 6:
        return content[:i] + bytes(n) + content[i + n :]
    if kind == 7:
        return content[:i] + rng.bytes(n) + content[i + n :]
    return content[i:] + content[:i]


def mutate_table(rng: Rng, text: str, words: Sequence[str] = WORDS) -> str:
    """Return a table of values with one change of a cell, row, column or separator."""
    separator = next((mark for mark in (",", ";", "\t") if mark in text), " ")
    rows = [line.split(separator) for line in text.split("\n")]
    k = int(rng.integers(len(rows)))
    column = int(rng.integers(max(map(len, rows))))
    kind = int(rng.integers(9))
    if kind <= 2:
        rows[k] = [*rows[k]]
        rows[k][min(column, len(rows[k]) - 1)] = pick(rng, words)
    elif kind == 3:
        del rows[k]
    elif kind == 4:
        rows.insert(int(rng.integers(len(rows) + 1)), rows[k])
    elif kind == 5:
        rows = [[cell for i, cell in enumerate(row) if i != column] for row in rows]
    elif kind == 6:
        rows = [[*row[:column], *row[column : column + 1], *row[column:]] for row in rows]
    elif kind == 7:
        separator = pick(rng, [",", ";", "\t", " ", "|", ", "])
    else:
        rows.insert(k, [pick(rng, ["#", "# " + "x,y", '"', "\0", "time_s", "---"])])
    return "\n".join(separator.join(row) for row in rows)


def mutate_xml(rng: Rng, root: ET.Element, words: Sequence[str] = WORDS) -> ET.Element:
    """Return a document with one change of an element or attribute."""
    root = copy.deepcopy(root)
    elements = list(root.iter())
    element, other = pick(rng, elements), pick(rng, elements)
    kind = int(rng.integers(10))
    if kind <= 3 and element.attrib:
        element.set(pick(rng, sorted(element.attrib)), pick(rng, words))
    elif kind == 4 and element.attrib:
        del element.attrib[pick(rng, sorted(element.attrib))]
    elif kind == 5 and len(element):
        element.remove(pick(rng, list(element)))
    elif kind == 6 and other is not root:
        element.insert(int(rng.integers(len(element) + 1)), copy.deepcopy(other))
    elif kind == 7:
        element.tag = pick(rng, [each.tag for each in elements] + ["x", "include", "xacro:x"])
    elif kind == 8 and other.attrib:
        name = pick(rng, sorted(other.attrib))
        element.set(name, other.get(name, ""))
    else:
        element.text = pick(rng, words)
    return root


def xml_text(root: ET.Element) -> bytes:
    """Return the text of a document; characters that XML does not permit stay in it."""
    return ET.tostring(root, encoding="unicode").encode("utf-8", "surrogatepass")


def mutate_json(rng: Rng, value: Any, values: Sequence[Any] = VALUES) -> Any:
    """Return nested data with one entry replaced, removed, renamed, wrapped or copied from elsewhere."""
    value = copy.deepcopy(value)
    places = list(_places(value))
    if not places:
        return pick(rng, values)
    (owner, key), (other, other_key) = pick(rng, places), pick(rng, places)
    kind = int(rng.integers(7))
    if kind <= 2:
        owner[key] = copy.deepcopy(pick(rng, values))
    elif kind == 3:
        del owner[key]
    elif kind == 4 and isinstance(owner, dict):
        owner[pick(rng, ["", "x", "C1", "schema", "cases", f"{key}x"])] = owner.pop(key)
    elif kind == 5:
        owner[key] = [owner[key]] if rng.integers(2) else {"a": owner[key]}
    else:
        owner[key] = copy.deepcopy(other[other_key])
    return value


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every entry of nested data as its container and its key."""
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in list(entries):
        yield value, key
        yield from _places(entry)


def json_text(value: Any) -> bytes:
    """Return nested data as JSON, with NaN and lone surrogates as Python writes them."""
    return json.dumps(value).encode("utf-8", "surrogatepass")


def times(rng: Rng) -> int:
    """Return the number of mutations of one input: mostly one or two."""
    return int(rng.geometric(0.6))


def repeated(rng: Rng, value: Any, mutate: Callable[[Rng, Any], Any]) -> Any:
    """Apply one or several mutations."""
    for _ in range(times(rng)):
        value = mutate(rng, value)
    return value
