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
values      single settings to arrays, rotations, lags and parts of one's own
roster      the agents, by group and by name, and the team that they form
paths       the reference
disturbances  the unknown forces, mounted
worlds      the truth: plant, actuators, sensors
starts      where the flight begins
priors      what models hold before any data, and how they are fitted
pilots      what flies: gains, allocation, parts
limits      what the flight may not exceed, and what hovering takes
draws       unknown forces of known norm
assumptions what is stated of the unknown, and what of it holds by construction
"""

from colift.scenario.dumping import to_yaml, with_control
from colift.scenario.errors import ScenarioError
from colift.scenario.loading import SUFFIXES, load_scenario, parse, shipped_names, shipped_text
from colift.scenario.schema import Scenario, Section

__all__ = [
    "SUFFIXES",
    "Scenario",
    "ScenarioError",
    "Section",
    "load_scenario",
    "parse",
    "shipped_names",
    "shipped_text",
    "to_yaml",
    "with_control",
]
