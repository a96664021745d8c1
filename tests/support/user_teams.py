"""Teams as a user makes them: a vehicle from a URDF file, the scenario of `init`, and another payload.

The nominal mass and inertia of the payload are 0.8 times the true ones, as in the scenario of `init`.
"""

from __future__ import annotations

import itertools
import json
import re
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from colift.scenario import Scenario, loading, scaling, vehicle_import

AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
GYRATION = np.array([0.0133, 0.0133, 0.0233])
"""Principal moments of the base, relative to mass times squared length scale [m^2]."""
PAYLOADS = tuple(itertools.product(("bar", "plate", "box"), ("small", "medium", "large")))
LENGTHS = {"bar": (1.0, 1.6, 2.4), "plate": (0.8, 1.3, 2.0), "box": (0.6, 1.0, 1.5)}
"""Lengths of small, medium and large payloads, relative to the length scale [m]."""
MASSES = (0.7, 1.0, 1.4)
"""Masses of small, medium and large payloads, relative to that of `init`."""


def vehicle(mass: float, length: float, axes: str, links: Sequence[float], link_masses: Sequence[float]) -> str:
    """Return the URDF text of a vehicle with a chain of revolute joints below its base.

    Args:
        mass: Mass of the base [kg].
        length: Length scale; 1 for the inertia of a vehicle of 1.5 kg.
        axes: Axes of the joints, for example `xyy`; empty for a rigid hook.
        links: Lengths of the links [m]; for a hook the distance from the base to the tip.
        link_masses: Masses of the links [kg].
    """
    text = ['<?xml version="1.0"?>\n<robot name="vehicle">', _link("base_link", mass, 0.0, mass * length**2 * GYRATION)]
    parent, height = "base_link", 0.05 * length if axes else links[0]
    for k, (axis, link, link_mass) in enumerate(zip(axes, links, link_masses, strict=len(axes) > 0)):
        across = link_mass * link**2 / 12
        text += [
            _link(f"link_{k}", link_mass, -link / 2, np.array([across, across, 0.1 * across])),
            _joint(f"joint_{k}", parent, f"link_{k}", -height, axis),
        ]
        parent, height = f"link_{k}", link
    text += [_link("tool", 0.005 * mass, 0.0, np.full(3, 5e-7 * mass)), _joint("grip", parent, "tool", -height)]
    return "\n".join([*text, "</robot>\n"])


def _link(name: str, mass: float, z: float, inertia: np.ndarray) -> str:
    x, y, yaw = inertia
    moments = f'ixx="{x:.6g}" iyy="{y:.6g}" izz="{yaw:.6g}" ixy="0" ixz="0" iyz="0"'
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {z:.6g}"/><mass value="{mass:.6g}"/><inertia {moments}/>'
        "</inertial></link>"
    )


def _joint(name: str, parent: str, child: str, z: float, axis: str = "") -> str:
    kind = "revolute" if axis else "fixed"
    turn = f'<axis xyz="{" ".join(map(str, AXES[axis]))}"/><limit lower="-1.57" upper="1.57"/>' if axis else ""
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="0 0 {z:.6g}"/><parent link="{parent}"/><child '
        f'link="{child}"/>{turn}</joint>'
    )


VEHICLES = {
    "planar": vehicle(1.5, 1.0, "yy", (0.16, 0.14), (0.15, 0.12)),
    "three_joints": vehicle(2.5, 1.1, "xyy", (0.06, 0.16, 0.16), (0.1, 0.15, 0.12)),
    "hook": vehicle(0.716, 0.85, "", (0.15,), ()),
}


def written_by_init(text: str, folder: Path, agents: int | None = None) -> Scenario:
    """Return the scenario that `init --urdf` writes for a URDF text."""
    file = folder / "vehicle.urdf"
    file.write_text(text, encoding="utf-8")
    generated = vehicle_import.from_urdf_file("team", agents, file, folder)
    return loading.parse(generated.text, str(folder / "team.yaml"))


def with_payload(settings: Scenario, kind: str, length: float, mass_ratio: float) -> Scenario:
    """Replace the payload and the contacts of a scenario of `init`.

    Args:
        settings: Scenario of `init`, with one contact per agent.
        kind: `bar` (contacts along its length on both sides), `plate` (on a circle) or `box` (on its top face).
        length: Longest side, relative to the length scale of the vehicle [m].
        mass_ratio: Mass relative to that of `init`.
    """
    scale = float(np.hypot(*settings.agents[0].contact_positions_m[0][:2])) / 0.5
    mass, side, agents = mass_ratio * settings.payload.mass_kg, length * scale, len(settings.agents)
    angle = 2 * np.pi * np.arange(agents) / agents
    if kind == "bar":
        x, y, z = np.array([1.0, 0.2, 0.1]) * side
        sign = np.where(np.arange(agents) % 2, -1.0, 1.0)
        contacts = np.stack([np.linspace(-0.45, 0.45, agents) * x, 0.45 * sign * y, np.full(agents, z / 2)], axis=1)
    else:
        x, y, z = np.array([1.0, 1.0, 0.05] if kind == "plate" else [1.0, 0.8, 0.6]) * side
        contacts = np.stack([0.45 * x * np.cos(angle), 0.45 * y * np.sin(angle), np.full(agents, z / 2)], axis=1)
    inertia = mass / 12 * np.array([y**2 + z**2, x**2 + z**2, x**2 + y**2])
    bodies = [
        body.model_copy(update={"mass_kg": share * mass, "inertia_kgm2": _rows(share * inertia)})
        for body, share in ((settings.payload, 1.0), (settings.nominal.payload, 0.8))
    ]
    members = tuple(
        agent.model_copy(update={"contact_positions_m": (tuple(point.round(5).tolist()),)})
        for agent, point in zip(settings.agents, contacts, strict=True)
    )
    nominal = settings.nominal.model_copy(update={"payload": bodies[1]})
    return settings.model_copy(update={"agents": members, "payload": bodies[0], "nominal": nominal})


