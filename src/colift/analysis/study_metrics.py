"""Metrics that tables and pages of studies contain, with their units and meanings."""

from __future__ import annotations

import math
from typing import NamedTuple


class Metric(NamedTuple):
    """Column of the table of a study.

    Attributes:
        heading: Symbol of the metric.
        unit: Unit of the printed value.
        key: Name of the metric in the summary.
        scale: Factor from the summary's unit to the printed unit.
        spec: Format specification of the printed value.
        meaning: Definition of the metric.
    """

    heading: str
    unit: str
    key: str
    scale: float
    spec: str
    meaning: str

    @property
    def title(self) -> str:
        """Symbol and unit in one line."""
        return f"{self.heading} [{self.unit}]"

    def format(self, value: float | None) -> str:
        """Format a value of the summary, as `format_value`."""
        return format_value(value, self.scale, self.spec)


STUDY_METRICS = (
    Metric("e_p", "mm", "e_p_rms_m", 1e3, ".1f", "RMS norm of the position error"),
    Metric("e_R", "mrad", "e_R_rms", 1e3, ".1f", "RMS norm of the attitude error"),
    Metric("Ψ", "1e-6", "Psi_mean", 1e6, ".1f", "mean of the attitude error function"),
    Metric("ΔW", "N", "delta_W_force_rms_N", 1.0, ".2f", "RMS norm of the wrench mismatch, force"),
    Metric("ΔW", "N m", "delta_W_moment_rms_Nm", 1.0, ".2f", "RMS norm of the wrench mismatch, moment"),
    Metric("e_λ", "N", "e_lam_rms_N", 1.0, ".2f", "RMS norm of contact forces minus commanded contact forces"),
    Metric("σ_L", "N", "sigma_L_force_mean_N", 1.0, ".2f", "mean predictive standard deviation of the payload force"),
    Metric("σ_A", "N", "sigma_A_force_mean_N", 1.0, ".2f", "mean predictive standard deviation of the agent forces"),
    Metric("λ", "max N", "lam_max_N", 1.0, ".1f", "largest contact force"),
    Metric("u", "max N", "thrust_max_N", 1.0, ".1f", "largest thrust"),
)
"""Columns of the table of a study. All values are over the second half of the flight."""


def format_value(value: float | None, scale: float, spec: str) -> str:
    """Format a number of a table.

    Args:
        value: Number; None if it does not exist.
        scale: Factor before formatting.
        spec: Format specification.

    Returns:
        The text, ``none`` for a number that does not exist or is not finite.
    """
    if value is None or not math.isfinite(value):
        return "none"
    return format(value * scale, spec if abs(value * scale) < 1e5 else ".0e")
