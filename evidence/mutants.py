"""Plausible mistakes, one at a time, in control, estimation, learning and certificates: the tests must see each.

A mutant is one line changed in a copy of the project. First the test that should see it runs, then, if that passes,
all tests of the modules named. Kept: which test failed, or that the mutant lived.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from evidence import ROOT, collect

RUNS = ("src", "tests")  # which a mutant is made of


class Mutant(NamedTuple):
    """One mistake: in which file, what stands there, what is put in its place, and who should see it."""

    file: str
    now: str
    then: str
    tests: str  # modules of tests, by their names without `test_`
    first: str = ""  # words of the test that should see it


MUTANTS = {
    # the leader
    "jerk: sign of K_v (a - a_d)": Mutant(
        "control.py", "- gains.K_v @ (a - d.a)", "+ gains.K_v @ (a - d.a)", "control", "jerk"
    ),
    "jerk: sign of K_p e_v": Mutant(
        "control.py", "jerk=d.j - gains.K_p @ e_v", "jerk=d.j + gains.K_p @ e_v", "control", "jerk"
    ),
    "jerk: no j_d": Mutant("control.py", "jerk=d.j - gains", "jerk=-gains", "control", "jerk"),
    "omega_d: sign of its rate": Mutant(
        "control.py", "- to_body @ d.omega_dot", "+ to_body @ d.omega_dot", "control", "error_dynamics"
    ),
    "omega_d: sign of the feed-forward": Mutant(
        "control.py", "alpha=-turn - carried", "alpha=-turn + carried", "control", "error_dynamics"
    ),
    "Euler: sign of w x J w": Mutant(
        "balance.py", "apply(J, alpha) + so3.cross", "apply(J, alpha) - so3.cross", "control", "wrench_moves"
    ),
    # the agents
    "thrust direction without f_hat": Mutant(
        "control.py",
        "share.lam.sum(0) - f_hat.f_x, m *",
        "share.lam.sum(0), m *",
        "control",
        "attitude_law",
    ),
    "rate of lam not in the attitude": Mutant(
        "control.py", "m * to.jerk + share.lam_dot.sum(0)", "m * to.jerk", "control", "attitude_law"
    ),
    "f_hat_w not compensated": Mutant("control.py", "tau=Q[:3] - f_hat.f_w", "tau=Q[:3]", "control", "aligned"),
    "posture: half the damping": Mutant(
        "control.py", "* e - 2 * DAMPING * k * e_dot", "* e - DAMPING * k * e_dot", "control", "lean_moves"
    ),
    "contacts: sign of w x (w x c)": Mutant(
        "control.py", "(to.alpha[None], c) + so3.cross", "(to.alpha[None], c) - so3.cross", "control", "aligned"
    ),
    "rate of lam is zero": Mutant("fly.py", "load.mass * to.jerk", "load.mass * 0.0 * to.jerk", "fly", "feed_forward"),
    "lam_f0 inside lam_dot": Mutant(
        "fly.py",
        "offset=jnp.zeros_like(self.allocation.offset)",
        "offset=self.allocation.offset",
        "fly",
        "feed_forward",
    ),
    "integral action: sign": Mutant(
        "fly.py", "past + now.clock.dt * rate", "past - now.clock.dt * rate", "fly", "integral_action"
    ),
    "wrench observer explains the first tick": Mutant(
        "fly.py", "now.ticks * jnp.repeat(", "jnp.repeat(", "fly", "wrench_observer"
    ),
    "last sample left out": Mutant("learn.py", "(t <= self.end + 1e-9)", "(t < self.end - 1e-9)", "fly", "their_rate"),
    # estimation
    "agents' inputs past the labels' filter": Mutant(
        "estimate.py",
        "state=_pass(past.state, flat_agent(q), b_label, warm)",
        "state=settle(flat_agent(q))",
        "estimate",
        "inputs_of_the_learned",
    ),
    "payload's inputs past the labels' filter": Mutant(
        "estimate.py",
        "flat_payload(load, jnp.concatenate([felt, omega_dot])), b, memory.warm)",
        "flat_payload(load, jnp.concatenate([felt, omega_dot])), b, 0.0 * memory.warm)",
        "estimate",
        "inputs_of_the_learned",
    ),
    "joints: where their rate is of": Mutant(
        "estimate.py", "r = 2 * joint.inner - joint.outer", "r = joint.outer", "estimate", "joint_filter"
    ),
    "accelerometer: no gravity": Mutant(
        "estimate.py", "was.R @ felt + gravity", "was.R @ felt", "estimate", "past_readings or truth or constant_errors"
    ),
    "fusion without a dt^2 / 2": Mutant(
        "estimate.py", "was.v * dt + acceleration * (dt * dt / 2)", "was.v * dt", "estimate", "constant_rates"
    ),
    "label: sign of the momenta's drift": Mutant(
        "estimate.py", "momenta_dot - drift", "momenta_dot + drift", "estimate", "converge"
    ),
    "label: base carried by the joints left out": Mutant(
        "estimate.py", "felt + carried_dot)", "felt)", "estimate", "converge"
    ),
    "label: payload without the copy of the tips' bandwidth": Mutant(
        "estimate.py",
        "memory.known + from_the_first(memory.warm, blend(filters.tip_force, dt)) * (known - memory.known)",
        "1.0 * known",
        "estimate",
        "converge",
    ),
    "joint random_walk_density: filter's own delay left out": Mutant(
        "estimate.py", "* b / ((1 - b) * dt)", "* b / dt", "estimate", "ramp"
    ),
    "tip forces turned the wrong way": Mutant(
        "estimate.py", '"bij,bj->bi", g.rotation', '"bji,bj->bi", g.rotation', "estimate", "first_estimate"
    ),
    # learning
    "warm start dropped": Mutant(
        "learn.py", "start=before.hyper if before else None", "start=None", "learn", "second_fit"
    ),
    "last fits forgotten": Mutant("learn.py", "fits = {**last, **{", "fits = {**{", "learn", "second_fit"),
    "a full set takes more": Mutant(
        "gp/dataset.py", "kept = valid & (slot < len(data.X))", "kept = valid", "learn", "data_grow"
    ),
    "identification: prior counted twice": Mutant(
        "learn.py",
        "A, T) + np.eye(len(prior))",
        "A, T) + 2 * np.eye(len(prior))",
        "learn",
        "identification or excitation",
    ),
    "identification: less than nothing may be left": Mutant(
        "learn.py", "stays + goes / max(", "stays + goes / min(", "learn", "leaves_a_body"
    ),
    "identification: a field is taken for mass": Mutant(
        "place.py",
        "K = regressors(x[t >= change.since], payload=True)[:, :, :4], gp.grams(Z, change.model.hyper)",
        "K = regressors(x[t >= change.since], payload=True)[:, :, :4], 0.05 * np.tile(np.eye(len(Z)), (6, 1, 1))",
        "place",
        "goes_with_the_place",
    ),
    "innovation: a rate counts after silence": Mutant(
        "online_correction.py", "b = due * went_on * -jnp", "b = due * -jnp", "innovation", "before_labels_stopped"
    ),
    "features: speeds in the wrong order": Mutant(
        "learn.py",
        "v, omega = x[..., 3:6], x[..., 15:18]",
        "omega, v = x[..., 3:6], x[..., 15:18]",
        "learn",
        "features",
    ),
    "regressor: sign of the lever": Mutant(
        "learn.py", "-so3.hat(q.R.T @ a)", "so3.hat(q.R.T @ a)", "learn", "regressor"
    ),
    "innovation: a map is trusted whatever labels do": Mutant(
        "online_correction.py", "moved.products, moved.squares, v", "moved.squares, moved.squares, v", "innovation"
    ),
    "echo: joints are heard without delay": Mutant("echo.py", "(1 - _low(s, filters.joint) ** 2)", "1", "echo"),
    "echo: agents follow all of the rate": Mutant("fly.py", "jnp.multiply, c[:, None]", "jnp.multiply, 1.0", "echo"),
    "innovation: another oracle moves the mean": Mutant(
        "online_correction.py", "mean=plus(past.moved.mean)", "mean=past.moved.mean", "innovation"
    ),
    # certificates
    "tube: what is fed does not feed": Mutant(
        "certification/tube.py", 'direct[t] + np.einsum("isj,sj->i", M[t, :, :t], d[:t])', "direct[t]", "certify_tube"
    ),
    "tube: f~ on the path makes nothing of a run": Mutant(
        "certification/tube.py", "np.sqrt(greatest).sum(0)", "0", "certify_tube"
    ),
    "ellipsoid: labels may err once, not each": Mutant(
        "gp/ellipsoid.py", "feasible.eps**2 * w.sum(1)", "feasible.eps**2 * w.mean(1)", "gp_ellipsoid"
    ),
    "ellipsoid: around nothing": Mutant(
        "gp/ellipsoid.py", "@ self.a[..., None]", "@ (0 * self.a)[..., None]", "gp_ellipsoid"
    ),
    "reach: sign of the mean's shift below": Mutant(
        "certification/reachability.py",
        "[width + shift, width - shift]",
        "[width + shift, width + shift]",
        "certify_reach",
    ),
    "reach: greatest residual without the shift": Mutant(
        "certification/reachability.py",
        "return difference + body.beta",
        "return body.beta",
        "certify_reach certify_certificate",
    ),
    "variation: the sample itself has no weight": Mutant(
        "certification/linearized_trajectory.py",
        "L[t, :, k] = loop.D[k, rows]",
        "L[t, :, k] = 0 * loop.D[k, rows]",
        "certify_variation",
    ),
    "variation: an update's derivative on both its sides": Mutant(
        "certification/linearized_trajectory.py", "if active[k + 1] == active[k]", "if True", "certify_variation"
    ),
    "tube: the companion's mean has the slope of the compensated one": Mutant(
        "certification/tube.py", "np.abs((g[:, None] @ flat)[:, 0])", "0", "certify_tube"
    ),
    "recovery: multipliers that cost nothing": Mutant(
        "gp/optimal_recovery.py", "feasible.r @ nu + feasible.eps * size", "feasible.r @ nu", "gp_bounds certify_reach"
    ),
    "recovery: sign of what is compensated": Mutant(
        "certification/reachability.py", "l1_norm) - sign * centre", "l1_norm) + sign * centre", "certify_reach"
    ),
    "gain: no remainder of the trapezoidal rule": Mutant(
        "certification/peak_gain.py", "h**3 / 12 * curvature.sum()", "0 * curvature.sum()", "certify_translation"
    ),
    "certificate: half a round is called a whole one": Mutant(
        "certification/assumptions.py", "[] if full_period else [PERIODICITY]", "[]", "certify_assumed"
    ),
}


def run(name: str) -> dict[str, Any]:
    """Which test sees a mutant, if any."""
    mutant = MUTANTS[name]
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "colift"
        shutil.copytree(
            ROOT, copy, ignore=shutil.ignore_patterns(".*", "out", "build", "dist", "__pycache__", "_build")
        )
        path = copy / "src" / "colift" / mutant.file
        path.write_text(path.read_text().replace(mutant.now, mutant.then))
        modules = [f"tests/test_{module}.py" for module in mutant.tests.split()]
        for chosen in ([["-k", mutant.first]] if mutant.first else []) + [[]]:
            done = subprocess.run(
                [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", "", *modules, *chosen],
                cwd=copy,
                env=os.environ | {"PYTHONPATH": str(copy / "src")},
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode == 1:
                (by,) = re.findall(r"^(?:FAILED|ERROR) (\S+?)(?:\[.*)?(?: - .*)?$", done.stdout, re.MULTILINE)[:1]
                return {"lives": False, "seen_by": by}
            if done.returncode not in (0, 5):  # 5: no test has these words
                raise RuntimeError(f"{name}: the tests could not run:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return {"lives": True, "seen_by": None}


def main() -> bool:
    """Every mutant must be seen."""
    found = collect("mutants", MUTANTS, run)
    for name in MUTANTS:
        print(f"{name:<56} {'LIVES' if found[name]['lives'] else found[name]['seen_by']}")
    return not any(found[name]["lives"] for name in MUTANTS)


if __name__ == "__main__":
    main()
