"""Cases C1, C2, C3, their extensions and baselines."""

PAPER_CASES = {
    "C1": "no learning",
    "C2": "payload learning",
    "C3": "payload and agent learning",
}
EXTENSIONS = {"adaptive": "C3 with online model updates and feedback correction from labels"}
"""Cases beyond those of the paper, with their descriptions."""
BASELINES = {
    "integral": "C1 with integral action",
    "disturbance_observer": "C1 with a disturbance observer on the payload",
    "parametric": "parametric identification of the payload only",
    "true_residual": "true residuals at estimated states",
    "label_feedback": "feedback of filtered labels, no model",
    "regression": "ridge regression on stated basis functions",
    "gp_label_feedback": "C3 with feedback of filtered labels",
}
ALL_CASES = PAPER_CASES | EXTENSIONS | BASELINES
AGENT_LEARNING_CASES = ("C3", "regression", "gp_label_feedback", "adaptive")
LEARNING_CASES = ("C2", "parametric", *AGENT_LEARNING_CASES)


def case_id(name: str) -> str:
    """Return the identifier of a case, whatever the capitalization of its name.

    Args:
        name: Identifier of a case, such as ``C3`` or ``adaptive``, in any capitalization.

    Returns:
        The identifier as in `ALL_CASES`.

    Raises:
        KeyError: If there is no such case.
    """
    for case in ALL_CASES:
        if case.lower() == name.strip().lower():
            return case
    raise KeyError(f"case {name!r}: must be one of {', '.join(ALL_CASES)}")
