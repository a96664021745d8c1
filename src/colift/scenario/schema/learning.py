"""Settings of learning: data, priors, updates and baselines.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    Field,
)

from colift.scenario import fields
from colift.scenario.fields import unit
from colift.scenario.plain_data import MAX_ENTRIES
from colift.scenario.schema.base import Section
from colift.scenario.schema.shared import AgentForceMagnitudes, ForceMagnitudes, Interval


class GPPrior(Section):
    """Standard deviations and length-scales of a model before it has data."""

    signal_std: ForceMagnitudes
    """Signal standard deviations of the outputs."""
    noise_std: ForceMagnitudes
    """Standard deviations of the label noise of the outputs."""
    lengthscale: Annotated[fields.Lengthscale, unit("of each feature")] = 1.0
    """Length-scale of all features except angular velocities and joint velocities."""
    rate_lengthscale: Annotated[fields.Lengthscale, unit("of each feature")] = 1.0
    """Length-scale of angular velocities and joint velocities."""


class AgentGPPrior(GPPrior):
    """Standard deviations and length-scales of an agent's model before it has data."""

    signal_std: AgentForceMagnitudes
    """Signal standard deviations of the outputs."""
    noise_std: AgentForceMagnitudes
    """Standard deviations of the label noise of the outputs."""


class Learning(Interval):
    """Recording of data and updates of the models.

    Data are recorded from `start_s`, after the transients of the filters, to `end_s` (T_end).
    """

    update_times_s: Annotated[tuple[fields.Span, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Update times t_k, ascending: all models are fitted to the data so far and then frozen."""
    update_period_s: fields.Span = 1.0
    """Period of the updates with new samples and unchanged hyperparameters, case `adaptive`."""
    refit_period_s: fields.Span = 10.0
    """Period of the fits after the last of `update_times_s`, case `adaptive`."""
    sample_Hz: fields.Rate
    """Sampling rate of the recording. Labels of samples closer than the delay of the label filter are correlated."""
    label_filter_Hz: fields.Rate
    """Corner frequency of the second-order filter of every term of a label."""
    max_samples: fields.Capacity
    """Maximum number of samples in a data set."""
    payload: GPPrior
    """Prior of the payload model."""
    agents: AgentGPPrior
    """Prior of the agent models."""
    hyperparameters: Literal["optimized", "fixed"] = "optimized"
    """`optimized` at each update, or `fixed` to the prior with zero mean, as error bounds require."""
    fit_latency: fields.Time | Literal["measured"] = 0.0
    """Time in s between an update and the use of its model; `measured`: the computation time, which varies by run."""
    rig_label_error: Annotated[fields.Ratio | None, unit("standard deviations of the random residual")] = None
    """Learn from a calibration rig, with true states and label errors of this magnitude; default: onboard labels."""


class BaselineTuning(Section):
    """Tuning of the baselines; of two values, one for force and one for moment, a single number applies to both."""

    position_integral_gain: Annotated[fields.GainOrNone, unit("1/s³")] = 2.0
    """Integral gain of the position error, case `integral`."""
    attitude_integral_gain: Annotated[fields.GainOrNone, unit("1/s³")] = 40.0
    """Integral gain of the attitude error, case `integral`; reduced for yaw by the ratio of `k_R` to the power 3/2."""
    dob_Hz: fields.Rates = (0.5, 0.5)
    """Bandwidths of force and moment of the disturbance observer, case `disturbance_observer`."""
    mass_prior_std_kg: fields.Deviation = 0.5
    """Prior standard deviation of the payload's mass error, case `parametric`."""
    first_moment_prior_std_kgm: fields.Deviation = 0.05
    """Prior standard deviation of the payload's first moments of mass, case `parametric`."""
    inertia_prior_std_kgm2: fields.Deviation = 0.05
    """Prior standard deviation of the payload's inertia error, case `parametric`."""
    ridge_alpha: Annotated[fields.Deviations, unit("squared ratio of label noise and weight")] = (0.3, 0.3)
    """Regularization of the weights of force outputs, and of moment and joint outputs, case `regression`."""
