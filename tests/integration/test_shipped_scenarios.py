"""Tests that a process without the test configuration computes the same values, and of the shipped teams."""

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
from colift.scenario import experiment, team
from colift.simulation.contact_dynamics import CONSISTENCY_TOLERANCE
from evidence import redundant
from tests.support import shipped_flights as shipped

ROOT = Path(__file__).parents[2]
FLAG = "--xla_cpu_experimental_ynn_fusion_type="


def run(*words: str, **env: str) -> subprocess.CompletedProcess[str]:
    """Run a new interpreter in the checkout, with `XLA_FLAGS` only if given."""
    inherited = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    command = [sys.executable, *words]
    return subprocess.run(command, cwd=ROOT, env=inherited | env, capture_output=True, text=True, check=False)


@pytest.mark.long
def test_values_without_test_configuration_are_equal(tmp_path):
    """Values agree to rounding with those of a process without the import hook.

    That is 1e-9 of each signal's size, and what a consistent state may be off for signals that are rounding themselves.
    """
    path = tmp_path / "values.npz"
    done = run("-m", "tests.support.shipped_flights", str(path), XLA_FLAGS=os.environ["XLA_FLAGS"])
    assert done.returncode == 0, done.stderr
    expected = shipped.values()
    with np.load(path) as found:
        assert [name.partition(" ")[2] for name in found.files] == list(expected)
        for (name, x), y in zip(expected.items(), found.values(), strict=True):
            assert (y.dtype, y.shape) == (x.dtype, x.shape), name
            size = np.abs(x).max(initial=0.0, where=np.isfinite(x)) if x.dtype.kind == "f" else 0.0
            np.testing.assert_allclose(y, x, rtol=0, atol=max(1e-9 * size, CONSISTENCY_TOLERANCE), err_msg=name)


def fill_freed_memory_with_nan() -> None:
    """Leave NaN in freed memory, in blocks of many sizes."""
    blocks = [np.full(int(n), np.nan) for n in np.geomspace(8, 2e5, 400)]
    del blocks


def test_values_do_not_depend_on_uninitialized_memory():
    """Docs decision 0020: XLA's YNNPACK kernels gave NaN for two GPs with equal length-scales in one program."""
    model = gp.prior(gp.make_hyperparameters(np.ones(9), np.ones(24), 1e-4), 256)
    group = jax.tree.map(lambda x: jnp.stack([x, x]), model)
    f = jax.jit(lambda x: jax.vmap(gp.mean)(group, x))
    for _ in range(20):
        fill_freed_memory_with_nan()
        np.testing.assert_array_equal(f(jnp.ones((2, 24))), np.zeros((2, 9)))


def test_sum_of_products_is_exact_for_long_arrays():
    """Docs decision 0020: YNNPACK computed a wrong sum for the last of 16 385 rows, in float64."""
    n = 16_385
    x = jnp.stack([jnp.arange(n, dtype=float), jnp.zeros(n), jnp.zeros(n)], axis=1)
    squares = jax.jit(jax.vmap(lambda row: jnp.sum((jnp.eye(3) @ row) ** 2)))(x)
    np.testing.assert_array_equal(squares, np.arange(n, dtype=float) ** 2)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, FLAG),
        ({"XLA_FLAGS": "--xla_cpu_max_isa=AVX2"}, f"{FLAG} --xla_cpu_max_isa=AVX2"),
        ({"XLA_FLAGS": f"{FLAG}dot"}, f"{FLAG}dot"),  # an explicit flag of the user is kept
    ],
)
def test_faulty_xla_kernels_are_off_unless_requested(settings, expected):
    done = run("-W", "error", "-c", "import os, colift; print(os.environ['XLA_FLAGS'])", **settings)
    assert (done.returncode, done.stdout.strip()) == (0, expected), done.stderr


def test_jax_use_before_import_gives_a_warning():
    """If JAX was used before colift is imported, a warning states the possible error."""
    used = "import jax; jax.numpy.ones(3); import colift"
    late = run("-c", used)
    assert late.returncode == 0
    assert "RuntimeWarning: JAX was in use before colift was imported" in late.stderr
    assert FLAG in late.stderr
    assert run("-W", "error", "-c", used, XLA_FLAGS=FLAG).returncode == 0
    assert run("-W", "error", "-c", "import jax; import colift; jax.numpy.ones(3)").returncode == 0


@pytest.mark.long
@pytest.mark.parametrize("name", scenario.shipped_names())
def test_no_shipped_scenario_is_unsound(name: str):
    settings = scenario.load_scenario(name)
    c1 = experiment.make_experiment(settings, "C1")
    report, _ = preflight.check_experiment(settings, c1, "C1", search=False)
    assert report.passed, report.format_report()


TEAMS = ("beam", "trio", "uneven", "plate", "seven", "hover", "heavy", "turning")


@pytest.mark.parametrize("name", TEAMS)
def test_shipped_teams_have_a_regular_grasp(name: str):
    """Grasp condition, thrust reserve and reference of shipped teams; test_initial_states.py has the start."""
    settings = scenario.load_scenario(name)
    truth, _ = team.team(settings)
    values = grasp.grasp_matrix_singular_values(
        truth, length=float(np.sqrt((np.asarray(grasp.contact_points(truth)) ** 2).sum(1).mean()))
    )
    assert values[0] < preflight.MAX_GRASP_CONDITION * values[-1]
    thrust_max = np.concatenate([np.asarray(group.thrust_max) for group in truth.agent_groups])
    payload_mass = float(truth.payload.mass)
    weight = 9.81 * (payload_mass + sum(float(group.mass.sum()) for group in truth.agent_groups))
    assert thrust_max.sum() > 1.3 * weight
    assert (name == "heavy") == bool(9.81 * payload_mass > thrust_max.max())
    assert (name == "turning") == any(settings.reference.rotation_amplitude_deg)
    assert (name == "hover") == (not any(settings.reference.amplitude_m))


@pytest.mark.long
@pytest.mark.parametrize("name", redundant.TEAMS)
def test_errors_decrease_with_learning_for_redundant_teams(name: str):
    """e_p decreases from case to case. Psi of C3 is below that of C1; that of C2 may be larger (docs/own_team.md)."""
    found = redundant.simulate_item(f"{name} 0")
    assert not any(each["termination_reason"] for each in found.values())
    e_p, Psi = ([found[case][error] for case in redundant.CASES] for error in ("e_p_rms_m", "Psi_mean"))
    assert all(a > b for a, b in itertools.pairwise(e_p)), e_p
    assert Psi[2] < Psi[0]
