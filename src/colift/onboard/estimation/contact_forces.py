"""Contact forces from the equations of motion, with and without tip force sensors.

The equations of motion of an agent contain its residual ``f_j`` and its contact forces ``lam_j``, those of the payload
its residual ``f_L`` and the wrench of all contact forces::

    f_j = y_j + A_j lam_j,    f_L = y_L - G lam

Here ``y_j`` and ``y_L`` follow from accelerations, momenta and inputs. No motion separates contact forces from
residuals: ``lam + d`` with ``f_j + A_j d_j`` and ``f_L - G d`` satisfies the same equations for every d. Contact forces
therefore come from tip force sensors, or from priors of the residuals.

References:
    De Luca, Albu-Schaeffer, Haddadin, Hirzinger, *Collision detection and safe reaction with the DLR-III lightweight
    manipulator arm*, IROS 2006 (generalized-momentum observer).
    Kay, *Fundamentals of Statistical Signal Processing: Estimation Theory*, 1993, ch. 11 (Bayesian linear model).

See Also:
    docs/sensors: which estimator requires which sensors.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import jax.scipy.linalg
from jaxtyping import Array, Float

from colift.math import linalg
from colift.math.pytree import constant, pytree
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import ResidualForces, flatten_agent_force
from colift.onboard.learning import residual_model

Scalar = Float[Array, ""]

MIN_LEVER = 0.01
"""Tip motion per joint motion below which a joint rate is measured by the encoder [m/rad or 1].

Moments of contact forces with a smaller lever determine no difference between the forces of an agent's arms.
"""
LABEL_MIN_LEVER = 1e-4
"""The same for labels of moments without tip readings: combinations of moments with a smaller lever are labels [m].

The labels of the other combinations, which depend on the differences between the arms, are the estimate.
"""


@pytree
class AgentBalance:
    """Equations of motion of the agents of a group, ``f = y + A lam``, in one control period.

    Attributes:
        R: Attitudes of the bases, body to world.
        y: Residual without contact forces, with tip moment readings: force [N, world], moments [N m, base frame],
            joint torques [N m or N].
        J_tip: Jacobians of the tips, base frame, by arm [m or 1]; the moments of ``A lam`` are their transposes.
        measured: Tip force readings, on the payload [N, base frame].
        x: Inputs of the residual models.
        moment: Sum of the tip moment readings, on the payload [N m, base frame]; None for point contacts.
    """

    R: Float[Array, "*agents 3 3"]
    y: Float[Array, "*agents outputs"]
    J_tip: Float[Array, "*agents arms 3 xi"]
    measured: Float[Array, "*agents arms 3"]
    x: Float[Array, "*agents inputs"]
    moment: Float[Array, "*agents 3"] | None = None


@pytree
class PayloadBalance:
    """Equations of motion of the payload, ``f_L = y - G lam``, in one control period.

    Attributes:
        R: Attitude of the payload, payload frame to world.
        y: Residual without contact forces [N world, N m payload frame].
    """

    R: Float[Array, "3 3"]
    y: Float[Array, "6"]


@pytree
class TeamBalance:
    """Equations of motion of all bodies in one control period, with the data that replace contact forces.

    Attributes:
        agents: Equations of motion of the agents, by group.
        payload: Equations of motion of the payload.
        reading_age: Age of the tip force readings [s].
        f_hat: Estimate of the residual forces in the previous control period.
    """

    agents: tuple[AgentBalance, ...]
    payload: PayloadBalance
    reading_age: Scalar
    f_hat: ResidualForces


@pytree
class ContactForces:
    """Contact forces on the payload.

    Attributes:
        base_frame: Contact forces [N, base frame of their agent], by group.
        valid: 1 if labels of all outputs of the agents exist and may be used for training.
        covariance: Covariance of the contact forces [N^2, world], contacts in team order; None for readings.
        moment_labels: Contact forces for labels of the agents' moments [N, base frame], by group; None: `base_frame`.
    """

    base_frame: tuple[Float[Array, "_agents _arms 3"], ...]
    valid: Scalar
    covariance: Float[Array, "components components"] | None = None
    moment_labels: tuple[Float[Array, "_agents _arms 3"], ...] | None = None

    def for_moment_labels(self) -> tuple[Float[Array, "_agents _arms 3"], ...]:
        """Return the contact forces for labels of the agents' moments [N, base frame], by group."""
        return self.base_frame if self.moment_labels is None else self.moment_labels


@runtime_checkable
class ContactForceEstimator(Protocol):
    """Protocol of the estimators of contact forces."""

    def estimate(self, team: Team, balance: TeamBalance) -> ContactForces:
        """Return the contact forces of one control period.

        Args:
            team: Nominal parameters.
            balance: Equations of motion and readings.
        """
        ...


