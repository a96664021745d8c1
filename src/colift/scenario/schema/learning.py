"""What a scenario may say: one frozen model a section, units in the names, a sentence for every setting.

World frame unless a description says otherwise. The words and defaults here are the reference page
(docs/scenarios.md) and the help of the error messages; there is no second list.
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
    """Deviations that a model states before it has data."""

    force_std_N: fields.Deviation
    """Signal deviation of a force output."""
    moment_std_Nm: fields.Deviation
    """Signal deviation of a moment output."""
    force_noise_std_N: fields.Deviation
    """Label noise deviation of a force output."""
    moment_noise_std_Nm: fields.Deviation
    """Label noise deviation of a moment output."""
    lengthscale: Annotated[fields.Lengthscale, unit("of each feature")] = 1.0
    """Length-scale of every feature but rates of rotation and of joints."""
    rate_lengthscale: Annotated[fields.Lengthscale, unit("of each feature")] = 1.0
    """Length-scale of rates of rotation and of joints."""


class AgentGPPrior(GPPrior):
    """Deviations that an agent's model states before it has data."""

    joint_torque_std_Nm: fields.Deviation
    """Signal deviation of a joint output; for a sliding joint in N."""
    joint_torque_noise_std_Nm: fields.Deviation
    """Label noise deviation of a joint output; for a sliding joint in N."""


class Learning(Section):
    """When data are recorded, when models are fitted and frozen, and how."""

    update_times_s: Annotated[tuple[fields.Span, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """The t_k at which all models are fitted to the data so far and frozen, ascending."""
    start_s: fields.Time
    """When recording begins; the filters have settled by then."""
    end_s: fields.Span
    """T_end: no data are recorded after it."""
    sample_Hz: fields.Rate
    """Rate at which samples are recorded; no denser than the filter's memory."""
    label_filter_Hz: fields.Rate
    """Corner of the second-order filter that every term of a label goes through."""
    max_samples: fields.Capacity
    """Most samples a data set holds."""
    payload: GPPrior
    """The payload model's prior."""
    agents: AgentGPPrior
    """The agent models' prior."""
    lengthscale_bounds: tuple[fields.Lengthscale, fields.Lengthscale] = (0.1, 30.0)
    """Least and largest length-scale of any feature, in its own unit: m, m/s, rad, rad/s, none for an entry of R."""
    hyperprior_factor: fields.Factor = 3.0
    """Before data, two of three length-scales and deviations lie within this factor of the prior's (log-normal)."""
    hyperparameters: Literal["optimized", "fixed"] = "optimized"
    """`fitted` to the data at each update, or `stated`: those of the prior, without a mean, as error bounds ask for."""
    fit_latency: fields.Time | Literal["measured"] = 0.0
    """How long a fit takes until what it learned flies, s; `measured`: as long as it takes on this machine, which makes
    a run unlike the next."""
    label_source: Literal["onboard", "calibration_rig"] = "onboard"
    """`estimated` on board from the sensors, or of a calibration `rig`: true states, labels with bounded errors."""
    rig_label_error: fields.Ratio = 0.1
    """Error of every label of the rig, one way or the other, as a share of the drawn residual's deviation."""
    n_restarts: fields.Restarts = 1
    """Further starts of the fit, beside the warm one."""
    max_iter: fields.Iterations = 300
    """Most iterations of one start."""


class BaselineTuning(Section):
    """Tuning of the rivals of learning."""

    position_integral_gain: Annotated[fields.GainOrNone, unit("1/s³")] = 2.0
    """Integral action on the position error, baseline I."""
    attitude_integral_gain: Annotated[fields.GainOrNone, unit("1/s³")] = 40.0
    """Integral action on the attitude error, baseline I."""
    dob_force_Hz: fields.Rate = 0.5
    """Bandwidth of the wrench observer's force, baseline DOB."""
    dob_moment_Hz: fields.Rate | None = None
    """Of its moment; as of its force if absent."""
    mass_prior_std_kg: fields.Deviation = 0.5
    """Prior deviation of the payload's mass error, baseline P."""
    first_moment_prior_std_kgm: fields.Deviation = 0.05
    """Prior deviation of the payload's first moments, baseline P."""
    inertia_prior_std_kgm2: fields.Deviation = 0.05
    """Prior deviation of the payload's inertia error, baseline P."""
    ridge_alpha: Annotated[fields.Deviation, unit("label noise over weight, squared")] = 0.3
    """What a squared weight of the basis costs beside a squared label error, for forces, baseline R."""
    ridge_alpha_moment: Annotated[fields.Deviation | None, unit("label noise over weight, squared")] = None
    """For moments and joints; as for forces if absent."""


class OnlineCorrection(Section):
    """How labels correct what is learned, in the cases F, H and C4."""

    lead_time_s: fields.Time = 0.02
    """By how much the correction of F and H is carried ahead along its rate, for the delay of labels."""
    coherence: fields.Coherence = 0.2
    """C4 carries its correction ahead by the whole delay of labels where so much, in the square, of what their rates
    foretold came true; where less did, as much less far. Of what noise foretells nothing comes true on average."""
    variance_ratio: fields.Factor = 10.0
    """C4's map is used as far as labels move with it once it has moved by more than the variance of labels over so
    many: in the square, from one label filter's memory to the next. A rate that foretells less counts for nothing."""
    max_label_age_s: fields.Span = 0.02
    """How old a reading of the tips may be for a label."""
    hold_time_s: fields.Time = 0.2
    """How long labels may be silent until they count as stopped for C4, if they have not been silent half as long
    lately; its correction is held meanwhile."""
    decay_time_s: fields.Span = 0.3
    """Once labels have stopped, how soon C4's correction is its mean over the last `span_s`."""
    averaging_time_s: fields.Span = 0.5
    """Of that mean."""
    update_period_s: fields.Span = 1.0
    """How often C4's models take in new samples, hyperparameters kept."""
    refit_period_s: fields.Span = 10.0
    """How often, after the last of `learning.update_times_s`, C4 fits hyperparameters and means anew."""
    forgetting_time_s: fields.Span = 20.0
    """Of more samples than `learning.capacity` C4 keeps those that tell most; those that are so old as if they were
    twice as noisy."""
    nis_threshold: fields.Factor = 3.0
    """Mean square of new labels off what was predicted, in predictive variances, over its usual value (or 1, if that is
    less), above which the world has changed for a body: C4 amends its older samples by what the new ones say."""
    transient_time_s: fields.Time = 0.5
    """How long after the first sample that surprises the world may be changing: samples of then speak of no world."""
    min_samples: fields.Capacity = 150
    """New samples after a change for a new model: until then the old one, shifted, is corrected by labels, and what
    surprises is the same change. A model of less than a third as many cannot be surprised."""
    drag_std_Nspm: fields.Deviation = 0.5
    """Prior deviation of each body's drag, in the mean of C4's maps; mass and first moments as in `baselines`."""
    drag_lever_std_m: fields.Deviation = 0.4
    """Prior deviation of the lever of the payload's drag."""
    thrust_bias_std_N: fields.Deviation = 2.0
    """Prior deviation of what an agent's rotors have more or less of thrust."""
    constant_std_ratio: fields.Factor = 3.0
    """Prior deviation of a constant force or moment, over its signal's."""
    preview_step_s: fields.LookAhead = 0.03
    """`control.look_ahead_s` of these cases and of O, where it says nothing."""
