"""Scenario, poses and reference attitudes of a logged flight."""

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
    """The scenario that a log holds; raises ValueError where it holds none that this version reads."""
    try:
        told = json.loads(ds.attrs["scenario_json"])
        told = migrate_data(told)
        told.pop("plugins", None)  # code beside the scenario, of which nothing is drawn
        return Scenario.model_validate_json(json.dumps(told))
    except KeyError:
        raise ValueError(
            f"{ds.attrs.get('case', 'the log')} of {ds.attrs.get('run', 'no run')} does not hold its scenario, as "
            "logs of an earlier colift do not: run colift study again"
        ) from None
    except (ScenarioError, json.JSONDecodeError, AttributeError) as error:
        first = str(error).splitlines()[0]
        raise ValueError(
            f"the scenario in the log is not one of this colift ({first}): run colift study again"
        ) from None


def poses_by_group(at: xr.Dataset, team: Team) -> Iterator[tuple[AerialManipulator, Array, Array, Array]]:
    """Each group of a team with attitudes, centres of mass, m, and joints of its agents along a log; time leads."""
    agents = joints = 0
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        own, n = slice(agents, agents + size), size * group.tree.joints
        r = at.r.values[:, joints : joints + n].reshape(at.sizes["time"], size, group.tree.joints)
        yield group, jnp.asarray(at.R.values[:, own]), jnp.asarray(at.x.values[:, own]), jnp.asarray(r)
        agents, joints = agents + size, joints + n


@jax.jit
def desired_attitude(
    R: Float[Array, "time 3 3"], e_R: Float[Array, "time 3"], Psi: Float[Array, "time"]
) -> Float[Array, "time 3 3"]:
    """`R_d = R Q^T` with `Q = R_d^T R = I + hat(e_R) + hat(e_R)^2 / (2 - Psi)`: Rodrigues' formula, sine and cosine."""
    skew = so3.hat(e_R)
    turn = 1 / jnp.maximum(2 - Psi, 1e-12)
    return R @ transpose(so3.identity((len(Psi),)) + skew + turn[:, None, None] * (skew @ skew))
