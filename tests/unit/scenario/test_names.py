"""Legal names for names of other formats."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colift.scenario import names
from colift.scenario.schema.base import NAME


@given(st.one_of(st.text(min_size=1, max_size=12), st.text("-_/2fbase", min_size=1, max_size=9)))
def test_legal_names_are_legal_and_reversible(original: str) -> None:
    try:
        legal = names.legal_name(original)
    except ValueError as error:
        assert len(original) > 9
        assert "more than 100 characters" in str(error)
        return
    assert re.fullmatch(NAME, legal)
    assert legal not in names.RESERVED
    assert names.original_name(legal) == original


@pytest.mark.parametrize("name", ["elbow", "_left", "a-b", "joint_1", "A-x-B"])
def test_legal_names_are_unchanged(name: str) -> None:
    assert names.legal_name(name) == name


def test_names_are_found_in_both_forms() -> None:
    known = ["drone/arm", "elbow", ""]
    assert names.find_name("drone/arm", known) == names.find_name("drone-2f-arm", known) == "drone/arm"
    assert names.find_name("arm", known) is None
    with pytest.raises(ValueError, match="must not be empty"):
        names.legal_name("")
