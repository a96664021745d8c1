"""Tests of stamping results after one item is computed again."""

from __future__ import annotations

import functools
import json
import re

import pytest

import evidence
from evidence import restamp, update_ablation


def stored(x: float, **more: object) -> dict:
    """An item as stored under a former name of its case."""
    return {"C4": {"e_p_rms_m": x, "wall_time_s": 3.0, "stopped": ""}, "n": [1, 2]} | more


def test_equal_item_stamps_the_result(store, change):
    """The stamp has the present files and commit, items have present names, and the computation keeps its date and
    commit.
    """
    store({"1": stored(2 / 3), "2": stored(5.0)})
    computed_at = evidence.head()
    change()
    assert evidence.changed_files("proof") == ["benchmarks/model.py"]
    holds, line = restamp.restamp("proof")
    assert holds
    assert line.startswith("stamped: item '1' is equal, replayed in ")
    made = evidence._record("proof")
    assert made["computed"] == {"commit": computed_at, "date": "2026-01-02"}
    assert made["commit"] == evidence.head() != computed_at
    assert made["replayed"]["item"] == "1"
    assert list(made["items"]["2"]) == ["adaptive", "n"]
    assert made["items"]["1"]["adaptive"]["wall_time_s"] == 3.0
    assert evidence.changed_files("proof") == []
    assert restamp.restamp("proof") == (True, "nothing changed since")


def test_different_item_leaves_the_result_stale(store, change):
    """The first difference is printed and recorded; the same code is computed again only on request."""
    store({"1": stored(0.5)})
    before = evidence._record("proof")
    change()
    holds, line = restamp.restamp("proof")
    assert not holds
    assert "adaptive.e_p_rms_m: stored 0.5, computed 0.6666666666666666" in line
    after = evidence._record("proof")
    assert {key: after[key] for key in before} == before
    assert after["replayed"]["difference"] == ["adaptive.e_p_rms_m", 0.5, 2 / 3]
    assert "as replayed on" in restamp.restamp("proof")[1]
    assert "differs in 1 values" in restamp.restamp("proof", again=True)[1]
    assert restamp.restamp("proof", again=True, within=0.5)[0]
    assert evidence._record("proof")["replayed"]["relative_difference"] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("item", "limit_s", "why"),
    [
        ("slow", 6.0, "takes longer than 6 s"),
        ("broken", 60.0, "ends with status 1: ValueError: not computable"),
        ("3", 60.0, "no item '3' is stored"),
        ("other", 60.0, "proof has no item 'other'"),
    ],
)
def test_failed_replay_leaves_the_result_unchanged(store, change, item, limit_s, why):
    """The result file is unchanged."""
    store({name: stored(1.0) for name in ("1", "slow", "broken", "other")})
    change()
    before = evidence._record("proof")
    holds, line = restamp.restamp("proof", item, limit_s)
    assert not holds
    assert "not changed" in line
    assert why in line
    assert evidence._record("proof") == before


def test_uncommitted_code_is_not_stamped(project, store):
    """A stamp names a commit from which the result can be repeated."""
    store({"1": stored(2 / 3)})
    (project / "benchmarks" / "model.py").write_text("def scale(x):\n    return x * 2.0 / 3\n")
    assert restamp.restamp("proof") == (False, "not changed: not committed: benchmarks/model.py")


@pytest.mark.parametrize(
    ("old", "new", "keys"),
    [
        ({"a": 1.0, "cpu_time_s": 1}, {"a": 1, "cpu_time_s": 2}, []),
        ({"a": 0.1}, {"a": 0.1 + 1e-18}, []),
        ({"a": 0.1}, {"a": 0.1 + 2e-17}, ["a"]),
        ({"a": {"b": [1, 2]}}, {"a": {"b": [1, 3]}}, ["a.b[1]"]),
        ({"a": [1]}, {"a": [1, 2]}, ["a"]),
        ({"a": True}, {"a": 1}, ["a"]),
        ({"a": None}, {"b": None}, ["a", "b"]),
        ({"termination_reason": "thrust at its limit"}, {"termination_reason": "saturated"}, []),
        ({"termination_reason": ""}, {"termination_reason": "saturated"}, ["termination_reason"]),
        (0.5, 0.25, ["value"]),
    ],
)
def test_differences_of_items(old, new, keys):
    """Times, versions and message texts do not count; everything else does."""
    assert [one.key for one in restamp.differences(old, new)] == keys


def test_command_states_each_result_in_one_line(project, store, capsys):
    """The status is 1 if a result stays outdated, 2 for an unknown name."""
    store({"1": stored(2 / 3)})
    assert restamp.main([], ["proof", "layered"]) == 1
    output = capsys.readouterr().out.splitlines()
    assert [line.split(maxsplit=1) for line in output] == [["proof", "nothing changed since"], ["layered", "no result"]]
    assert restamp.main(["proof"], ["proof"]) == 0
    for wrong in (["another"], ["--item", "1"]):
        with pytest.raises(SystemExit):
            restamp.main(wrong, ["proof"])


def test_renamed_keys_of_one_result(project):
    """Words apply to every key, and additional tables to their result only."""
    own = {"keys": {"left": "violations"}, "phrases": {"late update": "late_update"}}
    table = {"words": {"F": "feedback"}, "values": {"x": "y"}, "results": {"proof": own}}
    (project / "evidence" / "renamed.json").write_text(json.dumps(table))
    stored = {"late update: F: 0": {"left": ["x", 1], "F_x": None}}
    assert evidence.renamed(stored, "proof") == {"late_update: feedback: 0": {"violations": ["y", 1], "F_x": None}}
    assert evidence.renamed(stored, "other") == {"late update: feedback: 0": {"left": ["y", 1], "F_x": None}}


RESULTS = sorted(path.stem for path in evidence.RESULTS.glob("*.json"))
COMPOSED = {  # keys that the code composes from parts
    *(f"sigma_{body}_moment_mean_Nm" for body in "LA"),
    *(f"e_p_rms_{span}_m" for span in update_ablation.SPANS),
}


@functools.cache
def words_of_code() -> set[str]:
    """Return all words in the code of the package and of the test support."""
    files = [path for path in (evidence.ROOT / "src").rglob("*") if path.suffix in (".py", ".c")]
    files += (evidence.ROOT / "tests" / "support").glob("*.py")
    return set(re.findall(r"\w+", "".join(path.read_text() for path in files)))


@pytest.mark.parametrize("name", RESULTS)
def test_stored_keys_are_those_of_the_code(name):
    """Each key of a stored result, under its present name, occurs in the code that computes the result."""
    items = evidence.stored(name)["items"]
    assert evidence.renamed(items, name) == items
    modules = (name, "engines", "contact_forces", "limits", "react")  # with functions that others use
    text = "".join((evidence.ROOT / "evidence" / f"{one}.py").read_text() for one in modules)
    keys = {key for item in items.values() for key in nested_keys(item) if re.fullmatch(r"[A-Za-z]\w+", key)}
    assert keys <= words_of_code() | set(re.findall(r"\w+", text)) | COMPOSED


def nested_keys(value: object) -> set[str]:
    """Return the keys of nested data."""
    if isinstance(value, dict):
        return {*value, *(key for one in value.values() for key in nested_keys(one))}
    return {key for one in value for key in nested_keys(one)} if isinstance(value, list) else set()
