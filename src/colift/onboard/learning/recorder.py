"""What is learned: features, samples that are recorded in flight, frozen oracles.

On `[t_k, t_{k+1})` the oracle is an immutable value. Data sets keep the raw, filtered inputs; a feature map turns
them into what a GP sees, so another map needs no new data.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from colift import gp
from colift.math.pytree import pytree, static
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import flat_agent, flat_payload
from colift.onboard.estimation.state_estimator import Labelled
from colift.onboard.learning.residual_model import Oracle

Scalar = Float[Array, ""]
Sampled = tuple[Float[Array, "..."], Float[Array, "..."]]


@pytree
class Recorded:
    """What a recorder keeps between ticks."""

    payload: gp.Data
    agents: tuple[gp.Data, ...]  # by group, agents lead
    due: Scalar  # s, when the next sample is taken

    def newest(self) -> float:
        """When the newest sample was taken, s; 0 where there is none."""
        return max(float(data.t.max()) for data in (self.payload, *self.agents))


@pytree
class Recorder:
    """When samples are recorded, and whose: of the estimator's inputs and labels."""

    every: Scalar  # s between samples, no less than the label filter's memory
    start: Scalar  # s, once the filters have settled
    end: Scalar  # s, T_end of Assumption dataset
    payload: Bool[Array, ""]
    agents: Bool[Array, ""]
    policy: gp.Policy = static(default=gp.first_come)  # which of them are kept

    def begin(self, team: Team, oracle: Oracle) -> Recorded:
        """Empty data sets, as large as the oracle's."""
        agents = []
        for size, group in zip(team.sizes, team.groups, strict=True):
            n_r = group.tree.joints
            agents.append(gp.empty(oracle.payload.capacity, 18 + 2 * n_r, 6 + n_r, batch=(size,)))
        return Recorded(payload=gp.empty(oracle.payload.capacity, 24, 6), agents=tuple(agents), due=self.start)

    def record(self, memory: Recorded, m: Measurement, labelled: Labelled | None, t: Scalar) -> Recorded:
        """The data sets after time t, s: with one more sample where one is due."""
        now = (t >= memory.due - 1e-9) & (t <= self.end + 1e-9)
        payload, agents = self.samples(m, labelled)
        fresh = now if labelled is None else now & (labelled.fresh > 0)
        each = jax.vmap(self.policy, in_axes=(0, 0, 0, None, None))
        return Recorded(
            payload=self.policy(memory.payload, *payload, t, fresh & self.payload)[0],
            agents=tuple(
                each(data, *xy, t, fresh & self.agents)[0] for data, xy in zip(memory.agents, agents, strict=True)
            ),
            due=memory.due + jnp.where(now, self.every, 0.0),
        )

    def samples(self, m: Measurement, labelled: Labelled | None) -> tuple[Sampled, tuple[Sampled, ...]]:
        """`(x, y)` of the payload and of every group's agents. Raises ValueError where nothing is labelled."""
        if labelled is None:
            raise ValueError("the estimator gives no labels: this pilot cannot learn")
        return labelled.payload, labelled.agents


@pytree
class FromRig(Recorder):
    """The same, of a calibration rig's true states and nearly true residuals."""

    def samples(self, m: Measurement, labelled: Labelled | None) -> tuple[Sampled, tuple[Sampled, ...]]:
        """`(x, y)` of the payload and of every group's agents. Raises ValueError where there is no rig."""
        if m.rig is None:
            raise ValueError("the world has no calibration rig (`sensor.Rig`) to learn from")
        z, f = m.rig.z, m.rig.f
        payload = flat_payload(z.payload, jnp.zeros(6)), jnp.concatenate([f.payload.F, f.payload.tau])
        agents = tuple(
            (jax.vmap(flat_agent)(q), jnp.concatenate([g.f_x, g.f_w, g.f_r], axis=1))
            for q, g in zip(z.agents, f.agents, strict=True)
        )
        return payload, agents
