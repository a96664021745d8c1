"""Scenarios: YAML files, their schema, and the experiments built from them.

fields            number types with their ranges
schema            sections of a scenario file
plain_data        entries of settings before validation
contact_checks    consistency of the settings of contacts
cross_checks      consistency between sections
plugins           user-defined parts, named as `module:Name`
errors            messages with their location in the data
validation        pydantic errors as messages
yaml_tree         YAML text as plain data with line numbers
shipped           names, texts and descriptions of the shipped scenarios
loading           file to settings, or to all errors with their lines
migration         conversion of files of schema 1
former_settings   locations and fields that replace settings of earlier files
from_urdf         agent type from a URDF file
from_csv          waypoints from a table
from_table        sampled reference from a table of poses
packing           tables of numbers as text
differences       settings in which two scenarios differ
dumping           settings to the text of a file
schema_docs       reference page of the settings
template          text of a new scenario
conversion        settings to arrays, rotations, lags and user-defined parts
team              agents by group and by name; true and nominal team
trajectories      reference trajectory and headings of the agents
disturbances      disturbances and their attachment
world             plant, actuators, sensors
initial_states    initial state and equilibrium
priors            residual models before any data, and options of their fits
controllers       controller of case C1 and its extensions
termination       termination limits and hover thrust
random_residuals  random residuals of a given RKHS norm
assumptions       assumptions of the error bounds
cases             cases, their extensions and baselines
experiment        experiment of each case
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from colift.scenario.dumping import to_yaml, with_control
    from colift.scenario.errors import ScenarioError
    from colift.scenario.loading import load_scenario, parse
    from colift.scenario.schema import Scenario, Section
    from colift.scenario.shipped import SUFFIXES, shipped_description, shipped_names, shipped_text

_HOME = {
    "SUFFIXES": "shipped",
    "Scenario": "schema",
    "ScenarioError": "errors",
    "Section": "schema",
    "load_scenario": "loading",
    "parse": "loading",
    "shipped_description": "shipped",
    "shipped_names": "shipped",
    "shipped_text": "shipped",
    "to_yaml": "dumping",
    "with_control": "dumping",
}
__all__ = [
    "SUFFIXES",
    "Scenario",
    "ScenarioError",
    "Section",
    "load_scenario",
    "parse",
    "shipped_description",
    "shipped_names",
    "shipped_text",
    "to_yaml",
    "with_control",
]


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'colift.scenario' has no attribute {name!r}")
    return getattr(importlib.import_module(f"colift.scenario.{_HOME[name]}"), name)
