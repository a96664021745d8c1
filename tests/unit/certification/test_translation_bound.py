"""Tests of peak-to-peak gains: closed forms, brute force, inputs that attain them, and random inputs that do not exceed
them.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import minimize
from scipy.special import softmax

from colift.certification import peak_gain, translation_bound
from evidence.translation import DAMPINGS, MIXINGS, gains, textbook

seeds = st.integers(0, 2**31)
dampings, mixings = st.sampled_from(DAMPINGS), st.sampled_from(MIXINGS)


def simulate(K_p, K_v, d, h, e=None):
    """Return |e_p| and |e_v| after each step of length h with d held, by Runge-Kutta on the error equation."""
    e_p, e_v = np.zeros((2, *d.shape[1:])) if e is None else e
    rate = lambda p, v, d: (v, -p @ K_p - v @ K_v + d)  # noqa: E731
    found = []
    for now in d:
        a = rate(e_p, e_v, now)
        b = rate(e_p + h / 2 * a[0], e_v + h / 2 * a[1], now)
        c = rate(e_p + h / 2 * b[0], e_v + h / 2 * b[1], now)
        f = rate(e_p + h * c[0], e_v + h * c[1], now)
        e_p, e_v = (x + h / 6 * (p + 2 * q + 2 * r + s) for x, p, q, r, s in zip((e_p, e_v), a, b, c, f, strict=True))
        found.append((np.linalg.norm(e_p, axis=-1), np.linalg.norm(e_v, axis=-1)))
    return np.array(found)


@given(seeds, dampings, mixings, st.floats(0.1, 3.0))
@settings(max_examples=16)
def test_bound_is_attained_by_its_bang_bang_input(seed, damping, mixing, rho):
    """The bang-bang disturbance attains the bound within one percent."""
    K_p, K_v = gains(seed, damping, mixing)
    for which, peak in enumerate(vars(translation_bound.ultimate_bound(K_p, K_v, rho)).values()):
        d = peak.inputs[:-1]  # the last input acts through D, which is zero
        assert np.linalg.norm(d, axis=1).max() <= rho * (1 + 1e-12)
        reached = simulate(K_p, K_v, d, peak.step)[-1, which]
        assert reached == pytest.approx(peak.lower_bound, rel=1e-4)
        assert reached <= peak.bound <= 1.002 * reached
        assert peak.bound == pytest.approx(peak.contributions.sum(), rel=2e-3)


@given(seeds, dampings, mixings)
@settings(max_examples=12)
def test_bounded_disturbances_do_not_exceed_the_bound(seed, damping, mixing):
    """Rough, switching, rotating and constant disturbances of maximal magnitude."""
    K_p, K_v = gains(seed, damping, mixing)
    rng, bound = np.random.default_rng(seed), translation_bound.ultimate_bound(K_p, K_v, 1.0)
    h, steps, runs = 0.01, 600, 200
    t, w = h * np.arange(steps)[:, None, None], rng.uniform(0.2, 10, (runs, 1))
    u, v = np.linalg.qr(rng.normal(size=(runs, 3, 2)))[0].transpose(2, 0, 1)
    kinds = np.stack(
        [
            np.repeat(rng.normal(size=(steps // 20, runs, 3)), 20, axis=0),
            np.sign(np.cos(w * t)) * u,
            np.cos(w * t) * u + np.sin(w * t) * v,
            np.ones((steps, 1, 1)) * u,
        ]
    )
    d = kinds[rng.integers(0, 4, runs), :, np.arange(runs)].transpose(1, 0, 2)
    found = simulate(K_p, K_v, d / np.linalg.norm(d, axis=-1, keepdims=True), h).max((0, 2))
    assert found[0] <= bound.e_p.bound
    assert found[1] <= bound.e_v.bound
    assert found[0] >= 0.5 * bound.e_p.bound  # random inputs are close to the bound


@pytest.mark.long
@given(st.floats(1, 40), st.floats(0.1, 2.5))
@settings(max_examples=12)
def test_equal_axes_have_the_gain_of_one_axis(k_p, zeta):
    """`integral |h| = coth(zeta pi / (2 sqrt(1 - zeta^2))) / k_p` below critical damping, `1 / k_p` above."""
    expected = 1 / k_p
    if zeta < 1 - 1e-9:
        expected /= np.tanh(zeta * np.pi / 2 / np.sqrt(1 - zeta**2))
    bound = translation_bound.ultimate_bound(k_p, 2 * zeta * k_p**0.5, 1.0).e_p.bound
    assert expected <= bound <= 1.001 * expected


def test_worst_direction_may_be_oblique():
    """Diagonal gains: the maximum of the concave `integral sqrt(sum h_i^2 w_i)` over the simplex, by quadrature.

    Between the axes a disturbance spends its size where each axis answers most; no single axis reaches as far.
    """
    k_p, k_v = np.array([4.0, 1.54, 30.0]), np.array([1.0, 8.0, 12.0])

    def h(t):
        root = np.sqrt((k_v**2 / 4 - k_p).astype(complex))
        return (np.exp(-k_v / 2 * t) * np.sinh(root * t) / root).real

    def f(w):
        return quad(lambda t: np.sqrt(h(t) ** 2 @ w), 0, 60, limit=2000, epsabs=1e-7)[0]

    # The softmax covers the inside of the simplex without constraints.
    best = minimize(lambda x: -f(softmax([*x, 0.0])), [1.8, 1.1], method="Nelder-Mead")
    found = translation_bound.ultimate_bound(np.diag(k_p), np.diag(k_v), 1.0).e_p
    assert found.lower_bound <= -best.fun * (1 + 1e-4)
    assert -best.fun <= found.bound <= 1.002 * -best.fun
    assert found.bound > 1.05 * max(f(axis) for axis in np.eye(3))


@given(seeds, dampings, mixings)
@settings(max_examples=15)
def test_textbook_constants_are_looser(seed, damping, mixing):
    K_p, K_v = gains(seed, damping, mixing)
    assert textbook(K_p, K_v) > translation_bound.ultimate_bound(K_p, K_v, 1.0).e_p.bound


def stable(rng, n, columns, rows):
    A = rng.normal(size=(n, n))
    A *= rng.uniform(0.5, 0.97) / np.abs(np.linalg.eigvals(A)).max()
    return A, rng.normal(size=(n, columns)), rng.normal(size=(rows, n)), rng.normal(size=(rows, columns))


@given(seeds, st.integers(1, 3))
@settings(max_examples=15)
def test_discrete_bound_is_attained_by_all_groups(seed, rows):
    """In discrete time all groups together attain the bound and never exceed it."""
    rng = np.random.default_rng(seed)
    groups, rho = [1, 3, 2], rng.uniform(0, 2, 3)
    A, B, C, D = stable(rng, 6, 6, rows)
    peak = peak_gain.peak_gain_discrete(A, B, C, D, groups, rho)

    def last(inputs):
        x = np.zeros(6)
        for d in inputs[:-1]:
            x = A @ x + B @ d
        return np.linalg.norm(C @ x + D @ inputs[-1])

    parts = np.split(peak.inputs, np.cumsum(groups)[:-1], axis=1)
    assert all(
        np.linalg.norm(part, axis=1).max() <= limit * (1 + 1e-12) for part, limit in zip(parts, rho, strict=True)
    )
    assert last(peak.inputs) == pytest.approx(peak.lower_bound, rel=1e-9)
    assert last(peak.inputs) <= peak.bound <= 1.002 * last(peak.inputs)
    for _ in range(20):
        random = [rng.normal(size=part.shape) for part in parts]
        sized = [limit * r / np.linalg.norm(r, axis=1, keepdims=True) for r, limit in zip(random, rho, strict=True)]
        assert last(np.hstack(sized)) <= peak.bound


@given(seeds)
@settings(max_examples=15)
def test_bound_of_one_output_is_the_sum_of_norms(seed):
    """With one output the bound is the sum of the norms of the responses."""
    rng = np.random.default_rng(seed)
    A, B, C, D = stable(rng, 4, 3, 1)
    expected, power = 2 * np.linalg.norm(D[:, :2]) + 0.5 * abs(D[0, 2]), np.eye(4)
    for _ in range(3000):
        h = (C @ power @ B)[0]
        expected += 2 * np.linalg.norm(h[:2]) + 0.5 * abs(h[2])
        power = power @ A
    assert expected <= peak_gain.peak_gain_discrete(A, B, C, D, [2, 1], [2.0, 0.5]).bound <= 1.0001 * expected


@given(seeds)
@settings(max_examples=8)
def test_discrete_gain_converges_to_the_continuous_gain(seed):
    """Held inputs are a subset of all inputs: the gain of the sampled system is smaller, by first order in the step."""
    rng = np.random.default_rng(seed)
    A, B, C, _ = stable(rng, 4, 3, 2)
    A = A - (np.max(np.linalg.eigvals(A).real) + 0.3) * np.eye(4)
    whole = peak_gain.peak_gain_continuous(A, B, C, None, [2, 1], [1.0, 0.3])
    h = 0.004
    both = expm(h * np.block([[A, B], [np.zeros((3, 7))]]))
    sampled = peak_gain.peak_gain_discrete(both[:4, :4], both[:4, 4:], C, None, [2, 1], [1.0, 0.3])
    assert sampled.lower_bound <= whole.bound
    assert whole.lower_bound <= 1.02 * sampled.bound


@pytest.mark.parametrize(
    ("K_p", "K_v", "rho", "message"),
    [
        (5.0, -0.1, 1.0, "K_v has the eigenvalue -0.1: must be positive definite"),
        (np.diag([1.0, 0.0, 1.0]), 1.0, 1.0, "K_p has the eigenvalue 0: must be positive definite"),
        (np.eye(3) + np.eye(3, k=1), 1.0, 1.0, "must be symmetric"),
        (np.eye(2), 1.0, 1.0, "3 x 3"),
        (1.0, float("nan"), 1.0, "must be a finite number"),
        (1.0, 1.0, -1.0, "rho = -1.0 m/s\\^2: must be finite and at least 0"),
    ],
)
def test_gains_without_bound_are_refused(K_p, K_v, rho, message):
    with pytest.raises(ValueError, match=message):
        translation_bound.ultimate_bound(K_p, K_v, rho)


def test_unstable_and_unresolvable_systems_are_refused():
    eye, one = np.eye(2), [1.0]
    with pytest.raises(ValueError, match="unstable: an eigenvalue has real part 0 1/s"):
        peak_gain.peak_gain_continuous(np.array([[0.0, 1.0], [0.0, -1.0]]), eye, eye, None, [2], one)
    with pytest.raises(ValueError, match=r"unstable: an eigenvalue has modulus 1\.1"):
        peak_gain.peak_gain_discrete(1.1 * eye, eye, eye, None, [2], one)
    with pytest.raises(ValueError, match="too slow to resolve"):
        peak_gain.peak_gain_discrete((1 - 1e-9) * eye, eye, eye, None, [2], one)
    with pytest.raises(ValueError, match="C has 4 rows"):
        peak_gain.peak_gain_discrete(0.5 * eye, eye, np.ones((4, 2)), None, [2], one)
    with pytest.raises(ValueError, match="add up to the 2 columns of B"):
        peak_gain.peak_gain_discrete(0.5 * eye, eye, eye, None, [1], one)


def test_bound_without_disturbance_is_zero():
    nothing = translation_bound.ultimate_bound(5.0, 4.2, 0.0)
    assert nothing.e_p.bound == nothing.e_v.bound == nothing.e_p.lower_bound == 0.0
