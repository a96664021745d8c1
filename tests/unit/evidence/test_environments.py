"""The environments of the evidence, the package's statement of supported versions, and the workflow."""

from __future__ import annotations

import re
import tomllib

import pytest
from ruamel.yaml import YAML

from evidence import ROOT, environments

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_each_supported_python_has_two_environments():
    classifiers = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    assert list(environments.PYTHONS) == classifiers
    assert PROJECT["requires-python"] == f">={classifiers[0]}"
    expected = {f"{python} {which}" for python in classifiers for which in ("oldest", "newest")}
    assert set(environments.environments()) == expected
    assert len(environments.environments()) == len(expected)


def test_no_dependency_has_an_upper_bound():
    assert [one for one in PROJECT["dependencies"] if "<" in one or "==" in one] == []


def test_the_workflow_runs_the_ends_of_the_range():
    workflow = YAML(typ="safe").load(ROOT / ".github" / "workflows" / "tests.yml")
    runs = workflow["jobs"]["test"]["strategy"]["matrix"]["include"]
    assert [f"{run['python']} {run['versions']}" for run in runs] == environments.environments()[:2]


def test_a_python_that_does_not_exist_is_stated(tmp_path, monkeypatch):
    monkeypatch.setattr(environments, "interpreter", lambda python: None)
    with pytest.raises(SystemExit, match=r"Python 3\.99 was not found and could not be installed"):
        environments.make("3.99", "newest", tmp_path)
