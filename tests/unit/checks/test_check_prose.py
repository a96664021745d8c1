"""Tests of the rules on words, sentences and docstrings."""

import pytest

from checks.prose import numbers, sentences, words

LONG = "Word " + " ".join(["word"] * 40) + "."


def test_docstring_comment_and_help(run):
    """Words are reported in docstrings, comments and help strings, with their lines."""
    source = '"""Module.\n\nThe filter hears labels.\n"""\n\n# it remembers\nx = f(help="the twin")  # the pilot\n'
    problems = run("banned-words", {"src/a.py": source})
    found = {(problem.line, problem.message.split("'")[1]) for problem in problems}
    assert found == {(3, "hears"), (6, "remembers"), (7, "twin"), (7, "pilot")}


def test_code_in_docstrings_is_not_read(run):
    """Inline code and examples are no prose."""
    source = '"""Summary with `oracle` and ``twin``.\n\n>>> school()\npilot\n"""\ntold = "he said"\n'
    assert not run("banned-words", {"src/a.py": source})


@pytest.mark.parametrize("entry", ["", " oracle", " banned-words"])
def test_exception_in_python(run, entry):
    """The exception stands behind the closing quotes."""
    source = f'"""The residual model.\n\nThe paper calls it an oracle.\n"""  # checks: allow{entry}\n'
    assert not run("banned-words", {"src/a.py": source})


def test_words_in_pages(run):
    """Headings, tables and paragraphs are read; a phrase may include a line break."""
    page = "# The echo\n\n| a |\n|---|\n| knows |\n\nThe value is compared by\nhand here.\n"
    problems = run("banned-words", {"docs/deep/a.md": page})
    assert [problem.line for problem in problems] == [1, 5, 7]
    assert "'by hand' in a paragraph; write the command" in problems[2].message


def test_words_in_tests(run):
    """Docstrings and comments of tests are read like those of the package."""
    (problem,) = run("banned-words", {"tests/test_a.py": 'def test_a():\n    """The filter hears labels."""\n'})
    assert (problem.line, "'hears' in a docstring" in problem.message) == (2, True)


def test_words_in_yaml(run):
    """Comments and descriptions of scenario files are read, values and other keys are not."""
    text = "# The pilot.\nname: oracle\ndescription: Sensors that nobody told.\nmass: 1  # as the twin\n"
    problems = run("banned-words", {"src/library/a.yaml": text, "docs/a.yaml": text})
    found = [(problem.path, problem.line, problem.message.split("'")[1]) for problem in problems]
    path = "src/library/a.yaml"
    assert found == [(path, 1, "pilot"), (path, 3, "told"), (path, 3, "nobody"), (path, 4, "twin")]


def test_code_and_targets_in_pages_are_not_read(run):
    """Code blocks, inline code, mathematics, link targets and comments are no prose."""
    page = (
        "Text `oracle` and $told$ and [link](decisions/an-oracle.md).\n\n```sh\necho told\n```\n\n"
        "    ros2 topic echo\n\n"
        "$$\nx_{told}\n$$\n\n<!-- the twin\n\nof a pilot -->\n\n(oracle)=\n\n```{toctree}\noracle\n```\n"
    )
    assert not run("banned-words", {"README.md": page})


def test_exception_in_pages(run):
    """An exception applies to the lines around it up to a blank line."""
    page = "The paper writes oracle. <!-- checks: allow oracle -->\n\nAn oracle.\n"
    (problem,) = run("banned-words", {"docs/a.md": page})
    assert problem.line == 3


def test_standard_prose_is_accepted(run):
    """Standard words that resemble banned ones are accepted."""
    page = (
        "A known mass. The forgetting factor. See also the trust region. Unseen data. It is as specified. "
        "The initial guess is silently ignored. Users who know Python can look up the table. The map is frozen."
    )
    assert not run("banned-words", {"docs/a.md": page})


def test_long_sentence(run):
    """A sentence over the limit is reported at its first line."""
    (problem,) = run("sentence-length", {"docs/a.md": f"Short one.\nAnother ends here. {LONG}\n"})
    assert problem.line == 2
    assert "41 words (limit 40)" in problem.message


@pytest.mark.parametrize(
    "page",
    [
        f"# {LONG}\n",
        f"| a | b |\n|---|---|\n| x | {LONG} |\n",
        f"```\n{LONG}\n```\n",
        f"$$\n{LONG}\n$$\n",
        f"## References\n\n- {LONG}\n",
        f"[^1]: {LONG}\n",
        "One " * 30 + "`code with " + "many " * 20 + "words`.\n",
        "- " + "item " * 30 + "\n- " + "item " * 30 + "\n",
        f"---\ntitle: {LONG}\n---\n",
        f"<!-- checks: allow sentence-length -->\n{LONG}\n",
    ],
)
def test_text_without_sentence_limit(run, page):
    """Headings, tables, code, mathematics, references and front matter have no limit; list items are separate."""
    assert not run("sentence-length", {"docs/a.md": page})


def test_admonitions_and_quotes_are_read(run):
    """Text of admonitions and quotations is prose."""
    page = f"```{{note}}\n{LONG}\n```\n\n:::{{admonition}} Title\n{LONG}\n:::\n\n> {LONG}\n"
    assert len(run("sentence-length", {"docs/a.md": page})) == 3


def test_section_after_references_is_read(run):
    """A heading of the same level ends the references."""
    assert run("sentence-length", {"docs/a.md": f"## References\n\n- A.\n\n## Use\n\n{LONG}\n"})


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("One. Two! Three? Four", 4),
        ("See e.g. Smith et al. 2010 and Eq. 3. Next.", 2),
        ("J. Smith wrote it.", 1),
        ("The step is 0.5 s. 3 agents follow.", 2),
        ("It ends (here). `Code` begins.", 2),
        ("", 0),
    ],
)
def test_sentences(text, count):
    """Sentences end at punctuation, not at abbreviations, initials or decimal points."""
    assert len(list(sentences(text))) == count


def test_words_have_a_letter_or_digit():
    """Dashes and signs are no words."""
    assert words("a - b | 3 %") == ["a", "b", "3"]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("C3 on PX4 with ROS 2 and CF-1.11", []),
        ("0.6 %, 1.8 mm", ["0.6", "1.8"]),
        ("version 0.2.0 of 2025-01-31", ["0.2.0", "2025-01-31"]),
        ("3-5 agents in 3D", ["3", "5"]),
        ("1e-11", ["1"]),
    ],
)
def test_numbers(text, found):
    """Numerals count once; digits of names do not count."""
    assert numbers(text) == found


@pytest.mark.parametrize("first", ["What", "Which", "Whether", "Of", "As", "How", "Where", "When", "That", "Until"])
def test_docstring_opening(run, first):
    """Docstrings of functions and attributes must not begin with these words."""
    source = (
        f'def f():\n    """{first} is done."""\n\n\nclass A:\n    """Value."""\n\n    x: int\n    """{first} x is."""\n'
    )
    assert [problem.line for problem in run("docstring-openings", {"src/a.py": source})] == [2, 9]


def test_good_docstring_opening(run):
    """Verbs and noun phrases are accepted, also where they begin with the same letters."""
    source = '"""Offset of the model."""\n\n\ndef f():\n    """Assemble the matrix."""\n'
    assert not run("docstring-openings", {"src/a.py": source, "tests/a.py": '"""What is tested."""\n'})
