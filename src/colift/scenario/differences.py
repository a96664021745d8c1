"""Settings in which two scenarios differ, by their paths."""

from __future__ import annotations

import json
from typing import Any, NamedTuple


class SettingDifference(NamedTuple):
    """Setting in which two scenarios differ; values are JSON text, or `absent`."""

    path: str  # path of the setting, as in `--set`
    first: str  # value in the first scenario
    second: str  # value in the second scenario


def setting_differences(first: Any, second: Any) -> list[SettingDifference]:
    """Compare two scenarios.

    Args:
        first: Settings as plain data, such as ``settings.model_dump(mode="json")``.
        second: Settings as plain data.

    Returns:
        Path in the form of ``--set``, and both values, of each setting that differs. Null values count as absent.
    """
    a, b = _leaves(first), _leaves(second)
    text = lambda values, path: json.dumps(values[path]) if path in values else "absent"  # noqa: E731
    return [
        SettingDifference(path, text(a, path), text(b, path))
        for path in dict.fromkeys([*a, *b])
        if text(a, path) != text(b, path)
    ]


def _leaves(value: Any, path: str = "") -> dict[str, Any]:
    """Return settings by their path, in the form of `--set`; null values are omitted."""
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        items = enumerate(value)
    else:
        return {} if value is None else {path: value}
    leaves: dict[str, Any] = {}
    for name, item in items:
        leaves |= _leaves(item, f"{path}.{name}" if path else str(name))
    return leaves
