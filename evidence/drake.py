"""Comparison of the plant with Drake: case C1 in Drake's multibody dynamics at three steps, extrapolated to step zero.

Drake's parser builds the bodies from the file of `colift export mjcf`. Contacts are Drake's ball constraints; its
discrete solver (SAP) integrates them implicitly with first order. Errors decrease with the step, so three steps give
the limit `(8 x(h/4) - 6 x(h/2) + x(h)) / 3`. Initial state, noise and residuals are those of the colift flight. Contact
forces follow from Drake's inverse dynamics and Jacobians.

Drake is large and not in a lock file: `.venv/bin/python -m pip install drake` (Linux or macOS; 1.51.1 was used). The
stored result is judged without it.
"""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree as ET

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial.transform import Rotation

from colift import scenario
from colift.closed_loop import signals
from colift.closed_loop.flight import Experiment, run_experiment
from colift.math.pytree import pytree, static
from colift.models import mjcf
from colift.models.parameters import Team, agent_names
from colift.models.state import ResidualForces, ResidualFunctionType, State, TeamInputs
from colift.scenario import experiment
from colift.simulation import mujoco_plant
from colift.simulation.contact_dynamics import Acceleration, AgentAcceleration
from evidence import collect
from evidence.engines import TARGETS, differences

DURATION = 5.0  # s
SUBSTEPS = (2, 4, 8)  # of a control period of 2 ms
JUDGED = ("position_m", "attitude_deg", "relative_force_rms", "relative_force_peak")
HELD = ("p", "R_L", "x", "R", "lam")  # compared quantities
MISSING = "drake: not installed; `.venv/bin/python -m pip install drake`, see the head of evidence/drake.py"


@pytree
class Drake:
    """A team in Drake as the plant of a world. The step is data, so flights with any step share one program."""

    h: Float[Array, ""]  # s, one of those of the hosts
    hosts: Hosts = static()

    def forward_dynamics(
        self, team: Team, state: State, inputs: TeamInputs, f: ResidualForces
    ) -> tuple[Acceleration, tuple[Float[Array, "_agents _arms 3"], ...]]:
        """Compute accelerations and contact forces, as `mujoco_plant.MujocoPlant.forward_dynamics`."""
        like = tuple(
            AgentAcceleration(v_dot=q.v, xi_dot=jnp.concatenate([q.omega, q.r_dot], axis=1)) for q in state.agents
        )
        contacts = tuple(group.contact_position for group in team.agent_groups)
        results = [jnp.zeros(6), *mujoco_plant._join_groups(like), *mujoco_plant._join_groups(contacts)]
        a_L, *of_agents, lam = mujoco_plant._call_host(self.hosts.forward_dynamics, results, state, inputs, f, self.h)
        return Acceleration(
            agents=mujoco_plant._split_groups(like, of_agents), payload=a_L
        ), mujoco_plant._split_groups(contacts, [lam])

    def step(
        self,
        team: Team,  # noqa: ARG002
        state: State,
        inputs: TeamInputs,
        residual: ResidualFunctionType,
        dt: Float[Array, ""],
    ) -> State:
        """Simulate one step, as `mujoco_plant.MujocoPlant.step`."""

        def one(k: Array, state: State) -> State:
            load, kind = jax.tree.flatten(state.payload)
            f = residual(state, k.astype(dt.dtype) * self.h)
            after = mujoco_plant._call_host(self.hosts.step, mujoco_plant._state_rows(state), state, inputs, f, self.h)
            rows, of_load = after[: -len(load)], after[-len(load) :]
            return State(agents=mujoco_plant._split_groups(state.agents, rows), payload=kind.unflatten(of_load))

        return jax.lax.fori_loop(0, jnp.round(dt / self.h).astype(int), one, state)


