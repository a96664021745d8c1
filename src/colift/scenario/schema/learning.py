"""Settings of learning: data, priors, online correction and baselines.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    Field,
)

from colift.scenario import fields
from colift.scenario.cross_checks import MAX_ENTRIES
from colift.scenario.fields import unit
from colift.scenario.schema.base import Section


class GPPrior(Section):
    """Standard deviations and length-scales of a model before it has data."""

    force_std_N: fields.Deviation
    """Signal standard deviation of a force output."""
    moment_std_Nm: fields.Deviation
    """Signal standard deviation of a moment output."""
    force_noise_std_N: fields.Deviation
    """Standard deviation of the label noise of a force output."""
    moment_noise_std_Nm: fields.Deviation
    """Standard deviation of the label noise of a moment output."""
    lengthscale: Annotated[fields.Lengthscale, unit("of each feature")] = 1.0
    """Length-scale of all features except angular velocities and joint velocities."""
    rate_lengthscale: Annotated[fields.Lengthscale, unit("of each feature")] = 1.0
    """Length-scale of angular velocities and joint velocities."""


class AgentGPPrior(GPPrior):
    """Standard deviations and length-scales of an agent's model before it has data."""

    joint_torque_std_Nm: fields.Deviation
    """Signal standard deviation of a joint output; in N for a prismatic joint."""
    joint_torque_noise_std_Nm: fields.Deviation
    """Standard deviation of the label noise of a joint output; in N for a prismatic joint."""


class Learning(Section):
    """Recording of data and updates of the models."""

    update_times_s: Annotated[tuple[fields.Span, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Update times t_k, ascending: all models are fitted to the data so far and then frozen."""
    start_s: fields.Time
    """Start of the recording, after the transients of the filters."""
    end_s: fields.Span
    """End of the recording, T_end."""
    sample_Hz: fields.Rate
    """Sampling rate of the recording; the period should not be shorter than the memory of the label filter."""
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
    label_source: Literal["onboard", "calibration_rig"] = "onboard"
    """`onboard` labels from sensors, or a `calibration_rig` with true states and labels of bounded error."""
    rig_label_error: fields.Ratio = 0.1
    """Magnitude of the label errors of the calibration rig, in standard deviations of the random residual."""


class BaselineTuning(Section):
    """Tuning of the baselines."""

    position_integral_gain: Annotated[fields.GainOrNone, unit("1/s³")] = 2.0
    """Integral gain of the position error, case `integral`."""
    attitude_integral_gain: Annotated[fields.GainOrNone, unit("1/s³")] = 40.0
    """Integral gain of the attitude error, case `integral`."""
    dob_force_Hz: fields.Rate = 0.5
    """Bandwidth of the disturbance observer's force, case `disturbance_observer`."""
    dob_moment_Hz: fields.Rate | None = None
    """Bandwidth of the disturbance observer's moment; default: that of the force."""
    mass_prior_std_kg: fields.Deviation = 0.5
    """Prior standard deviation of the payload's mass error, case `parametric`."""
    first_moment_prior_std_kgm: fields.Deviation = 0.05
    """Prior standard deviation of the payload's first moments of mass, case `parametric`."""
    inertia_prior_std_kgm2: fields.Deviation = 0.05
    """Prior standard deviation of the payload's inertia error, case `parametric`."""
    ridge_alpha: Annotated[fields.Deviation, unit("label noise over weight, squared")] = 0.3
    """Regularization of the weights of force outputs, case `regression`."""
    ridge_alpha_moment: Annotated[fields.Deviation | None, unit("label noise over weight, squared")] = None
    """Regularization of the weights of moment and joint outputs; default: that of force outputs."""


class OnlineCorrection(Section):
    """Correction of predictions by labels and periodic updates; other constants are fields of the controller parts."""

    lead_time_s: fields.Time = 0.02
    """Extrapolation time of the correction in cases `label_feedback` and `gp_label_feedback`."""
    hold_time_s: fields.Time = 0.2
    """Time without labels after which the correction decays, case `adaptive`; it is held until then."""
    averaging_time_s: fields.Span = 0.5
    """Time constant of the running moments of labels and predictions, case `adaptive`."""
    update_period_s: fields.Span = 1.0
    """Period of the updates with new samples and unchanged hyperparameters, case `adaptive`."""
    refit_period_s: fields.Span = 10.0
    """Period of the fits after the last of `learning.update_times_s`, case `adaptive`."""
    nis_threshold: fields.Factor = 3.0
    """Ratio of the mean normalized innovation squared to its usual value at which a change is declared."""
    preview_step_s: fields.PreviewStep = 0.03
    """Preview step of these cases and of `true_residual` if `control.preview_step_s` is not set."""
