"""Settings that differ from the shipped ones: replaced sections, and a team of different agents."""

import functools

from colift import scenario
from colift.scenario import Scenario


def changed(name: str, **sections: object) -> Scenario:
    """Return a shipped scenario with some sections replaced, validated again."""
    return Scenario.model_validate(scenario.load_scenario(name).model_dump() | sections)


def bar(joints: list[dict], tips: list[str]) -> dict:
    """Return an agent type with a given tree and arbitrary numbers."""
    body = {"mass_kg": 0.1, "inertia_kgm2": [1e-3, 1e-3, 1e-3]}
    return {
        "base": {"mass_kg": 1.0, "inertia_kgm2": [0.02, 0.02, 0.03]},
        "thrust_max_N": 40,
        "joints": [{"axis": [0, 3, 4], "body": body} | joint for joint in joints],
        "arms": [{"name": f"a{i}", "joint": tip, "tip_position_m": [0, 0, -0.2]} for i, tip in enumerate(tips)],
    }


MIXED = {
    "agent_types": {
        "crane": bar([{"name": "hook", "type": "prismatic", "nominal_position_m": 0.3}], ["hook"]),
        "claw": bar(
            [{"name": "f", "type": "revolute"}, {"name": "g", "type": "revolute", "parent": "f"}], ["g", "base"]
        ),
        "big_crane": bar([{"name": "winch", "type": "prismatic", "rpy_deg": [10, 20, 30]}], ["winch"]),
    },
    "agents": [
        {"name": "a", "type": "crane", "contact_positions_m": [[1, 0, 0]]},
        {"name": "b", "type": "claw", "yaw_deg": 90, "contact_positions_m": [[0, 1, 0], [0, 1, 0.1]]},
        {"name": "c", "type": "big_crane", "yaw_deg": -90, "contact_positions_m": [[-1, 0, 0]]},
    ],
    "nominal": {"agent_types": {"big_crane": {"joints": {"winch": {"mass_kg": 0.2, "inertia_kgm2": [1, 1, 1]}}}}},
    "disturbances": [
        {"name": "push", "kind": "constant", "acts_on": "c", "body": "winch", "force_N": [1, 2, 3]},
        {"name": "bias", "kind": "rotor_bias", "acts_on": "agents", "thrust_N": 0.5},
        {"name": "rub", "kind": "joint_friction", "acts_on": "b", "viscous_Nms": 0.3, "coulomb_Nm": 0.1},
    ],
    "allocation": {"kind": "least_squares"},
}


@functools.cache
def mixed() -> Scenario:
    """Return settings with two cranes of one structure and a claw, each with individual disturbances."""
    return changed("paper", **MIXED)
