"""External and internal parts of the contact forces of a flight, and their statistics by contact.

The external part `G^+ G lam` applies the wrench of the contact forces to the payload with the least norm. The internal
part `lam - G^+ G lam` applies no wrench.

References:
    Murray, Li, Sastry, *A Mathematical Introduction to Robotic Manipulation*, 1994, ch. 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from colift.models import grasp


class ContactForceParts(NamedTuple):
    """Contact forces on the payload, in the payload frame [N].

    Attributes:
        external: Part `G^+ G lam` `(time, contacts, 3)`.
        internal: Part in the null space of the grasp matrix `(time, contacts, 3)`.
    """

    external: np.ndarray
    internal: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """Sum of both parts [N]."""
        return self.external + self.internal


def split_contact_forces(c: np.ndarray, R: np.ndarray, lam: np.ndarray) -> ContactForceParts:
    """Split contact forces into external and internal part.

    Args:
        c: Attachment points `(contacts, 3)`, payload frame [m].
        R: Attitudes of the payload `(time, 3, 3)`, payload to world.
        lam: Contact forces on the payload `(time, contacts, 3)`, world frame [N].

    Returns:
        Both parts, in the payload frame.
    """
    in_payload = lam @ R  # R^T lam for each contact
    external = (in_payload.reshape(len(lam), -1) @ grasp.external_force_projector(c)).reshape(lam.shape)
    return ContactForceParts(external=external, internal=in_payload - external)


def split_logged_forces(ds: xr.Dataset, c: np.ndarray) -> tuple[ContactForceParts, ContactForceParts]:
    """Split the true and the estimated contact forces of a log, both at the true attitude.

    Args:
        ds: Log.
        c: Attachment points `(contacts, 3)`, payload frame [m].

    Returns:
        Parts of the true and of the estimated forces.
    """
    R = ds.R_L.values
    return split_contact_forces(c, R, ds.lam.values), split_contact_forces(c, R, ds.lam_hat.values)


def prior_statistics(ds: xr.Dataset) -> dict[str, Any]:
    """Compute standard deviations and errors of the combinations of contact forces that rest on a prior.

    The equations of motion of N agents and the payload contain the residuals of all bodies and all contact forces. They
    leave as many combinations undetermined as there are components of contact forces.

    Args:
        ds: Log of a flight whose contact forces are estimated without tip force sensors.

    Returns:
        Number of unknowns (`unknowns`) and of combinations that rest on a prior (`combinations`); for net force and
        net moment of the contact forces, over the second half, the RMS norms of standard deviation (`std`) and error
        (`error_rms`) [N, N m].
    """
    half = ds.isel(time=slice(ds.sizes["time"] // 2, None))
    combinations = 3 * ds.sizes["contact"]
    joints = ds.sizes.get("joint", 0) + ds.sizes.get("prismatic_joint", 0)

    def rms(x: xr.DataArray) -> float:
        return float(np.sqrt((x.values**2).sum(-1).mean()))

    parts = {
        part: {
            "std": rms(half[f"delta_W_std_{part}"]),
            "error_rms": rms(half[f"delta_W_hat_{part}"] - half[f"delta_W_{part}"]),
        }
        for part in ("force", "moment")
    }
    return {"unknowns": combinations + 6 * (ds.sizes["agent"] + 1) + joints, "combinations": combinations} | parts


def contact_force_statistics(ds: xr.Dataset, c: np.ndarray) -> dict[str, dict[str, Any]]:
    """Compute the statistics of the contact forces over the second half of a flight.

    Args:
        ds: Log.
        c: Attachment points `(contacts, 3)`, payload frame [m].

    Returns:
        By contact: peak and mean of the norm of the true force (`peak_N`, `mean_N`) and of its internal part
        (`internal_peak_N`, `internal_mean_N`); mean of estimate minus truth in the payload frame (`bias_N`), and the
        RMS of its norm (`error_rms_N`). For estimates without tip force sensors also the RMS norm of their standard
        deviation (`std_N`).
    """
    truth, estimate = split_logged_forces(ds.isel(time=slice(ds.sizes["time"] // 2, None)), c)
    force, internal = (np.linalg.norm(x, axis=2) for x in (truth.total, truth.internal))
    error = estimate.total - truth.total
    names: Sequence[str] = ds.contact.values.tolist()
    std = ds.lam_std.values[ds.sizes["time"] // 2 :] if "lam_std" in ds else None
    return {
        name: {
            "peak_N": float(force[:, k].max()),
            "mean_N": float(force[:, k].mean()),
            "internal_peak_N": float(internal[:, k].max()),
            "internal_mean_N": float(internal[:, k].mean()),
            "bias_N": error[:, k].mean(0).tolist(),
            "error_rms_N": float(np.sqrt((error[:, k] ** 2).sum(1).mean())),
            **({} if std is None else {"std_N": float(np.sqrt((std[:, k] ** 2).sum(1).mean()))}),
        }
        for k, name in enumerate(names)
    }
