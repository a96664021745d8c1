"""Text of a new scenario: a team around a plate, with comments, which passes `colift check`."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

from colift.scenario.scaling import REFERENCE, Scale

if TYPE_CHECKING:
    from colift.scenario.gain_limits import TranslationGains

MAX_AGENTS = 100


@dataclasses.dataclass(frozen=True)
class VehicleTemplate:
    """Agent type of a new scenario."""

    name: str  # name of the agent type
    text: str  # YAML text of the agent type
    mass: float  # kg
    contact_offset: tuple[tuple[float, float, float], ...]  # m, tips: outward, left of it, above their mean height
    scale: Scale = REFERENCE  # ratios to the reference vehicle
    heading_deg: float = 0.0  # of the agents, relative to the outward direction


VEHICLES = {  # by arms
    0: VehicleTemplate(
        name="body",
        mass=1.5,
        contact_offset=((0.0, 0.0, 0.0),),
        text="""\
  body:  # a single body with a hook below it
    base: {mass_kg: 1.5, inertia_kgm2: [0.02, 0.02, 0.035]}
    thrust_max_N: 40
    arms:
      - {name: hook, joint: base, tip_position_m: [0, 0, -0.1]}
""",
    ),
    1: VehicleTemplate(
        name="one_arm",
        mass=1.63,
        contact_offset=((0.0, 0.0, 0.0),),
        text="""\
  one_arm:  # one arm on two joints below the base
    base: {mass_kg: 1.5, inertia_kgm2: [0.02, 0.02, 0.035]}
    thrust_max_N: 40
    joints:  # redundant for one contact: they return to rest with control.posture_bandwidth
      - name: roll
        type: revolute
        axis: [1, 0, 0]
        body: {mass_kg: 0.03, inertia_kgm2: [1.0e-5, 1.0e-5, 1.0e-5]}
      - name: pitch
        type: revolute
        parent: roll
        axis: [0, 1, 0]
        body: {mass_kg: 0.1, center_of_mass_m: [0, 0, -0.1], inertia_kgm2: [3.3e-4, 3.3e-4, 1.0e-5]}
    arms:  # a longer arm permits a higher posture bandwidth
      - {name: tip, joint: pitch, tip_position_m: [0, 0, -0.2]}
""",
    ),
    2: VehicleTemplate(
        name="two_arms",
        mass=1.84,
        contact_offset=((0.0, 0.36, 0.0), (0.0, -0.36, 0.0)),
        text="""\
  two_arms:
    base: {mass_kg: 1.5, inertia_kgm2: [0.02, 0.02, 0.035]}
    thrust_max_N: 50
    joints:  # at least 3 n - 3 for n arms, to follow the payload
      - name: waist
        type: revolute
        axis: [0, 0, 1]
        body: {mass_kg: 0.1, inertia_kgm2: [1.0e-4, 1.0e-4, 1.0e-4]}
      - name: left
        type: revolute
        parent: waist
        position_m: [0, 0.08, 0]
        axis: [1, 0, 0]
        nominal_position_rad: 1.2  # from straight down, outwards; 0 and pi/2 are singular
        body: &arm {mass_kg: 0.12, center_of_mass_m: [0, 0, -0.15], inertia_kgm2: [9.0e-4, 9.0e-4, 1.0e-5]}
      - name: right
        type: revolute
        parent: waist
        position_m: [0, -0.08, 0]
        axis: [1, 0, 0]
        nominal_position_rad: -1.2
        body: *arm
    arms:
      - {name: left, joint: left, tip_position_m: [0, 0, -0.3]}
      - {name: right, joint: right, tip_position_m: [0, 0, -0.3]}
""",
    ),
}


def scenario_name(file: Path) -> str:
    """Return the name of the scenario in a file: the file name without suffix, with invalid characters replaced."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", file.stem)[:100]
    return name if re.match(r"[A-Za-z_]", name) else f"_{name}"[:100]


def scenario_template(name: str, agents: int, arms: int) -> str:
    """Generate a scenario with agents at equal distances around a plate.

    Args:
        name: Name of the scenario.
        agents: Number of agents.
        arms: Number of arms of each agent: 0 (the base has a hook), 1 or 2.

    Returns:
        Text of the scenario.

    Raises:
        ValueError: If the team cannot rotate the plate about every axis, or if there is no type with so many arms.
    """
    if arms not in VEHICLES:
        raise ValueError(f"--arms {arms}: must be 0 (single bodies that hold the plate themselves), 1 or 2")
    least = 2 if arms == 2 else 3
    if not least <= agents <= MAX_AGENTS:
        raise ValueError(
            f"--agents {agents}: must be from {least} to {MAX_AGENTS} with --arms {arms}: "
            "three contacts that are not collinear turn the payload about every axis"
        )
    return scenario_text(name, VEHICLES[arms], agents)


