"""What ships is what is tested: without the hook of conftest values are the same, whatever memory held before."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import gp, scenario
from colift.analysis import preflight
from colift.models import grasp
from colift.scenario import team
from colift.simulation.contact_dynamics import CONSISTENCY_TOLERANCE
from evidence import redundant
from tests.support import shipped_flights as shipped

ROOT = Path(__file__).parents[2]
FLAG = "--xla_cpu_experimental_ynn_fusion_type="


def run(*words: str, **env: str) -> subprocess.CompletedProcess[str]:
    """A fresh interpreter in the checkout; `XLA_FLAGS` only where given."""
    inherited = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    command = [sys.executable, *words]
    return subprocess.run(command, cwd=ROOT, env=inherited | env, capture_output=True, text=True, check=False)


@pytest.mark.long
def test_without_the_tests_hook_a_flight_and_jax(tmp_path):
    """One program, one machine, one set of instructions: to rounding, for a compiler may run afresh.

    That is 1e-9 of each signal's size, and what a consistent state may be off for signals that are rounding themselves.
    """
    there = tmp_path / "values.npz"
    done = run("-m", "tests.shipped", str(there), XLA_FLAGS=os.environ["XLA_FLAGS"])
    assert done.returncode == 0, done.stderr
    here = shipped.values()
    with np.load(there) as found:
        assert [name.partition(" ")[2] for name in found.files] == list(here)
        for (name, x), y in zip(here.items(), found.values(), strict=True):
            assert (y.dtype, y.shape) == (x.dtype, x.shape), name
            size = np.abs(x).max(initial=0.0, where=np.isfinite(x)) if x.dtype.kind == "f" else 0.0
            np.testing.assert_allclose(y, x, rtol=0, atol=max(1e-9 * size, CONSISTENCY_TOLERANCE), err_msg=name)


def full_of_nan() -> None:
    """Leave NaN in the memory that the process has freed, blocks of many sizes."""
    blocks = [np.full(int(n), np.nan) for n in np.geomspace(8, 2e5, 400)]
    del blocks


def test_a_value_does_not_depend_on_what_memory_held_before():
    """Docs decision 0020: two GPs with equal length-scales that a program closes over, on XLA's YNNPACK kernels NaN."""
    model = gp.prior(gp.make_hyperparameters(np.ones(9), np.ones(24), 1e-4), 256)
    group = jax.tree.map(lambda x: jnp.stack([x, x]), model)
    f = jax.jit(lambda x: jax.vmap(gp.mean)(group, x))
    for _ in range(20):
        full_of_nan()
        np.testing.assert_array_equal(f(jnp.ones((2, 24))), np.zeros((2, 9)))


def test_a_sum_over_products_is_right_at_any_length():
    """Docs decision 0020: the last of 16 385 rows summed wrongly by YNNPACK, in float64."""
    n = 16_385
    x = jnp.stack([jnp.arange(n, dtype=float), jnp.zeros(n), jnp.zeros(n)], axis=1)
    squares = jax.jit(jax.vmap(lambda row: jnp.sum((jnp.eye(3) @ row) ** 2)))(x)
    np.testing.assert_array_equal(squares, np.arange(n, dtype=float) ** 2)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, FLAG),
        ({"XLA_FLAGS": "--xla_cpu_max_isa=AVX2"}, f"{FLAG} --xla_cpu_max_isa=AVX2"),
        ({"XLA_FLAGS": f"{FLAG}dot"}, f"{FLAG}dot"),  # a person's own word stands
    ],
)
def test_xla_s_faulty_kernels_are_off_unless_asked_for(given, expected):
    done = run("-W", "error", "-c", "import os, colift; print(os.environ['XLA_FLAGS'])", **given)
    assert (done.returncode, done.stdout.strip()) == (0, expected), done.stderr


def test_where_jax_was_in_use_before_a_warning_says_what_may():
    """Where jax was in use before a warning says what may be wrong."""
    used = "import jax; jax.numpy.ones(3); import colift"
    late = run("-c", used)
    assert late.returncode == 0
    assert "RuntimeWarning: JAX was in use before colift was imported" in late.stderr
    assert FLAG in late.stderr
    assert run("-W", "error", "-c", used, XLA_FLAGS=FLAG).returncode == 0
    assert run("-W", "error", "-c", "import jax; import colift; jax.numpy.ones(3)").returncode == 0


TEAMS = ("beam", "trio", "uneven", "plate", "seven", "hover", "heavy", "turning")


@pytest.mark.parametrize("name", TEAMS)
def test_a_team_that_ships_stands_on_a_grasp_that_bears(name: str):
    """That it starts on its grasp is seen in test_scenario_starts.py; `./dev evidence tuned` flies the first five."""
    given = scenario.load_scenario(name)
    truth, _ = team.team(given)
    values = grasp.grasp_matrix_singular_values(
        truth, length=float(np.sqrt((np.asarray(grasp.contact_points(truth)) ** 2).sum(1).mean()))
    )
    assert values[0] < preflight.MAX_GRASP_CONDITION * values[-1]
    have = np.concatenate([np.asarray(group.thrust_max) for group in truth.agent_groups])
    load = float(truth.payload.mass)
    weight = 9.81 * (load + sum(float(group.mass.sum()) for group in truth.agent_groups))
    assert have.sum() > 1.3 * weight
    assert (name == "heavy") == bool(9.81 * load > have.max())
    assert (name == "turning") == any(given.reference.rotation_amplitude_deg)
    assert (name == "hover") == (not any(given.reference.amplitude_m))


@pytest.mark.long
@pytest.mark.parametrize("name", redundant.TEAMS)
def test_teams_with_joints_beyond_need_or_two_arms_err_less(name: str):
    """e_p falls from C1 to C4, and C3's Psi is below C1's; that of C2 need not be, as docs/own_team.md says."""
    found = redundant.fly(f"{name} 0")
    assert not any(each["termination_reason"] for each in found.values())
    e_p, Psi = ([found[case][error] for case in redundant.CASES] for error in ("e_p_rms_m", "Psi_mean"))
    assert all(a > b for a, b in itertools.pairwise(e_p)), e_p
    assert Psi[2] < Psi[0]
