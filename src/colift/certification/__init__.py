"""Computed ultimate bounds of the tracking errors: Theorem 1 and Corollary 1 of the paper.

Modules:
    certificate: A posteriori bounds of a simulated run, and the certificate.
    a_priori: Bounds of all runs that norm, labels and noise allow.
    nominal_run: Nominal trajectory of a run, supported parts and the time window of ultimate errors.
    body_models: Residual models and error bounds of all bodies along a path.
    conservatism: Decomposition of the conservatism of a bound into causes.
    linearized_trajectory: Closed loop linearized along the nominal trajectory.
    reachability: Bounds of the errors as linear functionals of the residual.
    tube: Deviation of the residual between a run and the nominal trajectory.
    agent_iss: Constants of Assumption 5.
    peak_gain, translation_bound, attitude_bound: Ultimate bounds from the size of a disturbance.
    assumptions: Names of the assumptions that a result does not show.
    adversary: Worst-case residuals.

See Also:
    docs/certificate.md: Theorem, proofs and assumptions.
"""
