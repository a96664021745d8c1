"""Reference page of the settings, generated from their models: path, unit, default and meaning."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from colift.scenario.errors import Location

UNITS = {
    "kg": "kg",
    "kgm": "kg m",
    "kgm2": "kg m²",
    "m": "m",
    "mps": "m/s",
    "mps2": "m/s²",
    "rad": "rad",
    "radps": "rad/s",
    "radpm": "rad/m",
    "deg": "deg",
    "s": "s",
    "Hz": "Hz",
    "N": "N",
    "Nm": "N m",
    "Nms": "N m s/rad",
    "Npm": "N/m",
    "Nspm": "N s/m",
    "Ns2pm2": "N s²/m²",
}


def unit_of(setting: dict[str, Any], location: Location) -> str:
    """Return the stated unit of a setting, or the unit from the last word of its name; empty if there is none."""
    named = [key for key in location if isinstance(key, str)]
    if "unit" in setting:
        return setting["unit"]
    word = named[-1].rpartition("_")[2] if named and "_" in named[-1] else ""
    return UNITS.get(word, "")


class Schema:
    """JSON schema of a model, by location in the data."""

    def __init__(self, model: type[BaseModel]) -> None:
        self._root = model.model_json_schema()

    def at(self, location: Location) -> dict[str, Any]:
        """Return the schema of the setting at a location; for an entry of a plain list, the schema of the list."""
        node = self._root
        for key in location:
            inside = self._inside(node, key)
            if isinstance(key, str) or any("properties" in variant for variant in self._variants(inside)):
                node = inside
        return node

    def leaf(self, loc: Location) -> dict[str, Any]:
        """Return the schema of the value at a location in the form of pydantic, including entries of lists."""
        node = self._root
        for key in loc:
            node = self._inside(node, key)
        return node

    def is_variant(self, loc: Location, key: int | str) -> bool:
        """Return whether a step of a pydantic location names a variant of a union instead of a setting."""
        variants = self._variants(self.leaf(loc))
        return any(
            key not in variant.get("properties", {}) and self._names(variant, key)
            for variant in variants
            if len(variants) > 1
        )

    def ranges(self) -> dict[tuple[str, str], list[str]]:
        """Return the settings of each `(range, reason)`, as `Section.setting`, in the order of the page."""
        found: dict[tuple[str, str], list[str]] = {}
        for section, _, rows in self.sections():
            for key, node, _ in rows:
                for leaf in _leaves(node):
                    if "why" in leaf:
                        found.setdefault((format_range(leaf), leaf["why"]), []).append(f"{section}.{key}")
        return found

    def sibling_settings(self, loc: Location) -> list[str]:
        """Return the names of the settings of the section that contains the last part of `loc`."""
        node = self._root
        for key in loc[:-1]:
            node = self._inside(node, key)
        return [name for variant in self._variants(node) for name in variant.get("properties", {})]

    def sections(self) -> Iterator[tuple[str, str, list[tuple[str, dict[str, Any], bool]]]]:
        """Yield `(name, description, [(setting, schema, required)])` of the model and then of its sections."""
        for name, node in [(self._root["title"], self._root), *self._root.get("$defs", {}).items()]:
            needed = node.get("required", [])
            rows = [(key, inner, key in needed) for key, inner in node.get("properties", {}).items()]
            yield name, node.get("description", ""), rows

    def type_label(self, node: dict[str, Any]) -> str:
        """Describe the type of a setting; sections by their name."""
        if "$ref" in node:
            name = node["$ref"].rpartition("/")[2]
            return f"[{name}](#{name.lower()})"
        options = node.get("oneOf") or node.get("anyOf")
        if options:
            return " or ".join(self.type_label(option) for option in options if option.get("type") != "null")
        if "const" in node:
            return f"`{node['const']}`"
        if "enum" in node:
            return " or ".join(f"`{value}`" for value in node["enum"])
        entries = next(iter(node.get("patternProperties", {}).values()), node.get("additionalProperties"))
        if node.get("type") == "object" and isinstance(entries, dict):
            return f"by name: {self.type_label(entries)}"
        if "prefixItems" in node:
            inner = {self.type_label(item) for item in node["prefixItems"]}
            return f"list of {len(node['prefixItems'])}: {', '.join(sorted(inner))}"
        if "items" in node:
            return f"list: {self.type_label(node['items'])}"
        words = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false"}
        word = words.get(node.get("type", ""), "")
        return f"{word} {format_range(node)}".strip()

    def _variants(self, node: dict[str, Any]) -> list[dict[str, Any]]:
        """Return the possible models of a node, with references resolved."""
        options = node.get("oneOf") or node.get("anyOf") or [node]
        out = []
        for option in options:
            target = option
            while "$ref" in target:
                target = self._root["$defs"][target["$ref"].rpartition("/")[2]]
            out += self._variants(target) if "oneOf" in target or "anyOf" in target else [target]
        return out

    @staticmethod
    def _names(variant: dict[str, Any], key: int | str) -> bool:
        return any(inner.get("const") == key for inner in variant.get("properties", {}).values())

    def _inside(self, node: dict[str, Any], key: int | str) -> dict[str, Any]:
        """Return the schema of a setting, of an entry of a list or mapping, or of the variant of a `kind` or `type`."""
        variants = self._variants(node)
        for variant in variants if len(variants) > 1 else []:
            if self._names(variant, key):
                return variant
        for variant in variants:
            if key in variant.get("properties", {}):
                return variant["properties"][key]
            if isinstance(key, int) and key < len(variant.get("prefixItems", [])):
                return variant["prefixItems"][key]
            if isinstance(key, int) and "items" in variant:
                return variant["items"]
            entries = [variant.get("additionalProperties"), *variant.get("patternProperties", {}).values()]
            for entry in entries:
                if isinstance(key, str) and isinstance(entry, dict):
                    return entry
        return {}


def format_range(node: dict[str, Any]) -> str:
    """Format the range of a number, such as `from 0.1 to 5`; empty if it has none."""
    if "exclusiveMinimum" in node and "exclusiveMaximum" in node:
        return f"between {_digits(node['exclusiveMinimum'])} and {_digits(node['exclusiveMaximum'])}"
    if "minimum" in node and "maximum" in node:
        return f"from {_digits(node['minimum'])} to {_digits(node['maximum'])}"
    return ""


def _digits(bound: float | int) -> str:
    """Format a bound with a short exponent: 1e6 instead of 1e+06."""
    whole = isinstance(bound, int) and bound > 10**6
    return str(bound) if whole else re.sub(r"e([+-])0*", lambda m: "e" + m[1].strip("+"), f"{bound:g}")


def _leaves(node: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the schemas of the numbers of a setting, including those of its lists."""
    yield node
    inside = [*node.get("prefixItems", []), *node.get("anyOf", []), node.get("items"), node.get("additionalProperties")]
    for entry in inside:
        if isinstance(entry, dict):
            yield from _leaves(entry)


