"""Rewrite the tables of scenarios.md from the settings classes; run it after a change of a setting."""

from pathlib import Path

from colift.scenario import Scenario
from colift.scenario.from_csv import WaypointsFromFile
from colift.scenario.from_table import SampledFromFile
from colift.scenario.from_urdf import AgentTypeFromUrdf
from colift.scenario.schema_docs import markdown

page = Path(__file__).with_name("scenarios.md")
head, mark, _ = page.read_text(encoding="utf-8").partition("<!-- settings -->\n")
page.write_text(
    head + mark + "\n" + markdown(Scenario, AgentTypeFromUrdf, WaypointsFromFile, SampledFromFile), encoding="utf-8"
)
