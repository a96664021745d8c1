"""Tests that execute the code blocks of the documentation and the examples.

A page starts in a folder with the tutorial's `my_team.yaml`; its blocks run in order and share names. Commands that
would simulate are only parse_command, and their scenario is read.
"""

from __future__ import annotations

import importlib
import re
import runpy
import shlex
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer
from ruamel.yaml import YAML
from typer.testing import CliRunner

from colift import scenario
from colift.campaigns import spec
from colift.cli import app
from colift.scenario import template

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
COLIFT = typer.main.get_command(app.app)
RUN = {("init",), ("list",), ("print-config",), ("export", "mjcf")}  # commands that take a second or two
ELSEWHERE = {  # examples that another module runs with a shared flight
    "02_own_team": "test_examples.py",
    "08_certify_a_flight": "test_certification.py",
}
VEHICLE = """<robot name="vehicle">
<link name="base"><inertial><mass value="1.5"/><inertia ixx="0.02" iyy="0.02" izz="0.035" ixy="0" ixz="0" iyz="0"/>
</inertial></link><link name="waist"><inertial><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="waist" type="continuous"><parent link="base"/><child link="waist"/><axis xyz="0 0 1"/></joint>
{arms}</robot>"""
ARM = """<link name="{side}_forearm"><inertial><origin xyz="0 0 -0.15"/><mass value="0.12"/>
<inertia ixx="9e-4" iyy="9e-4" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{side}_shoulder" type="continuous"><parent link="waist"/><child link="{side}_forearm"/>
<origin xyz="0 {y} 0"/><axis xyz="1 0 0"/></joint><link name="{side}_hand"/>
<joint name="{side}_wrist" type="fixed"><parent link="{side}_forearm"/><child link="{side}_hand"/>
<origin xyz="0 0 -0.3"/></joint>"""


class Block(NamedTuple):
    """Code block of a page."""

    line: int
    language: str
    text: str


def blocks(page: Path) -> Iterator[Block]:
    """Yield fenced blocks other than directives, and indented blocks, which contain shell commands."""
    text = page.read_text(encoding="utf-8")
    fenced = r"^```(?P<language>[^\n]*)\n(?P<fenced>.*?)^```$"
    indented = r"(?<=\n\n)(?P<indented>(?:    \S[^\n]*\n)+)"
    for found in re.finditer(f"{fenced}|{indented}", text, re.MULTILINE | re.DOTALL):
        line = text.count("\n", 0, found.start()) + 1
        if found["indented"] is not None:
            yield Block(line, "sh", re.sub("^    ", "", found["indented"], flags=re.MULTILINE))
        elif not found["language"].startswith("{"):
            yield Block(line, found["language"], found["fenced"])


# Shell commands -------------------------------------------------------------------------------------------------------


def commands(text: str) -> Iterator[list[str]]:
    """Yield the words of every shell command of a block, including the body of a loop."""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line.replace("$seed", "1"), comments=True)
        if words and words[0] == "for":
            continue
        while words:
            end = words.index("&&") if "&&" in words else len(words)
            yield words[:end]
            words = words[end + 1 :]


def parse_command(words: list[str]) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Return the path of a colift command and its parameters; a wrong command raises KeyError or an error of typer."""
    command, path = COLIFT, ()
    while hasattr(command, "commands"):
        name, *words = words
        command, path = command.commands[name], (*path, name)
    return path, command.make_context(path[-1], words).params


def run(words: list[str], folder: Path) -> None:
    """Run a fast command; for other commands check only that they and their arguments exist."""
    first, rest = words[0], words[1:]
    if first == "./dev" and rest[0] == "study":
        words = ["colift", "study", "paper", *rest[1:]]
    elif first == "./dev" and rest[0] == "colift":
        words = rest
    elif first == "./dev":
        assert re.search(rf"^(?:\S+ \| )*{rest[0]}(?: \| \S+)*\) ", (ROOT / "dev").read_text(), re.MULTILINE), words
        if rest[0] in ("evidence", "bench") and len(rest) > 1 and rest[1] != "status":
            assert (ROOT / {"bench": "benchmarks"}.get(rest[0], rest[0]) / f"{rest[1]}.py").exists(), words
        return
    elif first == "pip" or rest[:3] == ["-m", "pip", "install"]:
        (extra,) = re.findall(r"^colift\[(\w+)\]$", rest[-1])
        assert extra in PROJECT["project"]["optional-dependencies"]
        return
    elif first in ("python", "./.venv/bin/python"):
        assert (ROOT / rest[0]).exists()
        return
    elif first != "colift":
        assert first in ("cmake", "build/replay", "cd", "npm", "done"), f"unknown command: {shlex.join(words)}"
        return
    path, parameters = parse_command(words[1:])
    if path in RUN:
        if path == ("init",):
            Path(parameters["file"]).unlink(missing_ok=True)
        done = CliRunner().invoke(app.app, words[1:])
        assert done.exit_code == 0, done.output
    elif "name" in parameters:
        scenario.load_scenario(parameters["name"], parameters.get("overrides") or ())


# Pages ----------------------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Working folder of a page."""
    (tmp_path / "my_team.yaml").write_text(template.scenario_template("my_team", 3, 0))
    arms = "".join(ARM.format(side=side, y=y) for side, y in (("left", 0.08), ("right", -0.08)))
    (tmp_path / "vehicles").mkdir()
    for name in ("vehicle.urdf", "vehicles/two_arms.urdf"):
        (tmp_path / name).write_text(VEHICLE.format(arms=arms))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if (tmp_path / f"{name}.py").exists():
            del sys.modules[name]