def markdown(*models: type[BaseModel]) -> str:
    """Generate the reference page of the settings of models, with one table per section."""
    schemas = [Schema(model) for model in models]
    return "\n".join([*(_tables(schema) for schema in schemas), _ranges(schemas)])


def _ranges(schemas: list[Schema]) -> str:
    """Generate the table of ranges: reason, and settings with the range."""
    found: dict[tuple[str, str], list[str]] = {}
    for schema in schemas:
        for key, names in schema.ranges().items():
            found.setdefault(key, []).extend(names)
    lines = [
        "## Ranges",
        "",
        "The table states the reason of each range.",
        "",
        "| range | reason | settings |",
        "|---|---|---|",
    ]
    lines += [
        f"| {a} | {why} | {', '.join(f'`{name}`' for name in dict.fromkeys(names))} |"
        for (a, why), names in found.items()
    ]
    return "\n".join([*lines, ""])


def _tables(schema: Schema) -> str:
    lines = []
    for name, about, rows in schema.sections():
        lines += [
            f"## {name}",
            "",
            about,
            "",
            "| setting | value | unit | default | meaning |",
            "|---|---|---|---|---|",
        ]
        for key, node, needed in rows:
            cells = (
                f"`{key}`",
                schema.type_label(node),
                unit_of(node, (key,)),
                "required" if needed else _default(node.get("default")),
                " ".join(node.get("description", "").split()),
            )
            lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    return "\n".join(lines)


def _default(value: Any) -> str:
    if value is None or value in ([], {}):
        return "none"
    return "as below" if isinstance(value, dict) else f"`{value}`"
