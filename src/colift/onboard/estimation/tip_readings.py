"""Detection of tip force sensors that are stuck at a value.

A reading with noise differs from the previous one. A reading that stays unchanged is therefore as old as its last
change, whatever age the sensor reports.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models.measurement import Measurement

Scalar = Float[Array, ""]


@pytree
class TipReadings:
    """Last tip force readings, by group.

    Attributes:
        last: Readings of the previous control period [N, frame of the tip body].
        unchanged_time: Time since each reading changed [s].
    """

    last: tuple[Float[Array, "_agents _arms 3"], ...]
    unchanged_time: tuple[Float[Array, "_agents _arms"], ...]


def initial_tip_readings(measurement: Measurement) -> TipReadings:
    """Return the state after a first measurement.

    Args:
        measurement: Readings of the team at rest.
    """
    last = tuple(m.lam for m in measurement.agents)
    return TipReadings(last=last, unchanged_time=tuple(jnp.zeros(lam.shape[:2]) for lam in last))


def update_tip_readings(state: TipReadings, measurement: Measurement, dt: Scalar) -> TipReadings:
    """Advance the state by one control period.

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
    return TipReadings(last=new, unchanged_time=unchanged)
