"""Files that a result depends on."""

from __future__ import annotations

import evidence
from evidence import dependencies


def test_closure_follows_packages_lazy_names_and_locks(project):
    """Relative imports, imports in `try`, names served lazily, scenarios by name and locks by imported package."""
    files = evidence.files_behind(project / "evidence" / "layered.py")
    package = ("", "models/", "onboard/", "math/")
    modules = ("models/gains", "onboard/law", "onboard/parts", "math/so3", "math/fast")
    assert set(files) == {
        "evidence/layered.py",
        *(f"src/colift/{name}__init__.py" for name in package),
        *(f"src/colift/{name}.py" for name in modules),
        "src/colift/scenario/library/sample.yaml",
        "requirements/run.txt",
        "requirements/test.txt",
    }


def test_result_is_stale_when_a_pin_changes(project, store):
    """Another hash or comment of a lock file changes nothing; another version does."""
    store({})
    lock = project / "requirements" / "run.txt"
    lock.write_text("# a comment\nnumpy==2.0 --hash=sha256:2\n")
    assert evidence.changed_files("proof") == []
    lock.write_text("numpy==2.1\n")
    assert evidence.changed_files("proof") == ["requirements/run.txt"]


def test_results_without_locks_use_those_of_their_commit(project, store):
    """A result without recorded locks is compared with the lock files of its commit."""
    store({})
    made = evidence._record("proof")
    made["files"] = {path: of for path, of in made["files"].items() if not path.startswith("requirements")}
    evidence.save(evidence.RESULTS / "proof.json", made)
    assert evidence.changed_files("proof") == []
    (project / "requirements" / "run.txt").write_text("numpy==2.1\n")
    assert evidence.changed_files("proof") == ["requirements/run.txt"]


def test_pins_of_a_lock():
    """Names are normalized; markers belong to the version."""
    text = "A_b==1.0 \\\n    --hash=sha256:1\nc[d]==2 ; python_version < '4' \\\n# e==3\n"
    assert dependencies.pins(text) == {"a-b": "1.0", "c": "2 ; python_version < '4'"}


def test_meaning_ignores_comments_and_layout():
    """Docstrings, comments and line breaks do not count; code does."""
    one = 'def f(x):\n    """Say."""\n    return x + 1\n'
    assert dependencies.meaning(one, ".py") == dependencies.meaning("def f(x):  # why\n\n    return x+1", ".py")
    assert dependencies.meaning(one, ".py") != dependencies.meaning("def f(x):\n    return x + 2\n", ".py")
    assert dependencies.meaning("def f():\n    'a'\n", ".py") == dependencies.meaning("def f():\n    pass\n", ".py")
