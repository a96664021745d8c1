"""Conversion of settings: equal arrays are shared, and user-defined sections without a hash are accepted."""

import jax
import numpy as np

import colift
from colift.math.pytree import MAX_SHARED_BYTES, transfer
from colift.onboard.learning import residual_model
from colift.scenario import conversion, priors, team


def test_equal_small_arrays_are_one_object():
    x = np.arange(3.0)
    assert transfer(x) is transfer(x.copy())
    for other in (x.reshape(1, 3), x.astype(int), np.array([-0.0, 1.0, 2.0])):
        assert transfer(other) is not transfer(x)
        np.testing.assert_array_equal(np.signbit(transfer(other)), np.signbit(other))
    large = np.zeros(MAX_SHARED_BYTES // 8 + 1)
    assert transfer(large) is not transfer(large)


def test_changed_source_does_not_change_the_array():
    x = np.zeros(2)
    made = transfer(x)
    x[0] = 1.0
    np.testing.assert_array_equal(made, np.zeros(2))


def test_array_made_in_a_trace_is_valid_after_it():
    x = np.array([7.0, 11.0])
    jax.jit(lambda y: y + transfer(x))(x)
    np.testing.assert_array_equal(transfer(x), x)


def test_function_is_evaluated_once_for_equal_arguments():
    calls = []
    f = conversion.once(lambda x: calls.append(x) or len(calls))
    assert f((1, 2)) == f((1, 2)) == 1
    assert f([1, 2]) == 2  # without a hash
    assert f([1, 2]) == 3


def test_equal_priors_share_their_arrays():
    def made(**overrides: float) -> residual_model.ResidualModel:
        settings = colift.load_scenario("paper", overrides=overrides)
        return priors.prior_model(settings, team.team(settings)[1])

    first, heavier = made(), made(**{"payload.mass_kg": 1.6})
    assert heavier.payload is first.payload
    other = made(**{"learning.payload.noise_std.force_N": 0.2})
    np.testing.assert_allclose(other.payload.hyper.noise_variance[:3], 0.04)
    np.testing.assert_allclose(first.payload.hyper.noise_variance[:3], 0.01)
