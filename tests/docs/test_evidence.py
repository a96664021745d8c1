"""Tests of the stored results: recorded files and commits, and detection of outdated results."""

from __future__ import annotations

import ast
import json
import subprocess
from pathlib import Path

import pytest

import evidence
from evidence import ROOT, __main__, mutants

RESULTS = sorted((ROOT / "evidence" / "results").glob("*.json"))


def git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def history():
    """Skip the test if the checkout has no git history (unpacked archive, shallow clone)."""
    try:
        if git("rev-parse", "--is-shallow-repository").strip() == "true":
            pytest.skip("a shallow clone")
    except (subprocess.CalledProcessError, FileNotFoundError):
        pytest.skip("no repository")


def test_every_result_has_an_evidence_module():
    assert {path.stem for path in RESULTS} <= set(__main__.module_names())


@pytest.mark.parametrize("path", RESULTS, ids=[path.stem for path in RESULTS])
def test_result_files_match_the_recorded_commit(path, history):
    """The recorded commit exists, and the recorded digests are those of its files."""
    made = json.loads(path.read_text())
    git("merge-base", "--is-ancestor", made["commit"], "HEAD")
    listed = git("ls-tree", "-r", made["commit"], "--", *made["files"]).splitlines()
    assert {line.split("\t")[1]: line.split()[2] for line in listed} == made["files"]
    assert f"evidence/{path.stem}.py" in made["files"]


def test_dependencies_are_imports_and_scenarios():
    """An evidence module depends on its imports and the scenarios that it names, and on no other file."""
    files = evidence.files_behind(ROOT / "evidence" / "orderings.py")
    for name in ("closed_loop/flight.py", "codegen/__init__.py", "gp/fitting.py", "scenario/library/paper.yaml"):
        assert f"src/colift/{name}" in files
    for name in ("visualization/study_figures.py", "scenario/library/certified.yaml", "__main__.py"):
        assert f"src/colift/{name}" not in files
    assert "evidence/__init__.py" not in files
    assert all((ROOT / name).is_file() for name in files)


@pytest.fixture
def project(tmp_path, monkeypatch):
    """Project of one package and one evidence module, which depends on `a`; `a` depends on `b` and a header file."""
    for name, text in {
        "src/colift/__init__.py": "",
        "src/colift/a.py": "from colift import b\nHEADER = 'a.h'\n",
        "src/colift/a.h": "int x;",
        "src/colift/b.py": "def f():\n    import colift.c\n",
        "src/colift/c.py": "",
        "src/colift/scenarios/sample.yaml": "",
        "src/colift/scenarios/other.yaml": "",
        "evidence/__init__.py": "",
        "evidence/proof.py": "import numpy\nfrom colift.a import HEADER\nfrom evidence import save\nNAME = 'sample'\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(evidence, "ROOT", tmp_path)
    monkeypatch.setattr(evidence, "RESULTS", tmp_path / "evidence" / "results")
    monkeypatch.setattr(evidence.files_behind, "__defaults__", (tmp_path,))
    return tmp_path


def test_dependencies_include_indirect_imports(project):
    expected = ["evidence/proof.py", "src/colift/__init__.py", "src/colift/a.h", "src/colift/a.py", "src/colift/b.py"]
    assert list(evidence.files_behind(project / "evidence" / "proof.py")) == [
        *expected,
        "src/colift/scenarios/sample.yaml",
    ]


def test_items_are_reused_until_a_dependency_changes(project, capsys):
    computed: list[str] = []

    def compute(item: str) -> str:
        computed.append(item)
        return item.upper()

    assert evidence.collect("proof", ["a", "b"], compute) == {"a": "A", "b": "B"}
    assert evidence.collect("proof", ["a", "b", "c"], compute) == {"a": "A", "b": "B", "c": "C"}
    (project / "src/colift/c.py").write_text("another = 1")  # imported inside a function only
    assert evidence.changed_files("proof") == []
    evidence.collect("proof", ["a"], compute)
    assert computed == ["a", "b", "c"]
    (project / "src/colift/b.py").write_text("another = 1")
    assert evidence.changed_files("proof") == ["src/colift/b.py"]
    assert evidence.collect("proof", ["a"], compute) == {"a": "A"}
    assert computed == ["a", "b", "c", "a"]
    assert evidence.stored("proof")["commit"] is None  # no repository here


def test_uncommitted_files_are_refused(project):
    for words in (["init", "-q"], ["add", "src"]):
        subprocess.run(["git", *words], cwd=project, check=True)
    with pytest.raises(SystemExit, match=r"proof: .* commit .*evidence/proof\.py"):
        evidence.collect("proof", ["a"], str.upper)
    author = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    for words in (["add", "."], [*author, "commit", "-qm", "all"]):
        subprocess.run(["git", *words], cwd=project, check=True)
    evidence.collect("proof", ["a"], str.upper)
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=project, capture_output=True, text=True, check=True).stdout
    made = evidence.stored("proof")
    assert made["commit"] == head.strip()
    assert Path(made["command"].split()[0]).name == "dev"


def test_changed_comments_do_not_outdate_a_result(project):
    b = project / "src/colift/b.py"
    author = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    for words in (["init", "-q"], ["add", "."], [*author, "commit", "-qm", "all"]):
        subprocess.run(["git", *words], cwd=project, check=True)
    evidence.collect("proof", ["a"], str.upper)
    b.write_text('"""A module."""\n\n\ndef f():\n    """Of it."""\n    import colift.c  # why\n')
    assert evidence.changed_files("proof") == []
    b.write_text('def f():\n    """Of it."""\n    import colift.a\n')
    assert evidence.changed_files("proof") == ["src/colift/b.py"]
    b.write_text("def f():\n    import colift.c\n")
    (project / "src/colift/a.h").write_text("int x; // the same, but no Python")
    assert evidence.changed_files("proof") == ["src/colift/a.h"]


def test_digest_equals_git_hash(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"what is up, doc?")  # the example of Pro Git, section 10.2
    assert evidence._digest(path) == "bd9dbf5aae1a3862dd1526723246b20206e5fc37"


def test_status_lists_outdated_results_and_changed_files(project, capsys, monkeypatch):
    monkeypatch.setattr(evidence, "__path__", [str(project / "evidence")])
    __main__.main(["status"])
    assert "proof        no result yet" in capsys.readouterr().out
    evidence.collect("proof", ["a"], str.upper)
    __main__.main(["status"])
    assert "nothing changed since" in capsys.readouterr().out
    (project / "src/colift/b.py").write_text("another = 1")
    __main__.main(["status"])
    assert "since then changed: src/colift/b.py" in capsys.readouterr().out


@pytest.mark.parametrize("name", mutants.MUTANTS)
def test_mutant_expressions_are_unique_and_tests_exist(name):
    mutant = mutants.MUTANTS[name]
    text = (ROOT / "src" / "colift" / mutant.file).read_text()
    assert text.count(mutant.original) == 1
    assert mutant.replacement != mutant.original
    ast.parse(text.replace(mutant.original, mutant.replacement))
    for module in mutant.test_modules.split():
        assert (ROOT / "tests" / f"{module}.py").is_file()
    tests = "".join((ROOT / "tests" / f"{module}.py").read_text() for module in mutant.test_modules.split())
    assert all(f"def {prefix}" in tests for prefix in mutant.keyword.split(" or ") if prefix)