@pytree
class TipSensors:
    """Contact forces from tip force sensors.

    If the readings are too old, contact forces follow from the agents' equations of motion with the estimates of their
    residuals (`reconstruct_contact_forces`). Labels of forces do not exist then. Labels of moments do, because the
    moments of an agent have more equations than its contact forces have differences. With ``P`` the projection on
    moments of these differences, ``(I - P) (y + J lam)`` depends on the mean contact force alone. The other part
    ``P f_hat`` of the label is the estimate of the previous period, which causes almost no innovation.

    Attributes:
        max_reading_age: Largest age of a tip reading that is used [s].
    """

    max_reading_age: Scalar = constant(0.02)

    def estimate(self, team: Team, balance: TeamBalance) -> ContactForces:
        """Return the readings, or the reconstructed forces; see `ContactForceEstimator`."""
        valid = (balance.reading_age <= self.max_reading_age + 1e-9).astype(float)
        reconstruct = jax.vmap(reconstruct_contact_forces, in_axes=(0, 0, 0, None, 0))
        lam, moment_labels = [], []
        for group, each, f in zip(team.agent_groups, balance.agents, balance.f_hat.agents, strict=True):
            A_lam, closed = flatten_agent_force(f) - each.y, group.closed_contacts
            for forces, min_lever in ((lam, MIN_LEVER), (moment_labels, LABEL_MIN_LEVER)):
                reconstructed = reconstruct(each.J_tip, each.R, A_lam, min_lever, closed)
                forces.append(jnp.where(valid > 0, each.measured, reconstructed))
        return ContactForces(base_frame=tuple(lam), valid=valid, moment_labels=tuple(moment_labels))


@pytree
class FreeFlight:
    """Zero contact forces, for agents that do not hold the payload."""

    def estimate(self, team: Team, balance: TeamBalance) -> ContactForces:
        """Return zero; see `ContactForceEstimator`."""
        return ContactForces(
            base_frame=tuple(jnp.zeros_like(each.measured) for each in balance.agents), valid=jnp.ones(())
        )


@pytree
class ResidualPriorEstimator:
    """Contact forces from the equations of motion with a Gaussian prior of the residuals, without tip force sensors.

    With ``f_j ~ N(mu_j, S_j)``, ``f_L ~ N(0, S_L)`` and ``lam ~ N(0, s^2 I)`` the posterior is that of the
    Bayesian linear model (Kay 1993, Theorem 11.1)::

        P = (sum_j A_j^T S_j^-1 A_j + G^T S_L^-1 G + I / s^2)^-1
        lam_hat = P (sum_j A_j^T S_j^-1 (mu_j - y_j) + G^T S_L^-1 y_L)

    Without a prior of the payload each agent is separate. The result is then a generalized-momentum observer: y_j
    contains differences of momenta that pass a first-order filter.

    Noise of ``y_j`` is not part of the weights, since the label filter averages it out. The estimates that are reported
    are averages over the same time (`label_noise`). With the covariance N_j of the averaged noise, the covariance is
    ``P + P (sum_j A_j^T S_j^-1 N_j S_j^-1 A_j) P``. It neglects correlations between agents and the noise of ``y_L``.

    The prior stays as it is during a flight. Labels depend on it, so a prior that is fitted to them confirms itself.

    Attributes:
        agent_information: Inverse covariances ``S_j^-1`` by group, with outputs in N and N m.
        payload_information: Inverse covariance ``S_L^-1``; None if the residual of the payload has no prior.
        contact_force_std: Standard deviation s of the contact forces [N].
        noise: Covariances ``N_j`` by group, with outputs in N and N m.
        prior: Residual model whose agents are the prior means; None for zero means.
    """

    agent_information: tuple[Float[Array, "_outputs _outputs"], ...]
    payload_information: Float[Array, "6 6"] | None
    contact_force_std: Scalar
    noise: tuple[Float[Array, "_agents _outputs _outputs"], ...]
    prior: residual_model.ResidualModel | None = None

    def estimate(self, team: Team, balance: TeamBalance) -> ContactForces:
        """Return the posterior mean and covariance of the contact forces; see `ContactForceEstimator`."""
        agents, payload = balance.agents, balance.payload
        blocks, noise_blocks, b = [], [], []
        means = None if self.prior is None else residual_model.predict_agents(self.prior, tuple(a.x for a in agents))
        for i, (each, information) in enumerate(zip(agents, self.agent_information, strict=True)):
            mu = jnp.zeros_like(each.y) if means is None else flatten_agent_force(means[i])
            A = jax.vmap(contact_force_map)(each.J_tip, each.R)
            weighted = linalg.matmul(linalg.transpose(A), information[None])
            blocks.extend(linalg.matmul(weighted, A))
            b.extend(linalg.matvec(weighted, mu - each.y))
            noise_blocks.extend(linalg.matmul(linalg.matmul(weighted, self.noise[i]), linalg.transpose(weighted)))
        H, rhs = jax.scipy.linalg.block_diag(*blocks), jnp.concatenate(b)
        if self.payload_information is not None:
            G = grasp.grasp_matrix(grasp.contact_points(team), payload.R)
            weighted = G.T @ self.payload_information
            H, rhs = H + weighted @ G, rhs + weighted @ payload.y
        H = H + jnp.eye(len(H)) / self.contact_force_std**2
        solution = linalg.solve(H, jnp.concatenate([rhs[:, None], jnp.eye(len(H))], axis=1))
        P = solution[:, 1:]
        world = grasp.split_contacts(team, solution[:, 0].reshape(-1, 3))
        return ContactForces(
            base_frame=tuple(linalg.matmul(lam, each.R) for lam, each in zip(world, agents, strict=True)),
            valid=jnp.ones(()),
            covariance=P + P @ jax.scipy.linalg.block_diag(*noise_blocks) @ P,
        )


