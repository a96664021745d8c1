"""Tests of the project's structure: imports, layers, documentation, lock files and `./dev`."""

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "src" / "colift").rglob("*.py"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))

# Every label of the paper's equations, assumptions, statements and figures.
LABELS = """
eq:M0_partition eq:vbar_def eq:nom_trans_rot eq:nom_kin_coup eq:nom_momentum eq:sys_unc_1 eq:sys_unc_2 eq:sys_unc_3
eq:dae_constraints eq:dae_agent_R eq:dae_agent_x eq:dae_agent_kin eq:dae_agent_mom eq:dae_payload_trans
eq:dae_payload_rot eq:dae_compact eq:learning_output_components eq:dataset_agent_online eq:dataset_payload_online
ass:dataset ass:oracle_bound eq:ass2_agent eq:ass2_payload rem1 ass:rkhs lem:gp_error_bound eq:beta_agents
eq:beta_payload eq:pl_nom_kin eq:pl_nom_rot ass:wrench_matching_nominal eq:pl_Fd eq:pl_taud eq:pl_cl_ep eq:pl_cl_eR
eq:pl_cl_eom eq:leader_force eq:follower_force lem:wrench_consistency eq:wrench_consistency prop:constraint_invariance
ass:agent_layer_iss eq:DeltaW_bound_agentlayer eq:payload_force_cmd_learning eq:payload_torque_cmd_learning
eq:err_ev_learning eq:err_eomega_learning thm:learning_tracking eq:Omega_delta_union eq:Vdot_bound_38 eq:Vdot_bound_k
eq:Young_39 eq:Vdot_bound_40 eq:Vdot_step3 rem:gp_covariance_bound cor:asymptotic_recovery eq:UUB_bound_template
eq:dk_def fig:payload_tracking_se3 fig:deltaW fig:gp_uncertainty fig:contact_forces
""".split()


def page(name: str) -> str:
    """Return the text of a page of the documentation."""
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def resolves(name: str) -> bool:
    """Return whether `module.function` exists in colift."""
    module, _, attribute = name.rpartition(".")
    return hasattr(importlib.import_module(f"colift.{module}"), attribute)


def names_of_tests(file: str) -> set[str]:
    """Return the names of the tests of a test module."""
    path = ROOT / "tests" / file
    tree = ast.parse(path.read_text(encoding="utf-8")) if path.exists() else ast.Module(body=[], type_ignores=[])
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}


# Imports --------------------------------------------------------------------------------------------------------------


