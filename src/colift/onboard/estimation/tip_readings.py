"""Detection of tip force sensors that are stuck at a value or have wrong values.

A reading with noise differs from the previous one. A reading that stays unchanged is therefore as old as its last
change, whatever age the sensor reports.

A wrong reading changes the force label of the payload and the sum of the agents' force labels by opposite forces, and
not the sum of both, which contains no reading. A change e of the payload's label with a change d of the agents' labels
has three explanations: the residual of the payload (d is noise), those of agents (e is noise), or a wrong reading
(e + d is noise). With the mean squares ``S`` of each component a reading is wrong if the last explanation is better::

    min(sum e^2 / S_e, sum d^2 / S_d) - sum (e + d)^2 / S_(e + d) > k^2

Changes are relative to the label filter. If one residual changes and the noise is Gaussian, the left side exceeds
k^2 = 36 with a probability below 1e-7 (chi-square distribution with three degrees of freedom).

Errors whose sum over the arms of an agent is zero are not detected, since they change no force label.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from colift.math import linalg
from colift.math.pytree import pytree
from colift.models.measurement import Measurement
from colift.onboard.estimation.contact_forces import TeamBalance

Scalar = Float[Array, ""]
FilteredLabels = tuple[Float[Array, "6"], tuple[Float[Array, "_agents _outputs"], ...]]  # of payload and agents

FAILURE_FACTOR = 6.0
"""Number k of standard deviations by which a wrong reading must be the better explanation."""
AVERAGING_TIME, START = 5.0, 1.0
"""Time constant of the mean squares, and time of their first use [s]."""
TINY = 1e-12
"""Mean square that avoids a division by zero [N^2]."""


@pytree
class TipReadings:
    """Last tip force readings, by group.

    Attributes:
        last: Readings of the previous control period [N, frame of the tip body].
        unchanged_time: Time since each reading changed [s].
        mean_squares: Mean squares of the changes of the payload's force label, of the sum of the agents' force labels,
            and of the sum of both [N^2, world].
        time: Time of the mean squares [s].
        failed: Whether a reading was wrong; then no reading is used until the end of the flight.
    """

    last: tuple[Float[Array, "_agents _arms 3"], ...]
    unchanged_time: tuple[Float[Array, "_agents _arms"], ...]
    mean_squares: Float[Array, "3 3"]
    time: Scalar
    failed: Bool[Array, ""]


def initial(measurement: Measurement) -> TipReadings:
    """Return the state after a first measurement.

    Args:
        measurement: Readings of the team at rest.
    """
    last = tuple(m.lam for m in measurement.agents)
    return TipReadings(
        last=last,
        unchanged_time=tuple(jnp.zeros(lam.shape[:2]) for lam in last),
        mean_squares=jnp.zeros((3, 3)),
        time=jnp.zeros(()),
        failed=jnp.zeros((), bool),
    )


def update(
    state: TipReadings,
    measurement: Measurement,
    balance: TeamBalance,
    filtered: FilteredLabels,
    have_labels: Bool[Array, ""],
    dt: Scalar,
) -> tuple[TeamBalance, TipReadings]:
    """Advance the detection by one control period.

    Args:
        state: State after the previous control period.
        measurement: Readings of this control period.
        balance: Equations of motion with the readings and the age that their sensors report.
        filtered: Labels of payload and agents after the label filter, in the previous control period.
        have_labels: Whether labels existed in the previous control period.
        dt: Control period [s].

    Returns:
        The equations of motion with the age of the readings, inf after a wrong reading, and the next state.
    """
    state = count_unchanged(state, measurement, dt)
    age = jnp.maximum(balance.reading_age, jnp.concatenate([time.reshape(-1) for time in state.unchanged_time]).max())
    state = detect_wrong_readings(state, force_label_changes(balance, filtered), have_labels & (age <= 0), dt)
    return dataclasses.replace(balance, reading_age=jnp.where(state.failed, jnp.inf, age)), state


def count_unchanged(state: TipReadings, measurement: Measurement, dt: Scalar) -> TipReadings:
    """Advance the times without a change of the readings by one control period.

    Args:
        state: State after the previous control period.
        measurement: Readings of this control period.
        dt: Control period [s].

    Returns:
        The next state.
    """
    new = tuple(m.lam for m in measurement.agents)
    unchanged = tuple(
        jnp.where((lam == old).all(-1), time + dt, 0.0)
        for lam, old, time in zip(new, state.last, state.unchanged_time, strict=True)
    )
    return dataclasses.replace(state, last=new, unchanged_time=unchanged)


def force_label_changes(balance: TeamBalance, filtered: FilteredLabels) -> Float[Array, "2 3"]:
    """Return the force labels with the tip readings minus filtered labels.

    Args:
        balance: Equations of motion and readings.
        filtered: Filtered labels of payload and agents.

    Returns:
        Change of the payload's label, and sum of the agents' changes [N, world].
    """
    payload, agents = balance.payload.y[:3] - filtered[0][:3], jnp.zeros(3)
    for each, of_group in zip(balance.agents, filtered[1], strict=True):
        lam = linalg.matvec(each.R, each.measured.sum(1))
        payload, agents = payload - lam.sum(0), agents + (each.y[:, :3] + lam - of_group[:, :3]).sum(0)
    return jnp.stack([payload, agents])


def detect_wrong_readings(
    state: TipReadings, errors: Float[Array, "2 3"], is_new: Bool[Array, ""], dt: Scalar
) -> TipReadings:
    """Advance the detection of wrong readings by one control period.

    Args:
        state: State after `count_unchanged`.
        errors: Changes of the labels of payload and agents (`force_label_changes`).
        is_new: Whether readings and filtered labels are recent; otherwise the state stays as it is.
        dt: Control period [s].

    Returns:
        The next state.
    """
    squares = jnp.concatenate([errors, errors.sum(0)[None]]) ** 2
    payload, agents, both = (squares / (state.mean_squares + TINY)).sum(1)
    is_wrong = (jnp.minimum(payload, agents) - both > FAILURE_FACTOR**2) & (state.time >= START)
    used = is_new.astype(float)
    time = state.time + used * dt
    gain = used * jnp.maximum(dt / jnp.maximum(time, dt), -jnp.expm1(-dt / AVERAGING_TIME))
    return dataclasses.replace(
        state,
        mean_squares=state.mean_squares + gain * (squares - state.mean_squares),
        time=time,
        failed=state.failed | (is_wrong & is_new),
    )
