"""Team of different agents in Python, without a scenario file: only the plant, under constant inputs.

Two vehicles with a waist and two arms hold the payload at its ends; one vehicle with a single arm holds it in the
middle. Thrust carries the weight, and joint torques are zero. Run it with `python examples/02_own_team.py`.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from colift.models import grasp, parameters, state, validation
from colift.models.parameters import AerialManipulator, KinematicTree, Payload, Team
from colift.models.state import AgentInput, AgentState, PayloadState, State
from colift.simulation import contact_dynamics

NAMES = ("rear", "front", "middle")
STEP = 1e-3  # s
ROD = np.diag([9e-4, 9e-4, 1e-5])  # kg m^2, an arm of 0.12 kg and 0.3 m


def two_arms(contact: list[list[float]]) -> AerialManipulator:
    """Return a vehicle with a waist about z and two arms about x; joint k moves body k + 1, and body 0 is the base."""
    return AerialManipulator(
        tree=KinematicTree(parents=(0, 1, 1), prismatic=(False, False, False), tip_bodies=(2, 3)),
        mass=jnp.array([1.5, 0.1, 0.12, 0.12]),  # kg
        com=jnp.array([[0.0, 0, 0], [0, 0, 0], [0, 0, -0.15], [0, 0, -0.15]]),  # m
        inertia=jnp.array([np.diag([0.02, 0.02, 0.035]), 1e-4 * np.eye(3), ROD, ROD]),
        joint_position=jnp.array([[0, 0, 0], [0, 0.08, 0], [0, -0.08, 0]]),
        joint_rotation=jnp.array([np.eye(3)] * 3),
        joint_axis=jnp.array([[0.0, 0, 1], [1, 0, 0], [1, 0, 0]]),
        tip_position=jnp.array([[0, 0, -0.3], [0, 0, -0.3]]),
        contact_position=jnp.array(contact),
        thrust_max=jnp.array(50.0),  # N
    )


def one_arm(contact: list[float]) -> AerialManipulator:
    """Return a vehicle with a boom that has a pitch joint and a prismatic joint."""
    return AerialManipulator(
        tree=KinematicTree(parents=(0, 1), prismatic=(False, True), tip_bodies=(2,)),
        mass=jnp.array([1.0, 0.08, 0.05]),
        com=jnp.array([[0.0, 0, 0], [0, 0, -0.05], [0, 0, -0.1]]),
        inertia=jnp.array([np.diag([0.012, 0.012, 0.02]), 1e-4 * np.eye(3), 1e-4 * np.eye(3)]),
        joint_position=jnp.array([[0, 0, -0.05], [0, 0, -0.05]]),
        joint_rotation=jnp.array([np.eye(3)] * 2),
        joint_axis=jnp.array([[0.0, 1, 0], [0, 0, -1]]),
        tip_position=jnp.array([[0, 0, -0.15]]),
        contact_position=jnp.array([contact]),
        thrust_max=jnp.array(30.0),
    )


def build() -> Team:
    """Return the team: agents with equal `KinematicTree` are stacked in a group, and a team is a tuple of groups."""
    pair = parameters.stack_agents([two_arms([[x, 0.36, 0.05], [x, -0.36, 0.05]]) for x in (-0.5, 0.5)])
    single = parameters.stack_agents([one_arm([0.0, 0.0, 0.1])])
    return Team(
        agent_groups=(pair, single),
        payload=Payload(mass=jnp.array(1.5), inertia=jnp.diag(jnp.array([0.04, 0.15, 0.18]))),
        gravity=jnp.array([0.0, 0, -9.81]),
    )


def start(team: Team) -> State:
    """Return a consistent state on the grasp from a guess; unphysical bodies and singular grasps raise ValueError."""
    at_rest = lambda x, r: AgentState(  # noqa: E731
        R=jnp.array([np.eye(3)] * len(x)),
        x=jnp.array(x),
        r=jnp.array(r),
        omega=jnp.zeros((len(x), 3)),
        v=jnp.zeros((len(x), 3)),
        r_dot=jnp.zeros((len(x), len(r[0]))),
    )
    guess = State(
        agents=(
            at_rest([[-0.5, 0, 0.13], [0.5, 0, 0.13]], [[0.0, 1.2, -1.2]] * 2),
            at_rest([[0.06, 0, 0.33]], [[0.3, 0.0]]),
        ),
        payload=PayloadState(R=jnp.eye(3), p=jnp.zeros(3), omega=jnp.zeros(3), v=jnp.zeros(3)),
    )
    validation.validate_team(team, NAMES)
    z = contact_dynamics.consistent_initial_state(team, guess, NAMES)
    grasp.check_grasp(team, z, NAMES)
    return z


def inputs(team: Team) -> contact_dynamics.TeamInputs:
    """Return thrusts that carry each agent's weight and an equal share of the payload's."""
    share = team.payload.mass / sum(team.sizes)
    return tuple(
        AgentInput(u=9.81 * (group.mass.sum(1) + share), tau=jnp.zeros((n, 3)), tau_r=jnp.zeros((n, group.tree.joints)))
        for n, group in zip(team.sizes, team.agent_groups, strict=True)
    )


@jax.jit
def step(team: Team, z: State) -> State:
    """Return the state after one fourth-order step and the projection; new values of `team` need no compilation."""
    free = contact_dynamics.rkmk4_step(team, z, inputs(team), lambda _z, _t: state.zero_residual(team), jnp.array(STEP))
    return contact_dynamics.project_to_constraints(team, free)


def main() -> None:
    """Print the contact forces on the payload [N, world frame] every 50 ms."""
    team = build()
    z, labels = start(team), grasp.contact_names(team, NAMES)
    print("t [s]   " + "".join(f"{label:>24}" for label in labels))
    for k in range(201):
        if k % 50 == 0:
            _, lam = jax.jit(contact_dynamics.forward_dynamics)(team, z, inputs(team), state.zero_residual(team))
            forces = np.asarray(grasp.stack_contacts(lam))
            print(f"{k * STEP:5.3f}   " + "".join(f"{x:8.3f}{y:8.3f}{f:8.3f}" for x, y, f in forces))
        z = step(team, z)


if __name__ == "__main__":
    main()
