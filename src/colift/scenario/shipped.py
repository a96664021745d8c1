"""Names, texts and descriptions of the shipped scenarios.

The schema is not imported, which takes longer than a command that lists scenarios or completes their names.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.events import ScalarEvent

SHIPPED_DIRECTORY = resources.files("colift.scenario") / "library"
SUFFIXES = (".yaml", ".yml")


def shipped_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    return sorted(Path(file.name).stem for file in SHIPPED_DIRECTORY.iterdir() if file.name.endswith(SUFFIXES))


def shipped_text(name: str) -> str:
    """Return the text of a shipped scenario, with its comments; `name` as in `shipped_names`."""
    return (SHIPPED_DIRECTORY / f"{name}.yaml").read_text(encoding="utf-8")


def shipped_description(name: str) -> str:
    """Return the description of a shipped scenario; the text after it is not parsed.

    Args:
        name: Name as in `shipped_names`.
    """
    events = YAML(typ="safe", pure=True).parse(shipped_text(name))
    words = (event.value for event in events if isinstance(event, ScalarEvent))
    # no entry before the description is a section or a list, so that keys and values alternate
    return next(value for key, value in zip(words, words, strict=False) if key == "description")
