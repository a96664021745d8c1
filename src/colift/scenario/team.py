"""Agents of a scenario: groups, names and postures, and the team.

Agents whose types share a structure form one group, in the order of the file. Agents, contacts and their names are in
the order of the groups.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Array

from colift.math.pytree import transfer
from colift.models import aerial_manipulator
from colift.models.parameters import (
    RIGID,
    SOFT_FINGER,
    AerialManipulator,
    KinematicTree,
    Payload,
    Team,
    stack_agents,
)
from colift.scenario import schema
from colift.scenario.conversion import array, rotation, rows


def team(settings: schema.Scenario) -> tuple[Team, Team]:
    """Return the team with true parameters, and the team with the nominal parameters of the controller."""
    nominal = settings.nominal
    kinds = {name: _nominal_type(kind, nominal.agent_types.get(name)) for name, kind in settings.agent_types.items()}
    return (
        _team(settings, settings.agent_types, settings.payload),
        _team(settings, kinds, nominal.payload or settings.payload),
    )


def group_agents(settings: schema.Scenario) -> list[list[schema.Agent]]:
    """Group the agents by structure, in the order of the file."""
    found: dict[KinematicTree, list[schema.Agent]] = {}
    for agent in settings.agents:
        found.setdefault(_tree(settings.agent_types[agent.type]), []).append(agent)
    return list(found.values())


def agent_models(settings: schema.Scenario) -> dict[str, AerialManipulator]:
    """Return the true model of each agent type in the team; contacts are those of the first agent of the type."""
    first = {agent.type: agent for agent in reversed(settings.agents)}
    return {name: _agent(settings, kind, first[name]) for name, kind in settings.agent_types.items() if name in first}


def agent_names(settings: schema.Scenario) -> tuple[str, ...]:
    """Return the names of the agents, in team order."""
    return tuple(agent.name for group in group_agents(settings) for agent in group)


def contact_names(settings: schema.Scenario) -> tuple[str, ...]:
    """Return `agent/arm` of every contact, in team order."""
    kinds = settings.agent_types
    return tuple(
        f"{agent.name}/{arm.name}"
        for group in group_agents(settings)
        for agent in group
        for arm in kinds[agent.type].arms
    )


def contact_types(settings: schema.Scenario) -> tuple[str, ...]:
    """Return the type of every contact, in team order."""
    kinds = settings.agent_types
    return tuple(arm.contact for group in group_agents(settings) for agent in group for arm in kinds[agent.type].arms)


def joint_names(settings: schema.Scenario) -> tuple[str, ...]:
    """Return `agent/joint` of every joint, in team order."""
    kinds = settings.agent_types
    return tuple(
        f"{agent.name}/{joint.name}"
        for group in group_agents(settings)
        for agent in group
        for joint in kinds[agent.type].joints
    )


def initial_yaw(settings: schema.Scenario) -> tuple[Array, ...]:
    """Return the yaw angle of every agent [rad], by group."""
    return tuple(array(np.deg2rad([agent.yaw_deg for agent in group])) for group in group_agents(settings))


def nominal_posture(settings: schema.Scenario) -> tuple[Array, ...]:
    """Return the joint positions at rest [rad or m], by group."""
    kinds = settings.agent_types
    return tuple(
        array(
            np.reshape(
                [
                    j.nominal_position_rad if isinstance(j, schema.Revolute) else j.nominal_position_m
                    for a in group
                    for j in kinds[a.type].joints
                ],
                (len(group), -1),
            )
        )
        for group in group_agents(settings)
    )


def _team(settings: schema.Scenario, kinds: dict[str, schema.AgentType], payload: schema.Payload) -> Team:
    return Team(
        agent_groups=tuple(
            stack_agents([_agent(settings, kinds[a.type], a) for a in group]) for group in group_agents(settings)
        ),
        payload=Payload(mass=array(payload.mass_kg), inertia=array(payload.inertia_kgm2)),
        gravity=array(settings.gravity_mps2),
    )


def _nominal_type(kind: schema.AgentType, nominal: schema.NominalAgentType | None) -> schema.AgentType:
    if nominal is None:
        return kind
    joints = tuple(j.model_copy(update={"body": nominal.joints.get(j.name, j.body)}) for j in kind.joints)
    return kind.model_copy(update={"base": nominal.base or kind.base, "joints": joints})


def body_names(kind: schema.AgentType) -> list[str]:
    """Return the names of the bodies of an agent type, base first."""
    return ["base", *(joint.name for joint in kind.joints)]


def _tree(kind: schema.AgentType) -> KinematicTree:
    index = {name: i for i, name in enumerate(body_names(kind))}
    return KinematicTree(
        parents=tuple(index[joint.parent] for joint in kind.joints),
        prismatic=tuple(joint.type == "prismatic" for joint in kind.joints),
        tip_bodies=tuple(index[arm.joint] for arm in kind.arms),
        contact_types=() if all(arm.contact == "point" for arm in kind.arms) else tuple(a.contact for a in kind.arms),
    )


def _agent(settings: schema.Scenario, kind: schema.AgentType, agent: schema.Agent) -> AerialManipulator:
    parts = [kind.base, *(joint.body for joint in kind.joints)]
    axes = np.array([joint.axis for joint in kind.joints]).reshape(-1, 3)
    model = AerialManipulator(
        tree=_tree(kind),
        mass=array([body.mass_kg for body in parts]),
        com=array([body.center_of_mass_m for body in parts]),
        inertia=array([body.inertia_kgm2 for body in parts]),
        joint_position=rows([joint.position_m for joint in kind.joints]),
        joint_rotation=transfer(np.array([rotation(j.rpy_deg) for j in kind.joints], dtype=float).reshape(-1, 3, 3)),
        joint_axis=array(axes / np.linalg.norm(axes, axis=1, keepdims=True)),
        tip_position=rows([arm.tip_position_m for arm in kind.arms]),
        contact_position=rows(agent.contact_positions_m),
        thrust_max=array(kind.thrust_max_N),
    )
    return _with_moments(settings, kind, agent, model) if model.tree.contact_types else model


def _with_moments(
    settings: schema.Scenario, kind: schema.AgentType, agent: schema.Agent, model: AerialManipulator
) -> AerialManipulator:
    """Return an agent with the directions in which its contacts bear moments, and the orientations of rigid grips."""
    normals = {} if isinstance(settings.physics, schema.Plugin) else settings.physics.contact.normal or {}
    axes: list[np.ndarray] = []
    for arm in kind.arms:
        if arm.contact == SOFT_FINGER:
            normal = np.array(normals[f"{agent.name}/{arm.name}"])  # the checks of the settings require it
            axes.append(normal[None] / np.linalg.norm(normal))
        elif arm.contact == RIGID:
            axes.append(np.eye(3))
    grips = None
    if RIGID in model.tree.contact_types:
        posture = np.array(
            [j.nominal_position_rad if isinstance(j, schema.Revolute) else j.nominal_position_m for j in kind.joints]
        )
        bodies = np.asarray(aerial_manipulator.forward_kinematics(model, array(posture)).rotation)
        grips = array(rotation((0.0, 0.0, agent.yaw_deg)) @ bodies[list(model.tree.tip_bodies)])
    return dataclasses.replace(model, moment_axis=array(np.concatenate(axes)), grip_rotation=grips)
