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
from colift.models.state import flatten_agent_state, flatten_payload_state
from colift.onboard.estimation.state_estimator import TrainingSample
from colift.onboard.learning.residual_model import ResidualModel

Scalar = Float[Array, ""]
InputLabel = tuple[Float[Array, "..."], Float[Array, "..."]]


@pytree
class RecorderState:
    """What a recorder keeps between ticks."""

    payload: gp.Dataset
    agents: tuple[gp.Dataset, ...]  # by group, agents lead
    next_sample_time: Scalar  # s, when the next sample is taken

    def latest_time(self) -> float:
        """When the newest sample was taken, s; 0 where there is none."""
        return max(float(data.t.max()) for data in (self.payload, *self.agents))


@pytree
class DataRecorder:
    """When samples are recorded, and whose: of the estimator's inputs and labels."""

    sample_period: Scalar  # s between samples, no less than the label filter's memory
    start: Scalar  # s, once the filters have settled
    end: Scalar  # s, T_end of Assumption dataset
    payload: Bool[Array, ""]
    agents: Bool[Array, ""]
    selection_policy: gp.SelectionPolicy = static(default=gp.keep_first)  # which of them are kept

    def init(self, team: Team, model: ResidualModel) -> RecorderState:
        """Empty data sets, as large as the oracle's."""
        agents = []
        for size, group in zip(team.sizes, team.agent_groups, strict=True):
            n_r = group.tree.joints
            agents.append(gp.empty_dataset(model.payload.capacity, 18 + 2 * n_r, 6 + n_r, batch=(size,)))
        return RecorderState(
            payload=gp.empty_dataset(model.payload.capacity, 24, 6), agents=tuple(agents), next_sample_time=self.start
        )

    def record(
        self, state: RecorderState, measurement: Measurement, labelled: TrainingSample | None, t: Scalar
    ) -> RecorderState:
        """The data sets after time t, s: with one more sample where one is due."""
        context = (t >= state.next_sample_time - 1e-9) & (t <= self.end + 1e-9)
        payload, agents = self.samples(measurement, labelled)
        fresh = context if labelled is None else context & (labelled.valid > 0)
        each = jax.vmap(self.selection_policy, in_axes=(0, 0, 0, None, None))
        return RecorderState(
            payload=self.selection_policy(state.payload, *payload, t, fresh & self.payload)[0],
            agents=tuple(
                each(data, *xy, t, fresh & self.agents)[0] for data, xy in zip(state.agents, agents, strict=True)
            ),
            next_sample_time=state.next_sample_time + jnp.where(context, self.sample_period, 0.0),
        )

    def samples(
        self, measurement: Measurement, labelled: TrainingSample | None
    ) -> tuple[InputLabel, tuple[InputLabel, ...]]:
        """`(x, y)` of the payload and of every group's agents. Raises ValueError where nothing is labelled."""
        if labelled is None:
            raise ValueError("the estimator gives no labels: this pilot cannot learn")
        return labelled.payload, labelled.agents


@pytree
class RigRecorder(DataRecorder):
    """The same, of a calibration rig's true states and nearly true residuals."""

    def samples(
        self, measurement: Measurement, labelled: TrainingSample | None
    ) -> tuple[InputLabel, tuple[InputLabel, ...]]:
        """`(x, y)` of the payload and of every group's agents. Raises ValueError where there is no rig."""
        if measurement.rig is None:
            raise ValueError("the world has no calibration rig (`sensor.Rig`) to learn from")
        z, f = measurement.rig.z, measurement.rig.f
        payload = flatten_payload_state(z.payload, jnp.zeros(6)), jnp.concatenate([f.payload.F, f.payload.tau])
        agents = tuple(
            (jax.vmap(flatten_agent_state)(q), jnp.concatenate([g.f_x, g.f_w, g.f_r], axis=1))
            for q, g in zip(z.agents, f.agents, strict=True)
        )
        return payload, agents
