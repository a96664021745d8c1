"""Scenario, agent poses and reference attitudes from the log of a flight."""

from __future__ import annotations

import json
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import xarray as xr
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import transpose
from colift.models.parameters import AerialManipulator, Team
from colift.scenario import Scenario, ScenarioError
from colift.scenario.migration import migrate_data


def scenario_of_log(ds: xr.Dataset) -> Scenario:
    """Return the scenario that is stored in a log.

    Args:
        ds: Dataset of a flight.

    Returns:
        The scenario, migrated to the present schema.

    Raises:
        ValueError: If the log contains no scenario that this version can read.
    """
    try:
        data = json.loads(ds.attrs["scenario_json"])
        data = migrate_data(data, strict=False)
        data.pop("plugins", None)  # drawing a team needs no plugin code
        return Scenario.model_validate_json(json.dumps(data))
    except KeyError:
        raise ValueError(
            f"the log {ds.attrs.get('case', '')} of run {ds.attrs.get('run', 'unknown')} contains no scenario; it was "
            "written by an earlier version of colift: run colift study again"
        ) from None
    except (ScenarioError, json.JSONDecodeError, AttributeError) as error:
        first = str(error).splitlines()[0]
        raise ValueError(
            f"this version of colift cannot read the scenario in the log ({first}): run colift study again"
        ) from None


def poses_by_group(ds: xr.Dataset, team: Team) -> Iterator[tuple[AerialManipulator, Array, Array, Array]]:
    """Yield each group of a team with its attitudes, centers of mass and joint positions along a log.

    Args:
        ds: Dataset with the times to use.
        team: Team that determines the layout.

    Yields:
        Group, attitudes (body to world), centers of mass [m, world] and joint positions [rad or m]; time first.
    """
    agents = joints = 0
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        agent_slice, n = slice(agents, agents + size), size * group.tree.joints
        r = ds.r.values[:, joints : joints + n].reshape(ds.sizes["time"], size, group.tree.joints)
        yield group, jnp.asarray(ds.R.values[:, agent_slice]), jnp.asarray(ds.x.values[:, agent_slice]), jnp.asarray(r)
        agents, joints = agents + size, joints + n


@jax.jit
def desired_attitude(
    R: Float[Array, "time 3 3"], e_R: Float[Array, "time 3"], Psi: Float[Array, "time"]
) -> Float[Array, "time 3 3"]:
    """Compute the desired attitude from attitude, attitude error and error function.

    The result is `R_d = R Q^T` with `Q = R_d^T R = I + hat(e_R) + hat(e_R)^2 / (2 - Psi)`, from Rodrigues' formula.

    Args:
        R: Payload attitude, body to world.
        e_R: Attitude error.
        Psi: Attitude error function `tr(I - R_d^T R) / 2`.

    Returns:
        Desired attitude, body to world.
    """
    skew = so3.hat(e_R)
    weight = 1 / jnp.maximum(2 - Psi, 1e-12)
    return R @ transpose(so3.identity((len(Psi),)) + skew + weight[:, None, None] * (skew @ skew))