def merged(text: str) -> dict[str, Any]:
    """Return the tutorial's scenario updated with a fragment of YAML."""
    yaml = YAML(typ="safe")
    whole = yaml.load(Path("my_team.yaml").read_text())
    for key, value in yaml.load(text).items():
        whole[key] = whole.get(key, {}) | value if isinstance(value, dict) and "kind" not in value else value
    return whole


def do(block: Block, page: Path, folder: Path, names: dict[str, Any]) -> None:
    match block.language:
        case "sh" | "console":
            for words in commands(block.text):
                run(words, folder)
        case "python":
            if file := re.match(r"# (\w+)\.py\n", block.text):
                (folder / f"{file[1]}.py").write_text(block.text)
                importlib.import_module(file[1])
            else:
                exec(compile("\n" * block.line + block.text, str(page), "exec", dont_inherit=True), names)
        case "yaml" if block.text.startswith("scenario:"):
            (folder / "campaign.yaml").write_text(block.text)
            spec.load_campaign(folder / "campaign.yaml")
        case "yaml":
            with (folder / "fragment.yaml").open("w") as opened:
                YAML(typ="safe").dump(merged(block.text), opened)
            scenario.load_scenario("fragment.yaml")
        case language:
            assert language in ("text", "bibtex"), f"a block of {language!r}: use console, python, yaml, text or bibtex"


WITH_CODE = {str(page.relative_to(ROOT)): found for page in PAGES if (found := list(blocks(page)))}


@pytest.mark.parametrize("name", WITH_CODE)
def test_code_of_page_runs(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webbrowser.open", lambda _url: True)
    names: dict[str, Any] = {"__name__": name}
    for block in WITH_CODE[name]:
        try:
            do(block, ROOT / name, folder, names)
        except Exception as error:
            raise AssertionError(f"{name}:{block.line}: {error}") from error


@pytest.mark.parametrize(
    ("language", "text", "message"),
    [
        ("sh", "./dev colift study my_team.yaml --sed 1\n", "No such option"),
        ("sh", "./dev colift study nobody.yaml\n", "nobody.yaml"),
        ("sh", "./dev colift check my_team.yaml --set payload.mas_kg=2\n", "mas_kg"),
        ("sh", "./dev colift fly paper\n", "fly"),
        ("sh", "./dev evidence nothing\n", "nothing"),
        ("sh", "./dev fly\n", "fly"),
        ("sh", "rm -r out\n", "unknown command: rm -r out"),
        ("sh", "pip install 'colift[nothing]'\n", "nothing"),
        ("yaml", "payload: {mass: 2}\n", "payload.mass"),
        ("python", "import colift\ncolift.take_off()\n", "take_off"),
        ("", "./dev study\n", "a block of ''"),
    ],
    ids=["option", "scenario", "setting", "command", "proof", "dev", "program", "extra", "yaml", "python", "language"],
)
def test_invalid_code_blocks_are_detected(language: str, text: str, message: str, folder: Path) -> None:
    with pytest.raises(Exception, match=re.escape(message)):
        do(Block(1, language, text), ROOT / "README.md", folder, {})


# Examples -------------------------------------------------------------------------------------------------------------


def test_examples_are_numbered_and_documented() -> None:
    """Examples are numbered from 01 to 10, and their docstrings state purpose and command."""
    assert [path.stem[:3] for path in EXAMPLES] == [f"{k:02}_" for k in range(1, 11)]
    for path in EXAMPLES:
        output = path.read_text(encoding="utf-8").split('"""')[1]
        assert f"python examples/{path.name}`" in output, path.name


@pytest.mark.parametrize("path", [path for path in EXAMPLES if path.stem not in ELSEWHERE], ids=lambda path: path.stem)
def test_example_runs(path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    shorter = ["duration_s=2", "learning.update_times_s=[1]", "learning.end_s=1"]
    parameters = [str(path.with_name("plate.yaml")), *shorter] if path.stem == "01_fly_the_paper" else []
    monkeypatch.setattr(sys, "argv", [str(path), *parameters])
    runpy.run_path(str(path), run_name="__main__")
    output = capsys.readouterr().out
    assert output
    assert "nan" not in output


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_examples_named_by_pages_exist(page: Path) -> None:
    for name in re.findall(r"examples/[\w.]+\w", page.read_text(encoding="utf-8")):
        assert (ROOT / name).exists(), name


# Reference pages ------------------------------------------------------------------------------------------------------


def test_every_module_is_on_one_reference_page() -> None:
    found = [
        name
        for page in (ROOT / "docs" / "api").glob("*.md")
        for name in re.findall(r"automodule:: colift\.([\w.]+)", page.read_text(encoding="utf-8"))
    ]
    assert len(found) == len(set(found))
    package = ROOT / "src" / "colift"
    paths = (".".join(path.relative_to(package).with_suffix("").parts) for path in package.rglob("*.py"))
    modules = {path.removesuffix(".__init__") for path in paths}
    assert set(found) == modules - {"__init__", "__main__"}


def test_no_formula_line_starts_like_a_list_item():
    """Markdown would end the paragraph at such a line and display the source of the formula."""
    for page in PAGES:
        text = re.sub(r"^```.*?^```$|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        for paragraph in re.split(r"\n\s*\n", text):
            opened = 0
            for line in paragraph.splitlines():
                assert not (opened % 2 and re.match(r"\s*([-+*#>]|\d+[.)])\s", line)), f"{page.name}: {line}"
                opened += len(re.findall(r"(?<!\\)\$", line))