def scenario_text(name: str, vehicle: VehicleTemplate, agents: int, limited: TranslationGains | None = None) -> str:
    """Generate the text for agents on a circle with clearance between rotors, and a round plate of larger radius.

    Args:
        name: Name of the scenario.
        vehicle: Agent type.
        agents: Number of agents.
        limited: Horizontal gains and attitude gain of the agents, if bound tips limit them.

    Returns:
        Text of the scenario.
    """
    by = vehicle.scale
    unit = by == REFERENCE
    reach = [x for x, _, _ in vehicle.contact_offset]  # m, outward
    width = 2 * max(abs(y) for _, y, _ in vehicle.contact_offset) + 0.5 * by.length  # m, with the rotors
    least = 0.5 * by.length - min(*reach, 0.0)  # m, so that contacts of arms that reach inward are apart
    radius = max(least, 0.5 * width / math.sin(math.pi / agents)) if agents > 1 else 0.0
    members = "".join(_member(f"agent_{i + 1}", vehicle, 360 * i / agents, radius) for i in range(agents))
    edge = radius + max(*reach, 0.0)  # m, of the payload
    wave = 2 * math.pi / (4 * edge + 2 * width)  # rad/m; the wavelength exceeds the size of the payload
    mass = 0.3 * vehicle.mass * agents
    mass = round(mass, 2) if unit else float(f"{mass:.3g}")
    inertia = mass * (edge + 0.1 * by.length) ** 2 / 4  # of a round plate of some thickness
    return f"""\
# Written by `colift init`. Adapt first the agent type, its contacts, the payload and the reference. Validate changes
# with `colift check {name}.yaml`, and simulate them with `colift study {name}.yaml`. Settings: docs/scenarios.md.
schema: 2
name: {name}
description: {agents} agents around a plate.
duration_s: {24 * by.time:.3g}
control_Hz: {by.control_rate:g}
seed: 0

agent_types:  # frames: x forward, y left, z up, thrust along z
{vehicle.text}
agents:  # contacts in the payload's frame, one for each arm; no three on one line
{members}
payload: {{mass_kg: {mass:g}, inertia_kgm2: [{inertia:.4g}, {inertia:.4g}, {1.9 * inertia:.4g}]}}

nominal:  # parameters of the controller that differ from the true ones
  payload: {{mass_kg: {0.8 * mass:.4g}, inertia_kgm2: [{0.8 * inertia:.4g}, {0.8 * inertia:.4g}, {1.52 * inertia:.4g}]}}

{_flight(by, wave)}
{_control(by, limited)}
{_learning(by)}{"" if unit else _scaled_defaults(by)}"""


def _flight(by: Scale, wave: float) -> str:
    """Generate initial state, reference and disturbances."""
    error, left, up = (f"{x * by.length:.3g}" for x in (0.05, 0.4, 0.2))
    wind, gust = (_vector(by.speed, v) for v in ((1.5, 0.8, 0), (1, 0.4, 0.5)))
    side = _vector(by.length, (0.1, 0.1, 0))
    return f"""\
initial_state:
  position_error_m: [{error}, -{error}, {error}]

reference:
  kind: lissajous
  center_m: [0, 0, 2]
  amplitude_m: [{0.5 * by.length:.3g}, {left}, {up}]
  period_s: {8 * by.time:.3g}
  phase_deg: [0, 90, 30]
  ramp_time_s: {3 * by.time:.3g}  # from rest

disturbances:  # unknown to the controller
  - name: wind
    kind: wind
    acts_on: payload
    attachment_point_m: {side}
    linear_drag_Nspm: {0.3 * by.drag:.3g}
    mean_wind_mps: {wind}
    gusts:
      - {{amplitude_mps: {gust}, wave_vector_radpm: [{wave:.3g}, 0, 0], phase_deg: -75}}
  - {{name: rotors, kind: rotor_bias, acts_on: agents, thrust_N: {-by.force:.3g}, torque_Nm: \
{_vector(by.moment, (0.02, -0.02, 0.01))}}}
"""


def _vector(factor: float, values: tuple[float | int, ...]) -> str:
    """Format a scaled vector."""
    return f"[{', '.join(f'{factor * x:.3g}' for x in values)}]"


