"""Tests of the rules on identifiers and their word list."""

import pytest

from checks.word_lists import banned_names, name_words

MODULE = """
class Controller:
    model: int
    {field}: float = 0.0

    def update(self, state, {parameter}):
        hidden = 1


def {function}(team, _private):
    def twin():
        pass


{constant} = 3
"""

ACCEPTED = {"field": "gain", "parameter": "bias", "function": "mean_at_start", "constant": "MAX_STEP"}


def module(**names):
    return MODULE.format(**{**ACCEPTED, **names})


def test_accepted_names_pass(run):
    """Local names, private names and words of the field are accepted."""
    assert not run("banned-names", {"src/colift/world.py": module()})


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("field", "listener"),
        ("field", "heeded"),
        ("parameter", "oracle"),
        ("parameter", "plan"),
        ("function", "echo_gain"),
        ("constant", "OracleType"),
        ("constant", "PATIENCE"),
    ],
)
def test_banned_name_is_reported(run, kind, name):
    """Each kind of identifier is covered; the message has kind, name and replacement."""
    (problem,) = run("banned-names", {"src/colift/world.py": module(**{kind: name})})
    assert f"{kind} '{name}'" in problem.message
    assert "use '" in problem.message


def test_line_of_the_definition_is_reported(run):
    """The reported line is the line of the definition."""
    (problem,) = run("banned-names", {"src/colift/a.py": "x = 1\n\n\ndef school():\n    pass\n"})
    assert str(problem).startswith("src/colift/a.py:4: banned-names: function 'school'")


def test_module_and_package_names(run):
    """Names of modules and packages are identifiers; a package is reported once."""
    files = {"src/colift/school/__init__.py": "", "src/colift/school/a.py": "", "src/colift/echo.py": ""}
    problems = run("banned-names", files)
    assert sorted(problem.path for problem in problems) == ["src/colift/echo.py", "src/colift/school/__init__.py"]


def test_attributes_set_in_init_are_fields(run):
    """Public attributes that `__init__` assigns are fields."""
    source = "class A:\n    def __init__(self):\n        self.pilot = 1\n        self._twin = 2\n"
    (problem,) = run("banned-names", {"src/a.py": source})
    assert "field 'pilot' of A" in problem.message


def test_names_outside_src_are_not_read(run):
    """Only src/ is checked."""
    assert not run("banned-names", {"tests/a.py": "oracle = 1\n", "examples/a.py": "def twin(): ...\n"})


@pytest.mark.parametrize("comment", ["# checks: allow", "# checks: allow oracle", "# checks: allow banned-names"])
def test_exception_comment(run, comment):
    """A comment on the line allows the name."""
    assert not run("banned-names", {"src/a.py": f"oracle = 1  {comment}\n"})
    assert not run("banned-names", {"src/b.py": f"{comment}\noracle = 1\n"})


def test_exception_of_another_word_has_no_effect(run):
    """A comment for another word does not allow the name."""
    assert run("banned-names", {"src/a.py": "oracle = 1  # checks: allow twin\n"})


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("ResidualModel", "residual model"),
        ("HTTPPort2", "http port 2"),
        ("min_J_L", "min j l"),
        ("MAX_STEP", "max step"),
    ],
)
def test_words_of_an_identifier(name, words):
    """Identifiers are split at underscores and changes of case."""
    assert name_words(name) == frozenset(words.split())


STANDARD_NAMES = """
    acceleration_cmd actuator_lag attitude_setpoints bias_random_walk bound_assumptions change_points check_supported
    context controller decay_rate correction disturbance_forces experiment gain_margin known_mass label_filter
    lead_time lookahead loop_gain mean_function memory_bytes nominal_trajectory observation payload plan_path
    predict preview residual_model region_of_attraction sampled_at set_point start_tick state step trust_region update
    world
""".split()


@pytest.mark.parametrize("kind", ["module", "function", "field", "parameter"])
def test_standard_terms_are_accepted(kind):
    """No entry covers terms of the field."""
    covered = [name for name in STANDARD_NAMES for entry in banned_names() if entry.matches(kind, name)]
    assert not covered


def test_entries_are_unique():
    """No entry occurs twice."""
    entries = [(entry.word, entry.whole, entry.kinds) for entry in banned_names()]
    assert len(entries) == len(set(entries))
