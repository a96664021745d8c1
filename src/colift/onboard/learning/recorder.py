"""Recording of training samples of payload and agents.

A recorder adds one sample per period to a data set of fixed capacity. A sample is an input, a label and a time. The
inputs pass the label filter, so input and label have equal delay.

See Also:
    colift.onboard.estimation.state_estimator: computation of inputs and labels.
    colift.gp.dataset: data sets and selection policies.
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
"""Input and label of a body or of all agents of a group."""


@pytree
class RecorderState:
    """State of a recorder between two control periods.

    Attributes:
        payload: Data set of the payload.
        agents: Data sets of the agents, by group; the agent is the first axis.
        next_sample_time: Time of the next sample [s].
    """

    payload: gp.Dataset
    agents: tuple[gp.Dataset, ...]
    next_sample_time: Scalar

    def latest_time(self) -> float:
        """Return the time of the latest sample [s]; 0 without samples."""
        return max(float(data.t.max()) for data in (self.payload, *self.agents))


@pytree
class DataRecorder:
    """Periodic recorder of the samples of a state estimator.

    Attributes:
        sample_period: Time between two samples [s].
        start: Time of the first sample [s], after the transients of the filters.
        end: Time after which no sample is recorded [s] (T_end of Assumption dataset).
        payload: Whether payload samples are recorded.
        agents: Whether agent samples are recorded.
        selection_policy: Rule that selects the samples to keep when a data set is full.
    """

    sample_period: Scalar
    start: Scalar
    end: Scalar
    payload: Bool[Array, ""]
    agents: Bool[Array, ""]
    selection_policy: gp.SelectionPolicy = static(default=gp.keep_first)

    def init(self, team: Team, model: ResidualModel) -> RecorderState:
        """Return empty data sets with the capacity of the residual model.

        Args:
            team: Nominal parameters.
            model: Residual model that is fitted to the data.

        Returns:
            The state before the first sample.
        """
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
        """Add a sample to the data sets if one is due.

        Args:
            state: State of the previous control period.
            measurement: Measurement of this control period.
            labelled: Sample of the state estimator; None if the estimator provides no labels.
            t: Time [s].

        Returns:
            The next state.
        """
        due = (t >= state.next_sample_time - 1e-9) & (t <= self.end + 1e-9)
        payload, agents = self.samples(measurement, labelled)
        valid = due if labelled is None else due & (labelled.valid > 0)
        each = jax.vmap(self.selection_policy, in_axes=(0, 0, 0, None, None))
        return RecorderState(
            payload=self.selection_policy(state.payload, *payload, t, valid & self.payload)[0],
            agents=tuple(
                each(data, *xy, t, valid & self.agents)[0] for data, xy in zip(state.agents, agents, strict=True)
            ),
            next_sample_time=state.next_sample_time + jnp.where(due, self.sample_period, 0.0),
        )

    def samples(
        self, measurement: Measurement, labelled: TrainingSample | None
    ) -> tuple[InputLabel, tuple[InputLabel, ...]]:
        """Return inputs and labels of this control period.

        Args:
            measurement: Measurement of this control period.
            labelled: Sample of the state estimator.

        Returns:
            Input and label of the payload, and those of the agents by group.

        Raises:
            ValueError: If the estimator provides no labels.
        """
        if labelled is None:
            raise ValueError("the state estimator provides no labels; online learning requires labels")
        return labelled.payload, labelled.agents


@pytree
class RigRecorder(DataRecorder):
    """Periodic recorder of the states and residuals of a calibration rig.

    A calibration rig measures the true state, and the true residual with a bounded error.
    """

    def samples(
        self, measurement: Measurement, labelled: TrainingSample | None
    ) -> tuple[InputLabel, tuple[InputLabel, ...]]:
        """Return inputs and labels from the readings of the rig.

        Args:
            measurement: Measurement of this control period.
            labelled: Not used.

        Returns:
            Input and label of the payload, and those of the agents by group.

        Raises:
            ValueError: If the measurement contains no reading of a rig.
        """
        if measurement.rig is None:
            raise ValueError(
                "the measurement contains no rig reading; this recorder requires the sensor model `CalibrationRig`"
            )
        z, f = measurement.rig.state, measurement.rig.residual
        payload = flatten_payload_state(z.payload, jnp.zeros(6)), jnp.concatenate([f.payload.F, f.payload.tau])
        agents = tuple(
            (jax.vmap(flatten_agent_state)(q), jnp.concatenate([g.f_x, g.f_w, g.f_r], axis=1))
            for q, g in zip(z.agents, f.agents, strict=True)
        )
        return payload, agents
