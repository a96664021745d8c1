"""Scenarios: YAML files to validated, immutable settings, and settings to the values that a run starts from.

quantities  its numbers, each with the range in which it can be meant
settings    what a scenario may say
references  what its sections say about each other
own         a part that a scenario names as `module:Name`
mistake     a place in the data, and what is said of it
validation  what pydantic finds wrong, in words
tree        a YAML text as plain data with lines
read        a file to settings, or to every mistake in it with its line
from_urdf   an agent type from a URDF file, in plain numbers
write       settings to a file's text
describe    the settings as a reference page
build       settings to teams, disturbances, sensors, gains and the start
"""

from colift.scenario.mistake import ScenarioError
from colift.scenario.read import SUFFIXES, load, names, parse, shipped
from colift.scenario.settings import Section, Settings
from colift.scenario.write import text, with_control

__all__ = [
    "SUFFIXES",
    "ScenarioError",
    "Section",
    "Settings",
    "load",
    "names",
    "parse",
    "shipped",
    "text",
    "with_control",
]