def without_tip_moments(balance: TeamBalance, label: Float[Array, "6"]) -> Float[Array, "6"]:
    """Subtract the tip moment readings from a label of the payload [N world, N m payload frame].

    Args:
        balance: Equations of motion and readings.
        label: Label of the payload with the contact forces.
    """
    in_world = [(x.R * x.moment[:, None, :]).sum((0, 2)) for x in balance.agents if x.moment is not None]
    return label.at[3:].add(-(balance.payload.R.T @ sum(in_world))) if in_world else label


def contact_force_map(J_tip: Float[Array, "arms 3 xi"], R: Float[Array, "3 3"]) -> Float[Array, "outputs contacts"]:
    """Return the matrix ``A`` from the contact forces of all arms, world frame, to the generalized force ``A lam``.

    Args:
        J_tip: Jacobians of the tips, base frame, by arm [m or 1].
        R: Attitude of the base, body to world.
    """
    arms = len(J_tip)
    moments = linalg.matmul(linalg.transpose(J_tip), R.T[None]).transpose(1, 0, 2)
    return jnp.concatenate([jnp.tile(jnp.eye(3), (1, arms)), moments.reshape(-1, 3 * arms)])


def contact_jacobian(J_tip: Float[Array, "arms 3 xi"]) -> Float[Array, "xi contacts"]:
    """Return the matrix from the contact forces of all arms, base frame, to the generalized moments.

    Args:
        J_tip: Tip velocities per angular velocity of the base and per joint velocity, base frame, by arm [m or 1].
    """
    return J_tip.reshape(-1, J_tip.shape[-1]).T


def regularized_pseudoinverse(B: Float[Array, "n m"], scale: float) -> Float[Array, "m n"]:
    """Return `(B^T B + s^2 I)^-1 B^T`, nearly the pseudoinverse of B.

    Args:
        B: Matrix.
        scale: Singular value s below which a direction is suppressed, in the unit of B.
    """
    return linalg.solve(B.T @ B + scale**2 * jnp.eye(B.shape[1]), B.T)


def reconstruct_contact_forces(
    J_tip: Float[Array, "arms 3 xi"],
    R: Float[Array, "3 3"],
    A_lam: Float[Array, "outputs"],
    min_lever: float = MIN_LEVER,
    closed: Float[Array, "arms"] | None = None,
) -> Float[Array, "arms 3"]:
    """Compute the contact forces that agree with the equations of motion of an agent.

    The generalized contact force is ``A lam = f_hat - modelled``, with the forces `modelled` of the nominal equations
    and the compensated residual `f_hat`. The sum of the contact forces satisfies the force equation exactly. With
    ``lam_i = mean(lam) + d_i``, the differences ``d_i`` of several arms follow from the moment equation by regularized
    least squares.

    Args:
        J_tip: Tip velocities per angular velocity of the base and per joint velocity, base frame, by arm [m or 1].
        R: Attitude of the base, body to world.
        A_lam: Generalized contact force ``f_hat - modelled``: force [N, world], then moments [N m, base frame] and
            joint torques or forces [N m or N].
        min_lever: Lever below which the moments determine no difference between the arms [m].
        closed: 1 for closed contacts, 0 for open ones, whose forces are zero; None if all are closed.

    Returns:
        Contact forces on the payload [N, base frame].
    """
    arms = len(J_tip)
    share = jnp.full(arms, 1 / arms) if closed is None else closed / jnp.maximum(1.0, closed.sum())
    lam = share[:, None] * (R.T @ A_lam[:3])[None]
    if arms == 1:
        return lam
    J = contact_jacobian(J_tip)
    mean = (J.reshape(-1, arms, 3) * share[None, :, None]).sum(1)
    B = J - jnp.tile(mean, arms)  # of the differences between the arms
    if closed is not None:
        B = B * jnp.repeat(closed, 3)[None]
    moments = A_lam[3:] - J @ lam.reshape(-1)
    difference = linalg.solve(B.T @ B + min_lever**2 * jnp.eye(3 * arms), (B.T @ moments)[:, None]).reshape(arms, 3)
    common = (share @ difference)[None]  # zero up to rounding
    return lam + difference - (common if closed is None else closed[:, None] * common)
