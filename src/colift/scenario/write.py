"""Settings as a scenario file."""

from __future__ import annotations

import io

from ruamel.yaml import YAML

from colift.scenario.settings import Settings


def text(settings: Settings) -> str:
    """The YAML that states every setting, defaults too and other files' contents in plain numbers; `parse` reads it."""
    yaml = YAML()
    yaml.default_flow_style = None  # what holds no other section or list stands on one line
    yaml.width = 120
    out = io.StringIO()
    yaml.dump(settings.model_dump(mode="json", exclude_none=True), out)
    return out.getvalue()