def _rows(moments: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, np.diag(moments).tolist()))


def user_team(name: str, kind: str, size: str, folder: Path) -> Scenario:
    """Return one of the 27 teams of `VEHICLES` and `PAYLOADS`."""
    k = ("small", "medium", "large").index(size)
    return with_payload(written_by_init(VEHICLES[name], folder), kind, LENGTHS[kind][k], MASSES[k])


def drawn_team(seed: int, folder: Path) -> Scenario:
    """Return a team of 3 to 5 agents of 0.03 to 30 kg with arms of 0 to 3 joints, or of two agents with two arms each.

    Links have 3 to 10 % of the mass of the base. The lever from the base to the tip is 0.1 to 0.5 m for the size of a
    vehicle of 1.5 kg.
    """
    rng = np.random.default_rng(seed)
    mass = float(np.exp(rng.uniform(*np.log((0.03, 30.0)))))
    length = (mass / scaling.REFERENCE_MASS) ** (1 / 3) * rng.uniform(0.8, 1.25)
    agents, kind = int(rng.integers(2, 6)), str(rng.choice(["bar", "plate", "box"]))
    side, mass_ratio = rng.uniform(LENGTHS[kind][0], LENGTHS[kind][2]), rng.uniform(MASSES[0], MASSES[2])
    if agents == 2:
        return _heavier(written_by_init(_two_arms(rng, mass, length), folder, agents), mass_ratio)
    joints, lever = int(rng.integers(0, 4)), length * rng.uniform(0.1, 0.5)
    axes = "".join(rng.choice(["x", "y"], joints))
    links = lever * rng.dirichlet(np.full(max(joints, 1), 5.0))
    text = vehicle(mass, length, axes, links.tolist(), (mass * rng.uniform(0.03, 0.1, joints)).tolist())
    return with_payload(written_by_init(text, folder, agents), kind, side, mass_ratio)


def _two_arms(rng: np.random.Generator, mass: float, length: float) -> str:
    """Return a vehicle with a waist and two arms of one joint, which `init` bends."""
    link, link_mass = length * rng.uniform(0.2, 0.4), mass * rng.uniform(0.03, 0.1)
    across = link_mass * link**2 / 12
    text = [
        '<robot name="vehicle">',
        _link("base_link", mass, 0.0, mass * length**2 * GYRATION),
        _link("waist", 0.05 * mass, 0.0, np.full(3, 0.002 * mass * length**2)),
        _joint("turn", "base_link", "waist", 0.0, "z"),
    ]
    for side, y in (("left", 0.08), ("right", -0.08)):
        arm = _joint(side, "waist", f"{side}_arm", 0.0, "x").replace('xyz="0 0 0"', f'xyz="0 {y * length:.6g} 0"', 1)
        text += [
            _link(f"{side}_arm", link_mass, -link / 2, np.array([across, across, 0.1 * across])),
            arm,
            _link(f"{side}_tool", 0.005 * mass, 0.0, np.full(3, 5e-7 * mass)),
            _joint(f"{side}_grip", f"{side}_arm", f"{side}_tool", -link),
        ]
    return "\n".join([*text, "</robot>\n"])


def _heavier(settings: Scenario, ratio: float) -> Scenario:
    """Scale mass and inertia of a payload."""
    bodies = [
        body.model_copy(
            update={
                "mass_kg": ratio * body.mass_kg,
                "inertia_kgm2": tuple(tuple(ratio * x for x in row) for row in body.inertia_kgm2),
            }
        )
        for body in (settings.payload, settings.nominal.payload)
    ]
    nominal = settings.nominal.model_copy(update={"payload": bodies[1]})
    return settings.model_copy(update={"payload": bodies[0], "nominal": nominal})


# Advice ---------------------------------------------------------------------------------------------------------------


def options_in(advice: str) -> list[str]:
    """Return the words `path=value` that a shell passes to `--set` for an advice."""
    return [word for found in re.findall(r"--set ('[^']*'|\S+)", advice) for word in shlex.split(found)]


def with_options(settings: Scenario, options: Iterable[str]) -> Scenario:
    """Return a scenario with settings replaced as by `--set path=value`."""
    tree = settings.model_dump(mode="json")
    for path, _, value in (option.partition("=") for option in options):
        node, (*keys, last) = tree, path.split(".")
        for key in keys:
            node = _entry(node, key)
        node[int(last) if isinstance(node, list) else last] = json.loads(value)
    return Scenario.model_validate(tree)


def _entry(node: dict | list, key: str) -> dict | list:
    """Return the entry of a mapping, or the element of a list with a name or index."""
    if isinstance(node, dict):
        return node[key]
    named = [each for each in node if isinstance(each, dict) and each.get("name") == key]
    return named[0] if named else node[int(key)]