def _control(by: Scale, limited: TranslationGains | None) -> str:
    """Generate gains and allocation."""
    K_p, K_v, agent_k_R = (f"{x:.3g}" for x in (5 * by.gain, 4.2 * by.rate, 250 * by.gain))
    if limited is not None:
        K_p, K_v = f"[{limited.K_p:g}, {limited.K_p:g}, {K_p}]", f"[{limited.K_v:g}, {limited.K_v:g}, {K_v}]"
        K_v += "  # horizontal gains and agent_k_R are limited by a right half-plane zero (docs/own_team.md)"
        agent_k_R = f"{limited.agent_k_R:g}"
    return f"""\
control:  # slow mode: change K_p, K_v; unstable fast mode: reduce agent_k_omega, K_v
  K_p: {K_p}
  K_v: {K_v}
  k_R: {60 * by.gain:.3g}
  k_omega: {14 * by.rate:.3g}
  agent_k_R: {agent_k_R}
  agent_k_omega: {28 * by.rate:.3g}
  posture_bandwidth: {5 * by.rate:.3g}  # of joints that the contacts leave free
  complementary_filter_Hz: {5 * by.rate:.3g}
  joint_filter_Hz: {20 * by.rate:.3g}

allocation: {{kind: least_squares}}
"""


def _learning(by: Scale) -> str:
    """Generate learning."""
    T, moment = by.time, by.moment
    lengthscales, periods = "", ""
    if by != REFERENCE:  # defaults of the reference vehicle otherwise
        lengthscales = f"\n    lengthscale: {_lengthscale(T):.3g}\n    rate_lengthscale: {_lengthscale(1 / T):.3g}"
        periods = f"\n  update_period_s: {T:.3g}\n  refit_period_s: {10 * T:.3g}"
    return f"""\
learning:
  update_times_s: {_vector(T, (2, 4, 6, 8, 10, 12))}{periods}
  start_s: {0.3 * T:.3g}
  end_s: {12 * T:.3g}  # one period after the ramp, so that the samples cover the path
  sample_Hz: {20 * by.rate:.3g}
  label_filter_Hz: {8 * by.rate:.3g}
  max_samples: 256
  payload:
    signal_std: {{force_N: {by.force:.3g}, moment_Nm: {0.2 * moment:.3g}}}
    noise_std: {{force_N: {0.1 * by.force:.3g}, moment_Nm: {0.02 * moment:.3g}}}{lengthscales}
  agents:
    signal_std: {{force_N: {by.force:.3g}, moment_Nm: {0.1 * moment:.3g}, joint_torque_Nm: {0.1 * moment:.3g}}}
    noise_std: {{force_N: {0.1 * by.force:.3g}, moment_Nm: {0.01 * moment:.3g}, joint_torque_Nm: {0.01 * moment:.3g}}}\
{lengthscales}
"""


def _lengthscale(value: float) -> float:
    """Limit a length-scale to the range that a scenario permits."""
    return min(max(value, 0.1), 30.0)


def _scaled_defaults(by: Scale) -> str:
    """Generate the settings whose defaults are those of the reference vehicle."""
    T = by.time
    return f"""
sensors:  # defaults of the reference vehicle, scaled (docs/own_team.md)
  position_m: {0.002 * by.length:.3g}
  velocity_mps: {0.01 * by.speed:.3g}
  angular_velocity_radps: {0.01 * by.rate:.3g}
  tip_force_N: {0.1 * by.force:.3g}
  tip_force_bias_N: {0.05 * by.force:.3g}
  tip_force_bandwidth_Hz: {50 * by.rate:.3g}

baselines:
  position_integral_gain: {2 * by.integral_gain:.3g}
  attitude_integral_gain: {40 * by.integral_gain:.3g}
  dob_Hz: {0.5 * by.rate:.3g}
  mass_prior_std_kg: {0.5 * by.mass:.3g}
  first_moment_prior_std_kgm: {0.05 * by.moment:.3g}
  inertia_prior_std_kgm2: {0.05 * by.inertia:.3g}

termination:
  max_position_error_m: {3 * by.length:.3g}
  max_saturation_time_s: {2 * T:.3g}
"""


def _member(name: str, vehicle: VehicleTemplate, deg: float, radius: float) -> str:
    """Generate the entry of an agent whose heading is relative to the outward direction, and contacts at its tips."""
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    digits, above = (4, 0.05) if vehicle.scale == REFERENCE else (5, 0.05 * vehicle.scale.length)
    positions = ((c * (radius + x) - s * y, s * (radius + x) + c * y, above + z) for x, y, z in vehicle.contact_offset)
    points = [f"[{x:.{digits}f}, {y:.{digits}f}, {float(f'{z:.{digits}f}'):g}]" for x, y, z in positions]
    yaw = (deg + vehicle.heading_deg) % 360
    return f"  - {{name: {name}, type: {vehicle.name}, yaw_deg: {yaw:g}, contact_positions_m: [{', '.join(points)}]}}\n"
