"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models import grasp
from colift.models.parameters import Agent
from colift.models.state import AgentForce, AgentInput, AgentState, Inputs, Residual
from colift.onboard.control import attitude, preview, realization, setpoints, tracking
from colift.onboard.interfaces import Forces, Now, Saturated


@pytree
class Aligned:
    """The paper's realization: thrust along a commanded direction, tips on the payload, torques by inverse dynamics."""

    gains: tracking.Gains
    heading: tuple[Float[Array, "agents"], ...]  # rad
    rest: tuple[Float[Array, "agents n_r"], ...]

    def realize(self, now: Now, to: tracking.Command, forces: Forces, f_hat: Residual) -> tuple[Inputs, Saturated]:
        """`control.realize` of every agent, thrust limited to what its rotors give."""
        team, inputs, saturated = now.team, [], []
        realize = jax.vmap(realization.realize, in_axes=(0, None, None, 0, None, None, 0, 0, 0))
        shares = tuple(
            setpoints.Share(lam=lam, lam_dot=lam_dot, heading=heading, rest=rest)
            for lam, lam_dot, heading, rest in zip(
                grasp.split(team, forces.lam), grasp.split(team, forces.lam_dot), self.heading, self.rest, strict=True
            )
        )
        turns = self.turns(now, to, shares, f_hat)
        for group, q, share, f, turn in zip(team.groups, now.q_hat.agents, shares, f_hat.agents, turns, strict=True):
            asked = realize(group, self.gains, team.gravity, q, now.q_hat.payload, to, share, f, turn)
            u = jnp.clip(asked.u, 0.0, group.thrust_max)
            inputs.append(AgentInput(u=u, tau=asked.tau, tau_r=asked.tau_r))
            saturated.append(u != asked.u)
        return tuple(inputs), tuple(saturated)

    def turns(
        self, now: Now, to: tracking.Command, shares: tuple[setpoints.Share, ...], f_hat: Residual
    ) -> tuple[setpoints.Turn, ...]:
        """`control.aligned`, by group."""
        turn = jax.vmap(attitude.aligned, in_axes=(0, None, None, 0, 0))
        each = zip(now.team.groups, shares, f_hat.agents, strict=True)
        return tuple(turn(group, now.team.gravity, to, share, f) for group, share, f in each)


@pytree
class Anticipating(Aligned):
    """The same with the attitude's rates from the reference ahead, for a pilot with a `look_ahead`."""

    def turns(
        self, now: Now, to: tracking.Command, shares: tuple[setpoints.Share, ...], f_hat: Residual
    ) -> tuple[setpoints.Turn, ...]:
        """`control.anticipated`, by group. Raises ValueError where the pilot does not look ahead."""
        if now.ahead is None:
            raise ValueError("this realizer needs a pilot that looks ahead: `LeaderFollower.look_ahead`")
        far, team, out = now.ahead, now.team, []
        lam = jax.vmap(lambda x: grasp.split(team, x))(far.lam)
        for group, q, share, f, lam_far, f_far in zip(
            team.groups, now.q_hat.agents, shares, f_hat.agents, lam, far.f_hat.agents, strict=True
        ):
            out.append(
                jax.vmap(self._turn, in_axes=(None, None, 0, 0, 0, 0, 1, 1))(
                    now, to, group, q, share, f, lam_far, f_far.f_x
                )
            )
        return tuple(out)

    def _turn(
        self,
        now: Now,
        to: tracking.Command,
        agent: Agent,
        q: AgentState,
        share: setpoints.Share,
        f_hat: AgentForce,
        lam: Float[Array, "times arms 3"],
        f_x: Float[Array, "times 3"],
    ) -> setpoints.Turn:
        far, gravity = now.ahead, now.team.gravity
        assert far is not None
        f = agent.mass.sum() * (far.to.a - gravity[None]) + lam.sum(1) - f_x
        ahead = preview.Ahead(step=far.step, load=far.load, to=far.to, f=f)
        return preview.anticipated(agent, gravity, q, to, share, f_hat, ahead)