class Hosts:
    """One session per step [s]; the last number of a request selects it."""

    def __init__(self, team: Team, z: State, steps: Sequence[float]) -> None:
        self.of = {h: Session(team, z, h) for h in steps}

    def forward_dynamics(self, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        return self.of[rows[-1].item()].forward_dynamics(*rows[:-1])

    def step(self, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        return self.of[rows[-1].item()].step(*rows[:-1])


class Session:
    """Drake's model of a team with step h [s]; rows of numbers are those of `mujoco_plant.MujocoSession`."""

    def __init__(self, team: Team, z: State, h: float) -> None:
        try:
            from pydrake.multibody.parsing import Parser
            from pydrake.multibody.plant import MultibodyPlant
            from pydrake.multibody.tree import JacobianWrtVariable
        except ModuleNotFoundError as error:
            raise SystemExit(MISSING) from error
        self.h, self.by_rate, self.names = h, JacobianWrtVariable.kV, agent_names(team)
        self.plant = plant = MultibodyPlant(h)
        self.own = self._read(Parser(plant), ET.fromstring(mjcf.to_mjcf(team, z)))
        joints, parts = iter(mjcf.joint_names(team)), []
        self.tips: list[list[tuple[Any, np.ndarray]]] = []
        payload = plant.GetBodyByName("payload")
        for group, size in zip(team.agent_groups, team.sizes, strict=True):
            for j, name in enumerate(self.names[len(parts) : len(parts) + size]):
                agent = jax.tree.map(lambda x, j=j: np.asarray(x)[j], group)
                moved = [next(joints) for _ in range(agent.tree.joints)]
                bodies = [plant.GetBodyByName(body) for body in (name, *moved)]
                tips = [(bodies[tip], at) for tip, at in zip(agent.tree.tip_bodies, agent.tip_position, strict=True)]
                for (body, at), held in zip(tips, agent.contact_position, strict=True):
                    plant.AddBallConstraint(body, at, payload, held)
                self.tips.append(tips)
                parts.append((bodies[0], moved, float(agent.mass.sum())))
        plant.SetUseSampledOutputPorts(False)  # otherwise the discrete update cannot be computed separately
        plant.Finalize()
        self.context = plant.CreateDefaultContext()
        self.mass = np.array([mass for *_, mass in parts])
        floating = [payload, *(base for base, *_ in parts)]
        self.q = np.array([body.floating_positions_start() for body in floating])
        first = [body.floating_velocities_start_in_v() for body in floating]
        turning, moving = np.array(first)[:, None] + [0, 1, 2], np.array(first)[:, None] + [3, 4, 5]
        self.load_w, self.load_v, self.w, self.v = turning[0], moving[0], turning[1:], moving[1:]
        hinges = [[plant.GetJointByName(joint) for joint in moved] for _, moved, _ in parts]
        self.joint_q = np.array([joint.position_start() for some in hinges for joint in some], int)
        self.joint_v = [np.array([joint.velocity_start() for joint in some], int) for some in hinges]

    @staticmethod
    def _read(parser: Any, root: ET.Element) -> list[Any]:
        """Read Drake's model instance of every agent: one document per body, so that Drake computes centers of mass
        by agent.
        """
        bodies, shared, made = root.find("worldbody"), [root.find(tag) for tag in ("compiler", "option", "default")], []
        for body in list(bodies):
            alone = ET.Element("mujoco", model=f"{body.get('name')} alone")
            alone.extend(shared)
            ET.SubElement(alone, "worldbody").append(body)
            (instance,) = parser.AddModelsFromString(ET.tostring(alone, encoding="unicode"), "xml")
            made.append(instance)
        return made[1:]  # the payload comes first

    def step(self, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the state after one step, as rows."""
        self._set(*rows)
        self.context.SetDiscreteState(self._next())
        return self._state()

    def forward_dynamics(self, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return `a_L, v_dot, xi_dot, lam` of a state under inputs and a residual, from Drake's next step.

        A contact force is the remainder of the agent's inverse dynamics, converted by the Jacobians of its tips.
        """
        plant, context = self.plant, self.context
        given = self._set(*rows)
        R_L, R = self._attitudes()
        v = plant.GetVelocities(context)
        a = (self._next()[plant.num_positions() :] - v) / self.h
        gravity = self._forces()
        left = plant.CalcInverseDynamics(context, a, gravity) - given
        lam = []
        for k, tips in enumerate(self.tips):
            own = np.concatenate([self.w[k], self.v[k], self.joint_v[k]])
            J = np.concatenate([self._jacobian(body, at)[:, own] for body, at in tips])
            lam.append(-np.linalg.lstsq(J.T, left[own], rcond=None)[0])
        of_agents = np.array([x.reshape(-1, 3).sum(0) for x in lam])
        v_dot = plant.gravity_field().gravity_vector() + (self.applied - of_agents) / self.mass[:, None]
        turning = np.einsum("nji,nj->ni", R, a[self.w])
        xi_dot = [np.concatenate([w, a[joints]]) for w, joints in zip(turning, self.joint_v, strict=True)]
        load = np.concatenate([a[self.load_v], R_L.T @ a[self.load_w]])
        return load, v_dot.ravel(), np.concatenate(xi_dot), np.concatenate(lam)

    def _forces(self) -> Any:
        from pydrake.multibody.tree import MultibodyForces

        forces = MultibodyForces(self.plant)
        self.plant.CalcForceElementsContribution(self.context, forces)
        return forces

    def _next(self) -> np.ndarray:
        return self.plant.EvalUniquePeriodicDiscreteUpdate(self.context).value().copy()

    def _jacobian(self, body: Any, at: np.ndarray) -> np.ndarray:
        world = self.plant.world_frame()
        return self.plant.CalcJacobianTranslationalVelocity(
            self.context, self.by_rate, body.body_frame(), at, world, world
        )

    def _set(self, *rows: np.ndarray) -> np.ndarray:
        """Set state, inputs and residual as `MujocoSession` takes them; return the generalized forces [N, N m]."""
        plant, (*state, u, tau, tau_r, f_x, f_w, f_r, F, torque) = self.plant, rows
        self._place(*state)
        R_L, R = self._attitudes()
        thrust, pull = R[:, :, 2] * u[:, None], f_x.reshape(-1, 3)
        self.applied = thrust + pull
        given = np.zeros(plant.num_velocities())
        given[self.w] = np.einsum("nij,nj->ni", R, (tau + f_w).reshape(-1, 3))
        given[self.v] = thrust
        given[np.concatenate(self.joint_v)] = tau_r + f_r
        given[self.load_w], given[self.load_v] = R_L @ torque, F
        world = plant.world_frame()
        for instance, force in zip(self.own, pull, strict=True):
            J = plant.CalcJacobianCenterOfMassTranslationalVelocity(
                self.context, [instance], self.by_rate, world, world
            )
            given += J.T @ force
        plant.get_applied_generalized_force_input_port().FixValue(self.context, given)
        return given

    def _place(self, *state: np.ndarray) -> None:
        """Set Drake's coordinates: first with all base origins at zero, then moved by the centers of mass."""
        R, x, r, omega, v, r_dot, R_L, p, omega_L, v_L = state
        plant = self.plant
        q, rates = np.zeros(plant.num_positions()), np.zeros(plant.num_velocities())
        turned = np.concatenate([R_L.reshape(1, 3, 3), R.reshape(-1, 3, 3)])
        q[self.q[:, None] + [0, 1, 2, 3]] = Rotation.from_matrix(turned).as_quat(scalar_first=True)
        q[self.q[0] + [4, 5, 6]], q[self.joint_q] = p, r
        rates[self.load_w], rates[self.load_v] = turned[0] @ omega_L, v_L
        rates[self.w] = np.einsum("nij,nj->ni", turned[1:], omega.reshape(-1, 3))
        rates[np.concatenate(self.joint_v)] = r_dot
        self._put(q, rates)
        centre, speed = self._centres()
        q[self.q[1:, None] + [4, 5, 6]] = x.reshape(-1, 3) - centre
        rates[self.v] = v.reshape(-1, 3) - speed
        self._put(q, rates)

    def _put(self, q: np.ndarray, v: np.ndarray) -> None:
        self.plant.SetPositionsAndVelocities(self.context, np.concatenate([q, v]))

    def _centres(self) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [m] and velocities [m/s] of the agents' centers of mass."""
        plant, context = self.plant, self.context
        return (
            np.array([plant.CalcCenterOfMassPositionInWorld(context, [one]) for one in self.own]),
            np.array([plant.CalcCenterOfMassTranslationalVelocityInWorld(context, [one]) for one in self.own]),
        )

    def _attitudes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return attitudes of the payload and of the agents' bases."""
        q = self.plant.GetPositions(self.context)
        R = Rotation.from_quat(q[self.q[:, None] + [0, 1, 2, 3]], scalar_first=True).as_matrix()
        return R[0], R[1:]

    def _state(self) -> tuple[np.ndarray, ...]:
        """Return the state by the inverse of `_place`."""
        q, rates = self.plant.GetPositions(self.context), self.plant.GetVelocities(self.context)
        R_L, R = self._attitudes()
        centre, speed = self._centres()
        omega = np.einsum("nji,nj->ni", R, rates[self.w])
        agents = (R, centre, q[self.joint_q], omega, speed, rates[np.concatenate(self.joint_v)])
        load = (R_L, q[self.q[0] + [4, 5, 6]], R_L.T @ rates[self.load_w], rates[self.load_v])
        return tuple(np.ravel(x) for x in agents + load)


def simulate_case(case_experiment: Experiment, plant: Drake | None = None) -> tuple[signals.StepRecord, float]:
    """Return a flight, with the rigid-contact plant by default, and its processor time [s] with compilation."""
    if plant:
        case_experiment = dataclasses.replace(
            case_experiment, world=dataclasses.replace(case_experiment.world, plant=plant)
        )
    began = time.process_time()
    flight = run_experiment(case_experiment)
    if flight.termination_reason:
        raise SystemExit(f"drake: {flight.termination_reason}")
    return flight.records, time.process_time() - began


def extrapolated(rows: Sequence[signals.StepRecord]) -> signals.StepRecord:
    """Return the extrapolation to step zero of three flights, each with half the step of the one before."""
    taken = {name: (np.array([1, -6, 8]) / 3) @ _stacked(rows, name) for name in HELD}
    return dataclasses.replace(rows[-1], **{k: x.reshape(getattr(rows[-1], k).shape) for k, x in taken.items()})


def _stacked(rows: Sequence[signals.StepRecord], name: str) -> np.ndarray:
    return np.stack([np.asarray(getattr(row, name)).ravel() for row in rows])


def judge(_: str) -> dict[str, Any]:
    """Compare every step and the extrapolation with the rigid-contact plant, and the convergence of the payload's
    path.
    """
    from importlib.metadata import version

    case_experiment = dataclasses.replace(
        experiment.make_experiment(scenario.load_scenario("paper"), "C1"), duration=DURATION
    )
    steps_s = [case_experiment.dt / n for n in SUBSTEPS]
    hosts = Hosts(case_experiment.world.team, case_experiment.initial_state, steps_s)
    flights = [simulate_case(case_experiment, Drake(h=jnp.asarray(h), hosts=hosts)) for h in steps_s]
    ours, ours_s = simulate_case(case_experiment)
    rows = [row for row, _ in flights]
    found = {
        f"{2 / n:g} ms": differences(row, ours) | {"cpu_time_s": s}
        for n, (row, s) in zip(SUBSTEPS, flights, strict=True)
    }
    p = [np.asarray(row.p) for row in rows]
    steps = [float(np.abs(a - b).max()) for a, b in itertools.pairwise(p)]
    return {
        "drake_version": version("drake"),
        "duration_s": DURATION,
        "differences": found,
        "extrapolated": {k: x for k, x in differences(extrapolated(rows), ours).items() if k in JUDGED},
        "convergence_order": float(np.log2(steps[0] / steps[1])),
        "colift_cpu_time_s": ours_s,
    }


def main() -> bool:
    """Simulate C1 in Drake; the extrapolation must meet the targets of MuJoCo's."""
    found = collect("drake", ("C1",), judge)["C1"]
    for name, row in (found["differences"] | {"extrapolated": found["extrapolated"]}).items():
        print(f"{name:14}", "  ".join(f"{what} {value:.3g}" for what, value in row.items()))
    print(f"Drake {found['drake_version']}, order of the payload's path in the step: {found['convergence_order']:.2f}")
    return all(found["extrapolated"][what] <= most for what, most in TARGETS.items())


if __name__ == "__main__":
    main()
