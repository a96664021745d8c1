"""The smallest team that carries a payload: three single bodies that hold a plate, which compiles in seconds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pydantic

from colift import scenario
from colift.scenario import Scenario, schema

SAMPLE = scenario.load_scenario(Path(__file__).parent / "sample_scenario.yaml")
CONTACTS = ((0.4, 0.0, 0.03), (-0.2, 0.35, 0.03), (-0.2, -0.35, 0.03))


def settings(**changes: Any) -> Scenario:
    """Return the sample scenario with that team and with some settings changed."""
    base = {"mass_kg": 1.5, "inertia_kgm2": [0.02, 0.02, 0.035]}
    arms = [{"name": "hook", "joint": "base", "tip_position_m": [0.0, 0.0, -0.1]}]
    team = {
        "agent_types": {"body": {"base": base, "thrust_max_N": 40.0, "arms": arms}},
        "agents": [{"name": f"n{i}", "type": "body", "contact_positions_m": [c]} for i, c in enumerate(CONTACTS)],
        "allocation": {"kind": "least_squares"},
        "disturbances": [source for source in SAMPLE.disturbances if source.acts_on == "payload"],
    }
    return SAMPLE.model_copy(update=team | changes)


NAMES = tuple(agent.name for agent in settings().agents)


def write(path: Path, **changes: Any) -> Path:
    """Write the same scenario to a file as JSON, which is valid YAML."""
    path.write_text(json.dumps({"schema": 2} | settings(**changes).model_dump(mode="json", exclude_none=True)))
    return path


def faults(*given: dict[str, Any]) -> tuple[schema.Fault, ...]:
    """Return faults of that team as sections."""
    return pydantic.TypeAdapter(tuple[schema.Fault, ...]).validate_python(given)
