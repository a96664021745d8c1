"""Tests of the external and internal parts of contact forces."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.analysis import contact_forces
from colift.models import grasp
from tests.support import random_logs as flights

C = np.array([[0.5, 0.36, 0.05], [0.5, -0.36, 0.05], [-0.5, 0.36, 0.05], [-0.5, -0.36, 0.05]])


@pytest.fixture
def forces() -> tuple[np.ndarray, np.ndarray]:
    """Random attitudes and contact forces in the world frame."""
    rng = np.random.default_rng(1)
    return Rotation.random(20, random_state=1).as_matrix(), rng.normal(size=(20, len(C), 3))


def test_external_part_has_the_wrench_of_the_forces(forces):
    """The external part has the whole wrench, and the internal part has none."""
    R, lam = forces
    parts = contact_forces.split_contact_forces(C, R, lam)
    np.testing.assert_allclose(parts.total, np.einsum("tji,tcj->tci", R, lam), atol=1e-14)
    wrench = lambda x: np.concatenate([x.sum(1), np.cross(C, x).sum(1)], axis=1)  # noqa: E731
    np.testing.assert_allclose(wrench(parts.external), wrench(parts.total), atol=1e-13)
    np.testing.assert_allclose(wrench(parts.internal), 0, atol=1e-13)


def test_external_part_has_the_least_norm(forces):
    """Both parts are orthogonal, so no other forces with the same wrench have a smaller norm."""
    parts = contact_forces.split_contact_forces(C, *forces)
    np.testing.assert_allclose((parts.external * parts.internal).sum((1, 2)), 0, atol=1e-13)


def test_split_equals_the_definition_at_each_attitude(forces):
    """In the world frame the external part is `G^+ G lam` with G at the attitude."""
    R, lam = forces
    parts = contact_forces.split_contact_forces(C, R, lam)
    for k in (0, 7):
        G = np.asarray(grasp.grasp_matrix(jnp.asarray(C), jnp.asarray(R[k])))
        np.testing.assert_allclose((np.linalg.pinv(G) @ G @ lam[k].ravel()).reshape(-1, 3) @ R[k], parts.external[k])


def test_statistics_are_those_of_the_second_half():
    ds = flights.dataset(np.random.default_rng(2), flights.PAPER._replace(time=40))
    ds.R_L[:] = Rotation.random(40, random_state=3).as_matrix()
    ds.lam[:20] = 1e3
    ds.lam_hat[:] = ds.lam + np.einsum("tij,j->ti", ds.R_L.values, [0.3, -0.1, 0.2])[:, None]
    found = contact_forces.contact_force_statistics(ds, C)
    assert list(found) == ds.contact.values.tolist()
    norms = np.linalg.norm(ds.lam.values[20:], axis=2)
    for k, each in enumerate(found.values()):
        assert each["peak_N"] == pytest.approx(norms[:, k].max())
        assert each["mean_N"] == pytest.approx(norms[:, k].mean())
        assert 0 < each["internal_mean_N"] < each["internal_peak_N"] < each["peak_N"]
        assert each["bias_N"] == pytest.approx([0.3, -0.1, 0.2])
        assert each["error_rms_N"] == pytest.approx(np.sqrt(0.14))
