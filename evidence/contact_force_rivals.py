"""Contact forces of two estimators of the literature, flown in place of colift's, on three teams.

- `extended_kalman_filter`: states are the generalized momentum and the contact forces of an agent, which follow a
  random walk (Simon 2006, ch. 13). Measured configuration and rates are inputs.
- `variational_filter`: generalized-momentum observer whose process noise adapts by a variational Kalman filter in a
  sliding window, as proposed by Yan et al. 2025. The recursions are those of Huang et al. 2020, with known measurement
  noise and one filter for each generalized coordinate; those of Yan et al. may differ in details. Its states are
  momentum and external force. The contact forces follow from them by the linear model of `momentum_observer`.

Both have the sensors of `momentum_observer`. They are flown without a calibration, and with the residual model of a
calibration flight of 10 s, which their references do not contain. Their contact forces are not averaged. Their
constants follow from equal numbers of trials with seeds that are not flown here.

References:
    Simon, *Optimal State Estimation*, 2006, ch. 13 (extended Kalman filter).
    Yan, Lyu, Chen, Zhang, *An Adaptive External Torque Estimation Algorithm for Collision Detection in Robotic Arms*,
    Sensors 25(20), 6315, 2025 (momentum observer with adaptive process noise).
    Huang, Zhu, Jia, Zhang, *A Slide Window Variational Adaptive Kalman Filter*, IEEE TCAS-II 67(12), 2020.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import colift
from colift.closed_loop import flight
from colift.math import linalg
from colift.math.filters import smoothing_factor
from colift.math.pytree import pytree, static
from colift.models import aerial_manipulator
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import ControlClock, ResidualForces, TeamInputs, flatten_agent_force
from colift.onboard.estimation import contact_forces, state_estimator
from colift.onboard.learning import residual_model
from colift.scenario import Scenario, priors
from colift.scenario import team as team_module
from evidence import collect
from evidence import contact_forces as ours
from evidence.targets import Target, report

Scalar = Float[Array, ""]


class ForceFilter(Protocol):
    """Filter of the generalized forces of the agents of a group."""

    def init(self, agents: int, outputs: int, components: int) -> Any:
        """Return the state before the first control period."""
        ...

    def update(self, state: Any, y: Any, A: Any, group: int, dt: Scalar) -> tuple[Any, Any]:
        """Return contact forces `(agents, components)` [N, world], and the next state.

        Args:
            state: State of the previous control period.
            y: Unfiltered residuals without contact forces, ``f - A lam``, of the agents of a group.
            A: Maps from contact forces to generalized forces.
            group: Index of the group.
            dt: Control period [s].
        """
        ...


@pytree
class KalmanState:
    """Estimated minus measured momentum, estimated contact forces, and their covariance."""

    x: Float[Array, "agents states"]
    P: Float[Array, "agents states states"]


@pytree
class ExtendedKalmanFilter:
    """Extended Kalman filter with the generalized momentum p and the contact forces of an agent.

    ``p' = h - A lam + w_p``, ``lam' = w_lam``, with the momentum ``p + v`` as measurement. ``h`` contains inputs and
    drift. The linearization is exact in these states, since configuration and rates are measured.

    Attributes:
        residual_density: Density of ``w_p`` over the standard deviation of the residual [s^1/2].
        random_walk: Density of ``w_lam`` [N/s^1/2].
        residual_std: Standard deviations of the residuals by group [N, N m].
        momentum_std: Standard deviations of ``v`` by group [N s, N m s].
        contact_force_std: Initial standard deviation of the contact forces [N].
    """

    residual_density: Scalar
    random_walk: Scalar
    residual_std: tuple[Float[Array, "_outputs"], ...]
    momentum_std: tuple[Float[Array, "_outputs"], ...]
    contact_force_std: Scalar

    def init(self, agents: int, outputs: int, components: int) -> KalmanState:
        """Return zero forces with their initial covariance; see `ForceFilter`."""
        P = jnp.diag(jnp.concatenate([jnp.zeros(outputs), jnp.full(components, self.contact_force_std**2)]))
        return KalmanState(x=jnp.zeros((agents, outputs + components)), P=jnp.tile(P, (agents, 1, 1)))

    def update(self, state: KalmanState, y: Any, A: Any, group: int, dt: Scalar) -> tuple[Any, KalmanState]:
        """Advance the filter by one control period; see `ForceFilter`."""
        return jax.vmap(self._update_agent, in_axes=(0, 0, 0, None, None, None))(
            state, y, A, self.residual_std[group], self.momentum_std[group], dt
        )

    def _update_agent(
        self, state: KalmanState, y: Any, A: Any, residual_std: Any, momentum_std: Any, dt: Scalar
    ) -> tuple[Any, KalmanState]:
        outputs, components = A.shape
        lam = state.x[outputs:]
        e = state.x[:outputs] - dt * (A @ lam + y)  # the measured momentum changes by dt y
        F = jnp.eye(outputs + components).at[:outputs, outputs:].set(-dt * A)
        walk = jnp.full(components, self.random_walk)
        Q = jnp.diag(dt * jnp.concatenate([self.residual_density * residual_std, walk]) ** 2)
        P = F @ state.P @ F.T + Q
        gain = linalg.solve(P[:outputs, :outputs] + jnp.diag(momentum_std**2), P[:outputs])
        x = jnp.concatenate([e, lam]) - gain.T @ e
        P = P - gain.T @ P[:outputs]
        return x[outputs:], KalmanState(x=x, P=(P + P.T) / 2)


@pytree
class WindowState:
    """States of the last control periods, oldest first, with the distribution of the process noise.

    Attributes:
        x: Estimated minus measured momentum, and external force.
        P: Covariances.
        dof: Degrees of freedom of the inverse Wishart distribution.
        scale: Its scale matrix.
        ticks: Control periods since the start.
    """

    x: Float[Array, "window agents outputs 2"]
    P: Float[Array, "window agents outputs 2 2"]
    dof: Scalar
    scale: Float[Array, "agents outputs 2 2"]
    ticks: Scalar


@pytree
class VariationalFilter:
    """Momentum observer with adaptive process noise, one Kalman filter for each generalized coordinate.

    ``p' = h + tau``, ``tau' = w``. The process noise has an inverse Wishart distribution. A smoother over the window
    yields the expected squares of the noise, which update the distribution with a forgetting factor.

    Attributes:
        random_walk: Initial density of ``w`` over the standard deviation of the residual [s^-1/2].
        forgetting: Forgetting factor of the distribution.
        residual_std: Standard deviations of the residuals by group [N, N m].
        momentum_std: Standard deviations of the measured momentum by group [N s, N m s].
        split: Linear model of contact forces and residuals, without prior means.
        window: Number of control periods.
    """

    random_walk: Scalar
    forgetting: Scalar
    residual_std: tuple[Float[Array, "_outputs"], ...]
    momentum_std: tuple[Float[Array, "_outputs"], ...]
    split: contact_forces.ResidualPriorEstimator
    window: int = static()

    def init(self, agents: int, outputs: int, components: int) -> WindowState:
        """Return zero forces; see `ForceFilter`. The scale is set in the first control period."""
        del components
        return WindowState(
            x=jnp.zeros((self.window, agents, outputs, 2)),
            P=jnp.zeros((self.window, agents, outputs, 2, 2)),
            dof=jnp.zeros(()),
            scale=jnp.zeros((agents, outputs, 2, 2)),
            ticks=jnp.zeros(()),
        )

    def update(self, state: WindowState, y: Any, A: Any, group: int, dt: Scalar) -> tuple[Any, WindowState]:
        """Advance the filter by one control period; see `ForceFilter`."""
        first = (state.ticks == 0).astype(float)
        std, R = self.residual_std[group], self.momentum_std[group] ** 2
        start = jnp.stack([1e-2 * R, (self.random_walk * std) ** 2 * dt], -1)[..., None] * jnp.eye(2)
        steady = (self.window - 1) / (1 - self.forgetting)
        dof = state.dof + first * steady
        scale = state.scale + first * steady * start
        P = state.P + first * jnp.stack([R, std**2], -1)[..., None] * jnp.eye(2)
        F = jnp.eye(2).at[0, 1].set(dt)
        Q = scale / dof
        x = state.x.at[..., 0].add(-dt * y)  # relative to the measured momentum of this period
        x_k, P_k = x[-1] @ F.T, F @ P[-1] @ F.T + Q
        gain = P_k[..., :, 0] / (P_k[..., 0, 0] + R)[..., None]
        x_k, P_k = x_k - gain * x_k[..., :1], P_k - gain[..., :, None] * P_k[..., :1, :]
        x, P = jnp.concatenate([x[1:], x_k[None]]), jnp.concatenate([P[1:], P_k[None]])
        full = (state.ticks + 1 >= self.window).astype(float)
        squares = self._expected_squares(x, P, F, Q)
        f = 1 + full * (self.forgetting - 1)
        dof, scale = f * dof + full * (self.window - 1), f * scale + full * squares
        external = x_k[..., 1]
        S_inv = self.split.agent_information[group]
        weighted = linalg.matmul(linalg.transpose(A), S_inv[None])
        H = linalg.matmul(weighted, A) + jnp.eye(A.shape[-1]) / self.split.contact_force_std**2
        lam = jax.vmap(linalg.solve)(H, -linalg.matvec(weighted, external)[..., None])[..., 0]
        return lam, WindowState(x=x, P=P, dof=dof, scale=scale, ticks=state.ticks + 1)

    def _expected_squares(self, x: Any, P: Any, F: Any, Q: Any) -> Any:
        """Return the sum of the expected squares of the process noise over the window, by a smoother."""
        x_next, P_next, total = x[-1], P[-1], jnp.zeros_like(Q)
        for k in range(self.window - 2, -1, -1):
            predicted = F @ P[k] @ F.T + Q
            G = P[k] @ F.T @ _inverse(predicted)
            x_k = x[k] + ((x_next - x[k] @ F.T)[..., None, :] @ G.swapaxes(-1, -2))[..., 0, :]
            P_k = P[k] + G @ (P_next - predicted) @ G.swapaxes(-1, -2)
            cross, w = F @ G @ P_next, x_next - x_k @ F.T
            total = total + P_next - cross - cross.swapaxes(-1, -2) + F @ P_k @ F.T + w[..., :, None] * w[..., None, :]
            x_next, P_next = x_k, P_k
        return total


def _inverse(A: Any) -> Any:
    """Return the inverses of symmetric 2 x 2 matrices."""
    a, b, d = A[..., 0, 0], A[..., 0, 1], A[..., 1, 1]
    return jnp.stack([jnp.stack([d, -b], -1), jnp.stack([-b, a], -1)], -2) / (a * d - b * b)[..., None, None]


class _Bound:
    """Contact forces of a filter in one control period; keeps the next state of the filter."""

    def __init__(self, rival: RivalEstimator, state: Any, dt: Scalar) -> None:
        self.rival, self.state, self.dt, self.next = rival, state, dt, None

    def estimate(self, team: Team, balance: contact_forces.TeamBalance) -> contact_forces.ContactForces:
        """Return the contact forces; see `contact_forces.ContactForceEstimator`."""
        del team
        previous, states, initialized = self.state
        rival, b = self.rival, 1 + initialized * (smoothing_factor(self.rival.base.filters.tip_force, self.dt) - 1)
        means = residual_model.predict_agents(rival.prior, tuple(a.x for a in balance.agents))
        lam, found = [], []
        for i, (each, before, state) in enumerate(zip(balance.agents, previous, states, strict=True)):
            unfiltered = before + (each.y - before) / b  # inverse of the filter of the balance
            A = jax.vmap(contact_forces.contact_force_map)(each.J_tip, each.R)
            y = unfiltered - rival.prior_weight * flatten_agent_force(means[i])
            world, after = rival.force_filter.update(state, y, A, i, self.dt)
            found.append(after)
            lam.append(linalg.matmul(world.reshape(*each.measured.shape), each.R))
        self.next = tuple(a.y for a in balance.agents), tuple(found), jnp.ones(())
        contacts = sum(np.prod(x.shape) for x in lam)
        return contact_forces.ContactForces(
            base_frame=tuple(lam), valid=jnp.ones(()), covariance=jnp.zeros((contacts, contacts))
        )


@pytree
class RivalEstimator:
    """Default estimator with the contact forces of a `ForceFilter`.

    Attributes:
        base: Estimator of states and labels.
        force_filter: Filter of the generalized forces.
        prior: Residual model of a calibration flight.
        prior_weight: 1 with and 0 without the residual model.
    """

    base: state_estimator.ComplementaryFilter
    force_filter: Any
    prior: residual_model.ResidualModel
    prior_weight: Scalar

    def init(self, team: Team, measurement: Measurement) -> Any:
        """Return the initial states of both."""
        sizes = [
            (size, 6 + group.tree.joints, 3 * group.tree.arms)
            for size, group in zip(team.sizes, team.agent_groups, strict=True)
        ]
        previous = tuple(jnp.zeros((agents, outputs)) for agents, outputs, _ in sizes)
        states = tuple(self.force_filter.init(*size) for size in sizes)
        return self.base.init(team, measurement), (previous, states, jnp.zeros(()))

    def update(
        self,
        team: Team,
        state: Any,
        measurement: Measurement,
        applied: TeamInputs,
        f_hat: ResidualForces,
        clock: ControlClock,
    ) -> tuple[state_estimator.StateEstimate, Any]:
        """Compute states, contact forces and labels of one control period."""
        bound = _Bound(self, state[1], clock.dt)
        estimator = dataclasses.replace(self.base, contact_forces=bound)
        estimate, following = estimator.update(team, state[0], measurement, applied, f_hat, clock)
        return estimate, (following, bound.next)


def momentum_std(settings: Scenario, team: Team) -> tuple[Array, ...]:
    """Return standard deviations of the generalized momenta in the nominal posture by group, from the data sheets."""
    sensors, found = settings.sensors, []
    for group, posture in zip(team.agent_groups, team_module.nominal_posture(settings), strict=True):
        agent = jax.tree.map(lambda x: x[0], group)
        p = aerial_manipulator.centroidal_model(
            agent, aerial_manipulator.forward_kinematics(agent, jnp.asarray(posture)[0])
        )
        linear = p.mass * sensors.accelerometer_mps2 / settings.control_Hz  # the accelerometer is integrated
        angular = sensors.angular_velocity_radps * jnp.linalg.norm(p.M_bar, axis=1)
        found.append(jnp.concatenate([jnp.full(3, linear), angular]))
    return tuple(found)


CONSTANTS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "extended_kalman_filter": ((0.01, 0.01), (0.0003, 0.1)),
    "variational_filter": ((1e-4, 0.999, 12), (0.1, 0.9999, 12)),
}
"""Constants of the filters, without and with calibration.