def test_import_contracts_hold(tmp_path):
    """Imports point to lower layers, and onboard code never imports the simulation."""
    linter = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run(
        [linter, "--cache-dir", tmp_path],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_onboard_code_and_simulation_are_independent_layers():
    """Onboard code and simulation are independent in the layers contract, without an exception."""
    (contract,) = PROJECT["tool"]["importlinter"]["contracts"]
    assert "onboard | simulation" in contract["layers"]
    assert contract["exhaustive"]
    assert "ignore_imports" not in contract


# Documentation --------------------------------------------------------------------------------------------------------


def test_every_label_of_the_paper_is_listed_once():
    assert sorted(re.findall(r"^\| `([a-z]\w*(?::\w+)?)` \|", page("equations.md"), re.MULTILINE)) == sorted(LABELS)


ROWS = re.findall(r"^\| `([a-z]\w*(?::\w+)?)` \| (.*?) \| ?(.*?) ?\|$", page("equations.md"), re.MULTILINE)


@pytest.mark.parametrize(("label", "function", "test"), ROWS, ids=[row[0] for row in ROWS])
def test_every_equation_has_a_function_and_a_test(label, function, test):
    del label
    if function.startswith("a step of the paper's proof"):
        assert not test
        return
    for cell, exists in (
        (function, resolves),
        (test, lambda name: name.split("::")[1] in names_of_tests(name.split("::")[0])),
    ):
        names = re.findall(r"`([^`]+)`", cell)
        assert names or cell == "not yet", f"{cell!r}: name what computes and what shows it, or say 'not yet'"
        assert all(exists(name) for name in names), f"{cell} does not exist"


def called() -> set[str]:
    """Return all names and attributes that package and tests use."""
    files = [path for folder in ("src", "tests") for path in (ROOT / folder).rglob("*.py")]
    nodes = [node for path in files for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
    names = {node.id for node in nodes if isinstance(node, ast.Name)}
    return names | {node.attr for node in nodes if isinstance(node, ast.Attribute)}


def test_functions_of_equations_are_called():
    named = {name for _, function, _ in ROWS for name in re.findall(r"`([a-z][\w.]*\.\w+)`", function)}
    assert len(named) > 30
    used = called()
    assert {name for name in named if name.rpartition(".")[2] not in used} == set()


@pytest.mark.parametrize(
    "name", ["certificate.md", "equations.md", "errata.md", "notation.md", "performance.md", "references.md"]
)
def test_tests_named_by_pages_exist(name):
    for file, test in re.findall(r"`([\w/]*test_\w+\.py)::(\w+)`", page(name)):
        assert test in names_of_tests(file), f"{file}::{test}"


def test_errata_rows_are_numbered_without_gap():
    assert [int(n) for n in re.findall(r"^\| (\d+) \|", page("errata.md"), re.MULTILINE)] == list(range(1, 22))


def test_links_between_pages_have_a_target():
    for path in [ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")]:
        for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", path.read_text(encoding="utf-8")):
            assert (path.parent / target).exists(), f"{path.name}: {target}"


def test_files_named_by_the_readme_exist():
    named = re.findall(
        r"(?:docs|src|tests|requirements|benchmarks|examples)/[\w./-]*", (ROOT / "README.md").read_text()
    )
    assert named
    missing = [name for name in named if not (ROOT / name.rstrip(".")).exists()]
    assert not missing


def test_decisions_are_numbered_once():
    numbers = [path.name[:4] for path in (ROOT / "docs" / "decisions").glob("0*.md")]
    assert len(numbers) == len(set(numbers))


@pytest.mark.parametrize("path", SOURCES, ids=[str(p.relative_to(ROOT / "src" / "colift")) for p in SOURCES])
def test_public_names_have_docstrings(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert ast.get_docstring(tree), "the module"
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            assert ast.get_docstring(node), node.name


# Set-up ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lock", sorted((ROOT / "requirements").glob("*.txt")), ids=lambda path: path.stem)
def test_locks_have_versions_and_hashes_but_no_address(lock):
    text = lock.read_text(encoding="utf-8")
    assert "://" not in text
    for entry in re.split(r"\n(?=\S)", text.strip()):
        assert re.match(r"[\w.\[\]-]+==\S+", entry), entry
        assert "--hash=sha256:" in entry, entry


def test_locks_contain_all_requirements():
    required = {"run": PROJECT["project"]["dependencies"]}
    for group, names in PROJECT["dependency-groups"].items():
        required[group] = required.get(group, []) + names
    for group, requirements in required.items():
        text = (ROOT / "requirements" / f"{group}.txt").read_text(encoding="utf-8")
        locked = {
            name.lower().replace("_", "-").replace(".", "-") for name in re.findall(r"^([\w.-]+)==", text, re.MULTILINE)
        }
        for requirement in requirements:
            name = re.split(r"[^\w.-]", requirement)[0].lower().replace("_", "-").replace(".", "-")
            assert name in locked, f"{requirement} is not in requirements/{group}.txt: run ./dev lock"


def test_no_file_contains_a_host_or_registry_address():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)
    files = [ROOT / name for name in listed.stdout.splitlines()]
    foreign = re.compile(rb"/(?:root|home)/\w|/opt/\w|extra-index-url|127\.0\.0\.1:\d")
    for path in files:
        if path.exists() and path != Path(__file__):
            assert not foreign.search(path.read_bytes()), path.relative_to(ROOT)


FAKE_PYTHON = """#!/bin/sh
# Substitute for python3: it reports version and venv, creates a folder as venv does, and records calls of pip.
case "$*" in
*version_info*) exit {too_old} ;;
*python_version*) echo 3.9.1 ;;
*ensurepip*) exit {no_venv} ;;
"-m venv "*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" ;;
*"pip "*) echo "$*" >>"$CALLS" && exit ${{PIP_FAILS:-0}} ;;
*pytest*) echo ran "$@" ;;
esac
"""


@pytest.fixture
def checkout(tmp_path):
    """Copy of the files that the setup reads, and a function that calls `./dev` with a substitute for python3."""
    for name in ("dev", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    shutil.copytree(ROOT / "requirements", tmp_path / "requirements")
    calls = tmp_path / "calls"

    def dev(
        *arguments: str, too_old: int = 0, no_venv: int = 0, **environment: str
    ) -> subprocess.CompletedProcess[str]:
        tools = tmp_path / "tools"
        tools.mkdir(exist_ok=True)
        for name in ("cat", "cmp", "cp", "dirname", "find", "head", "mkdir", "mv", "rm", "sh", "sleep", "kill"):
            if (found := shutil.which(name)) and not (tools / name).exists():
                (tools / name).symlink_to(found)
        if too_old >= 0:
            (tools / "python3").write_text(FAKE_PYTHON.format(too_old=too_old, no_venv=no_venv))
            (tools / "python3").chmod(0o755)
        calls.write_text("")
        environment = {"PATH": str(tools), "CALLS": str(calls), **environment}
        return subprocess.run(
            ["/bin/sh", str(tmp_path / "dev"), *arguments],
            capture_output=True, text=True, check=False, timeout=60, env=environment, cwd=os.sep,
        )  # fmt: skip

    return tmp_path, dev, calls


def test_dev_repeats_setup_only_when_a_lock_changes(checkout):
    root, dev, calls = checkout
    first = dev("test", "-k", "x y")
    assert first.returncode == 0, first.stderr
    assert first.stdout.startswith("ran")
    assert "-k x y" in first.stdout
    installed = calls.read_text()
    assert [line for line in installed.splitlines() if "--require-hashes" in line and "run.txt" in line]
    assert "--no-build-isolation --editable ." in installed
    assert "test.txt" in installed
    assert "docs.txt" not in installed
    dev("test")
    assert calls.read_text() == ""
    with (root / "requirements" / "test.txt").open("a") as lock:
        lock.write("# changed\n")
    dev("test")
    assert "test.txt" in calls.read_text()
    assert "run.txt" not in calls.read_text()


def test_dev_coverage_measures_what_is_asked(checkout):
    _, dev, calls = checkout
    done = dev("coverage", "tests/unit/gp")
    assert done.returncode == 0, done.stderr
    assert "--cov " in done.stdout
    assert done.stdout.rstrip().endswith("tests/unit/gp")
    assert "check.txt" in calls.read_text()


def test_dev_repeats_a_failed_setup(checkout):
    """The setup is repeated after a setup that failed or was killed."""
    root, dev, calls = checkout
    failed = dev("test", PIP_FAILS="1")
    assert failed.returncode == 1
    assert "the set-up failed" in failed.stderr
    assert (root / ".venv" / "unfinished").exists()
    (root / ".venv" / "left over").touch()
    (root / ".venv.lock").mkdir()  # of a process that was killed
    (root / ".venv.lock" / "pid").write_text("999999999")
    again = dev("test")
    assert again.returncode == 0, again.stderr
    assert not (root / ".venv" / "left over").exists()
    assert not (root / ".venv" / "unfinished").exists()
    assert not (root / ".venv.lock").exists()
    assert "run.txt" in calls.read_text()


@pytest.mark.parametrize(
    ("flaw", "answer"),
    [
        ({"too_old": 1}, "python3 is 3.9.1; 3.11 or newer is needed"),
        ({"no_venv": 1}, "python3 has no venv module"),
        ({"too_old": -1}, "python3 was not found"),
    ],
)
def test_dev_reports_missing_python(checkout, flaw, answer):
    _, dev, _ = checkout
    done = dev("test", **flaw)
    assert done.returncode == 1
    assert answer in done.stderr
    assert "Traceback" not in done.stderr


def test_dev_help_and_unknown_command(checkout):
    """Without a command `./dev` prints its help; an unknown command is an error."""
    _, dev, _ = checkout
    assert dev().returncode == 0
    assert "usage" in dev().stdout
    assert dev("fly").returncode == 1
    assert "no command 'fly'" in dev("fly").stderr


def compilation_cache_folder(environment: dict[str, str]) -> str:
    """Return the folder in which a new process would cache compiled programs."""
    code = "import colift, jax; print(jax.config.jax_compilation_cache_dir)"
    kept = {
        key: value for key, value in os.environ.items() if key not in ("JAX_COMPILATION_CACHE_DIR", "XDG_CACHE_HOME")
    }
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120, env=kept | environment
    )
    return done.stdout.strip()


def test_compilation_cache_folder_is_configurable(tmp_path):
    assert compilation_cache_folder({"XDG_CACHE_HOME": str(tmp_path)}) == str(tmp_path / "colift" / "jax")
    assert compilation_cache_folder({"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "mine")}) == str(tmp_path / "mine")


def test_test_configuration_is_strict():
    jax = importlib.import_module("jax")
    assert jax.config.jax_enable_x64
    assert jax.config.jax_numpy_dtype_promotion == "strict"
    assert jax.config.jax_numpy_rank_promotion == "raise"
    assert "error" in PROJECT["tool"]["pytest"]["ini_options"]["filterwarnings"]
    hat = importlib.import_module("colift.math.so3").hat
    with pytest.raises(Exception, match="Type-check error"):
        hat(jax.numpy.zeros(4))


def test_no_reference_to_a_page_outside_the_repository():
    cited = "design".upper()  # the founders' page, spelled so that this line does not cite it
    kinds = {".py", ".md", ".yaml", ".toml", ".h"}
    folders = ("src", "tests", "docs", "benchmarks", "evidence", "examples")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in kinds]
    files += [path for path in ROOT.glob("*") if path.suffix in kinds]
    assert len(files) > 100
    assert [path.relative_to(ROOT) for path in files if re.search(rf"\b{cited}\b", path.read_text("utf-8"))] == []


def test_wheel_contains_package_data_and_license(tmp_path):
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        names = set(packed.namelist())
        packed.extractall(tmp_path / "installed")
        (metadata,) = (packed.read(name).decode() for name in names if name.endswith("METADATA"))
    shipped = subprocess.run(["git", "ls-files", "src"], cwd=ROOT, capture_output=True, text=True, check=False)
    files = shipped.stdout.split() or [str(path.relative_to(ROOT)) for path in SOURCES]
    assert {name.removeprefix("src/") for name in files} <= names
    for name in ("LICENSE", "THIRD_PARTY.md"):
        assert any(each.endswith(f"licenses/{name}") for each in names)
    assert "License-Expression: BSD-3-Clause" in metadata
    listed = subprocess.run(
        [sys.executable, "-m", "colift", "list"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path / "installed")},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "certified " in listed.stdout


def test_citation_states_version_and_license():
    cited = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == PROJECT["project"]["version"]
    assert cited["license"] == PROJECT["project"]["license"]
    assert [author["name"] for author in cited["authors"]] == [x["name"] for x in PROJECT["project"]["authors"]]
