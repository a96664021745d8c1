"""Settings as a scenario file."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError

from colift.scenario.errors import ScenarioError
from colift.scenario.migration import SCHEMA
from colift.scenario.schema import Scenario


def to_yaml(settings: Scenario) -> str:
    """Write a scenario as YAML that states all settings, also defaults, and that `loading.parse` reads.

    The contents of other files, such as URDF files and tables, are written as numbers.
    """
    yaml = YAML()
    yaml.default_flow_style = None  # sections and lists without nested ones are written in one line
    yaml.width = 120
    out = io.StringIO()
    yaml.dump({"schema": SCHEMA} | settings.model_dump(mode="json", exclude_none=True), out)
    return out.getvalue()


def with_control(written: str, control: Mapping[str, Any]) -> str:
    """Replace settings of the section `control` in the text of a scenario; all other text and comments stay.

    Args:
        written: Text of the scenario.
        control: New values by the name of the setting.

    Returns:
        The text with the new values.

    Raises:
        ScenarioError: If the text is not valid YAML or has no section `control`.
    """
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 4096  # long lines are not wrapped
    yaml.indent(mapping=2, sequence=4, offset=2)
    try:
        data = yaml.load(written)
    except YAMLError as error:
        raise ScenarioError(f"not valid YAML: {' '.join(str(error).split())}") from None
    section = data.get("control") if isinstance(data, CommentedMap) else None
    if not isinstance(section, CommentedMap):
        raise ScenarioError("there is no section `control` whose gains could be written")
    section.update({name: _flat(value) for name, value in control.items()})
    out = io.StringIO()
    yaml.dump(data, out)
    return out.getvalue()


def _flat(value: Any) -> Any:
    """Return a list that is written on one line, or a single number if all entries are equal."""
    if not isinstance(value, tuple):
        return value
    if len(set(value)) == 1:
        return value[0]
    entries = CommentedSeq(value)
    entries.fa.set_flow_style()
    return entries