For each filter, 32 combinations were compared by the RMS error of the contact forces, without and with calibration.
They were evaluated on the same nine flights of case C1, with all teams and the seeds 77 to 79. For the calibrated
variational filter, a window of 24 periods has an error that is smaller by 0.4 %.
"""
KINDS = ("tip_sensors", "least_squares", "least_squares, calibrated")
CASE = "C3"


def make_filter(
    name: str,
    calibrated: bool,
    settings: Scenario,
    split: contact_forces.ResidualPriorEstimator,
    team: Team,
) -> ForceFilter:
    """Return a filter with its constants.

    Args:
        name: Name in `CONSTANTS`.
        calibrated: Whether the residual model of a calibration flight is used.
        settings: Scenario.
        split: Linear model of contact forces and residuals; calibrated, if the filter is.
        team: Nominal parameters.
    """
    _, residual_std = priors.residual_std(settings, team)
    constants = CONSTANTS[name][calibrated]
    stated = {"residual_std": residual_std, "momentum_std": momentum_std(settings, team)}
    if name == "extended_kalman_filter":
        density, walk = map(jnp.asarray, constants)
        return ExtendedKalmanFilter(
            residual_density=density, random_walk=walk, contact_force_std=split.contact_force_std, **stated
        )
    walk, forgetting, window = constants
    return VariationalFilter(
        random_walk=jnp.asarray(walk), forgetting=jnp.asarray(forgetting), window=int(window), split=split, **stated
    )


def with_rival(settings: Scenario, case: str, name: str, calibrated: bool) -> flight.Experiment:
    """Return a flight whose contact forces come from a filter of the literature."""
    plan = colift.make_experiment(settings, case)
    assert plan.calibration is not None
    known = plan.calibration.calibrated(plan.controller).estimator
    given = plan.controller.estimator
    assert isinstance(known, state_estimator.ComplementaryFilter)
    assert isinstance(given, state_estimator.ComplementaryFilter)
    split, prior = (known if calibrated else given).contact_forces, known.contact_forces
    assert isinstance(split, contact_forces.ResidualPriorEstimator)
    assert isinstance(prior, contact_forces.ResidualPriorEstimator)
    assert prior.prior is not None
    estimator = RivalEstimator(
        base=dataclasses.replace(given, contact_forces=contact_forces.TipSensors()),  # without averages of the log
        force_filter=make_filter(
            name, calibrated, settings, dataclasses.replace(split, prior=None), plan.controller.team
        ),
        prior=prior.prior,
        prior_weight=jnp.asarray(float(calibrated)),
    )
    controller = dataclasses.replace(plan.controller, estimator=estimator)
    return dataclasses.replace(plan, controller=controller, calibration=None)


def compute_item(item: str) -> dict[str, Any]:
    """Return the flights of a team and a seed by estimator."""
    team, seed = item.split()
    found = {kind: ours.simulate(ours.settings_of(team, int(seed), ours.KINDS[kind]), CASE) for kind in KINDS}
    calibrated = ours.settings_of(team, int(seed), ours.KINDS["momentum_observer, calibrated"])
    for name in CONSTANTS:
        for prior, suffix in ((False, ""), (True, ", calibrated")):
            plan = with_rival(calibrated, CASE, name, prior)
            found[name + suffix] = ours.errors_of(flight.run_experiment(plan))
    return found


def targets(found: dict[str, Any]) -> list[Target]:
    """Return targets: largest error of the calibrated estimate, and largest ratio to both filters in one flight."""
    out = []
    for team in dict.fromkeys(item.split()[0] for item in found):
        flights = [each for item, each in found.items() if item.split()[0] == team]
        own = [one["least_squares, calibrated"]["contact_force_error_N"] for one in flights]
        out.append(Target(f"{team}: error of a contact force, calibrated", max(own), most=0.2, unit="N"))
        for name in CONSTANTS:
            others = [one[f"{name}, calibrated"]["contact_force_error_N"] for one in flights]
            ratio = max(a / b for a, b in zip(own, others, strict=True))
            out.append(Target(f"{team}: error over that of {name} with the same calibration", ratio, most=1.0))
    return out


def main() -> bool:
    """Print the targets and return whether all are met."""
    items = [f"{team} {seed}" for seed in ours.SEEDS for team in ours.TEAMS]
    return report(targets(collect("contact_force_rivals", items, compute_item)))
