"""Tests of the sentences that state the result of a study."""

from __future__ import annotations

import pytest

from colift.analysis import conclusions
from tests.support.summaries import metrics

FAILED = metrics(complete=False, termination_reason="beyond limits", e_p_rms_m=9.0)


@pytest.mark.parametrize(
    ("cases", "warnings", "sentences"),
    [
        (
            {"C1": metrics(e_p_rms_m=0.3366), "C2": metrics(e_p_rms_m=0.1463), "C3": FAILED},
            [(True, "C3"), (False, "slow")],
            [
                "C1 and C2 completed the flight; C3 ended early.",
                "The RMS position error in the second half is 337 mm in C1 and 146 mm in C2 (0.43 of C1).",
                "There are 2 warnings; 1 of them invalidates a result.",
            ],
        ),
        ({"C3": FAILED}, [(True, "C3")], ["C3 ended early.", "There is 1 warning; it invalidates a result."]),
        (
            {"integral": metrics(e_p_rms_m=0.01), "parametric": metrics(e_p_rms_m=None)},
            [],
            [
                "integral and parametric completed the flight.",
                "The RMS position error in the second half is 10 mm in integral.",
                "There are no warnings.",
            ],
        ),
    ],
)
def test_conclusion_of_a_study(cases, warnings, sentences):
    assert conclusions.conclude_study({"cases": cases}, warnings) == sentences


def test_ratios_have_two_digits():
    ratios = [conclusions.format_ratio(value, 1e-3) for value in (1e-3, 2.2e-4, 1.9e-5, 0.5, None)]
    assert ratios == ["1.00", "0.22", "0.019", "500", "none"]
    assert conclusions.format_ratio(1.0, 0.0) == conclusions.format_ratio(1.0, None) == "none"


def test_assumptions_are_listed_with_capitals():
    """Abbreviations of stored names are printed in capital letters."""
    assert conclusions.list_assumptions(["rkhs norm", "first order"]) == "RKHS norm, first order"
    assert conclusions.list_assumptions([]) == ""
