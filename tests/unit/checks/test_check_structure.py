"""Tests of the rules on sizes and paths, and of the command line."""

import subprocess
import sys
from pathlib import Path

import pytest

from checks.__main__ import main
from checks.rules import RULES

ROOT = Path(__file__).parents[3]


def test_module_size_counts_code_only(run):
    """Blank lines, comments and docstrings do not count."""
    padding = '"""Module.\n\nText.\n"""\n\n# comment\n\n'
    assert not run("code-size", {"src/a.py": padding + "x = 1\n\n" * 400})
    (problem,) = run("code-size", {"src/b.py": padding + "x = (\n    1\n)\n" * 134})
    assert "402 code lines (limit 400)" in problem.message


def test_function_size(run):
    """The signature counts; the docstring does not."""
    body = '    """Docstring.\n\n    Text.\n    """\n' + "    x = '''a\n\nb'''\n" * 19
    assert not run("code-size", {"src/a.py": f"def f(\n    a,\n):\n{body}"})
    (problem,) = run("code-size", {"src/a.py": f"class A:\n    pass\n\n\ndef f(\n    a,\n    b,\n):\n{body}"})
    assert (problem.line, "61 code lines" in problem.message) == (5, True)


def test_package_entries(run):
    """Folders of data count; `__init__.py`, `__main__.py` and `py.typed` do not."""
    files = {f"src/colift/part{i}/a.py": "" for i in range(16)}
    files |= {f"src/colift/{name}": "" for name in ("__init__.py", "__main__.py", "py.typed", "data/a.yaml")}
    assert not run("package-entries", files)
    (problem,) = run("package-entries", {"src/colift/extra.py": ""})
    assert "18 entries" in problem.message


def test_readme_limits(run):
    """Words and numbers are counted in tables and outside code."""
    table = "| case | value |\n|---|---|\n" + "".join(f"| C3 | 1.{i} |\n" for i in range(25))
    code = "```\n" + "1 2 3 " * 300 + "\n```\n"
    assert not run("page-limits", {"README.md": f"{table}\n{code}"})
    (problem,) = run("page-limits", {"README.md": f"{table}\n{code}\n7 agents\n"})
    assert problem.message.startswith("26 numbers outside code (limit 25)")
    (problem,) = run("page-limits", {"README.md": "word " * 651})
    assert "651 words (limit 650)" in problem.message


def test_a_test_module_without_tests_is_reported(run):
    """Helper modules need no test."""
    files = {"tests/unit/test_a.py": "def test_one():\n    pass\n", "tests/support/helper.py": ""}
    assert not run("empty-test-modules", files)
    (problem,) = run("empty-test-modules", {"tests/unit/test_b.py": "import numpy\n"})
    assert (problem.path, problem.line) == ("tests/unit/test_b.py", 1)


def test_learning_limit(run):
    """The page on learning has a limit of words, not of numbers."""
    assert not run("page-limits", {"docs/learning.md": "1 " * 2500})
    assert run("page-limits", {"docs/learning.md": "1 " * 2501})


@pytest.mark.parametrize(
    ("start", "entry", "more"),
    [
        ("| term | definition |\n|---|---|\n", "| t{} | d |\n", 0),
        ("# Glossary\n\n", "### t{}\n\nText.\n\n", 0),
        ("# Glossary\n\n", "t{}\n: Definition.\n\n", 0),
        ("```{{glossary}}\n", "t{}\n  Definition.\n\n", 1),
    ],
)
def test_glossary_terms(run, start, entry, more):
    """Tables, headings, definition lists and directives are counted alike."""
    start = start.replace("{{", "{").replace("}}", "}")
    end = "```\n" if more else ""
    for count in (60, 61):
        page = start + "".join(entry.format(i) for i in range(count)) + end
        problems = run("page-limits", {"docs/glossary.md": page})
        assert [problem.message.split()[0] for problem in problems] == ["61"] * (count - 60)


def test_decision_records(run):
    """The index page is no record."""
    files = {f"docs/decisions/{i:04}-title.md": "" for i in range(40)} | {"docs/decisions/index.md": ""}
    assert not run("page-limits", files)
    assert run("page-limits", {"docs/decisions/0041-title.md": ""})


def test_test_names(run):
    """Names of tests are limited in functions and methods of tests/."""
    name = "test_" + "a" * 56
    source = f"class TestA:\n    def {name}(self): ...\n\n\ndef {name[:-1]}(): ...\n"
    (problem,) = run("long-test-names", {"tests/unit/test_a.py": source, "src/a.py": source})
    assert (problem.path, problem.line) == ("tests/unit/test_a.py", 2)


FOLDER = "work"


@pytest.mark.parametrize("path", ["/tmp/out", f"/{FOLDER}/x/dev"])
def test_workplace_paths(run, path):
    """Absolute paths of a machine are reported in code and pages, not in tests."""
    files = {"docs/a.md": f"See `{path}`.\n", "dev": f"cd {path}\n", "tests/a.py": f"p = '{path}'\n"}
    assert [problem.path for problem in run("workplace-paths", files)] == ["dev", "docs/a.md"]


def test_other_paths_are_accepted(run):
    """Relative paths, addresses and names of temporary files in recorded output are accepted."""
    text = (
        f"src/{FOLDER}/a.py ./tmp/a https://example.org/{FOLDER}/a $HOME/{FOLDER}/a /tmp/tmpab12cd_4/out shared/data\n"
    )
    assert not run("workplace-paths", {"docs/a.md": text})


def test_list(capsys):
    """The list has every rule with its summary."""
    assert main(["--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == [rule.name for rule in RULES]


def test_exit_codes_and_output(tmp_path, capsys):
    """Problems are printed with file, line and rule; the exit code is 1."""
    (tmp_path / "src").mkdir()
    (tmp_path / "src/a.py").write_text("oracle = 1\n")
    assert main(["--root", str(tmp_path)]) == 1
    assert capsys.readouterr().out.startswith("src/a.py:1: banned-names: constant 'oracle' is not a term of the field")
    assert main(["--root", str(tmp_path), "--only", "code-size"]) == 0
    assert main(["--root", str(tmp_path), "--summary"]) == 1
    assert "banned-names              1\n" in capsys.readouterr().out


def test_invalid_python_is_named(tmp_path, capsys):
    """A file that cannot be parsed gives exit code 2."""
    (tmp_path / "src").mkdir()
    (tmp_path / "src/a.py").write_text("def\n")
    assert main(["--root", str(tmp_path)]) == 2
    assert "src/a.py" in capsys.readouterr().err


def test_unknown_rule_is_refused():
    """An unknown rule is a usage error; the module runs without dependencies."""
    command = [sys.executable, "-S", "-m", "checks", "--only", "unknown"]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "banned-names" in result.stderr
