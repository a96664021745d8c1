"""Outputs of commands in pages: what counts as a change."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SPEC = importlib.util.spec_from_file_location("command_output", ROOT / "docs" / "command_output.py")
command_output = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(command_output)

PAGE = """# Page

<!-- output of: python -c "print('mass 1.35 kg')" -->
```text
mass {} kg
```
<!-- end -->
"""


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("mass 1.35 kg", "mass 1.35 kg", True),
        ("mass 1.35 kg", "mass 1.36 kg", True),  # one unit of the last digit
        ("mass 1.35 kg", "mass 1.39 kg", False),
        ("e_p 206.8 mm", "e_p 209.9 mm", True),  # 1.5 %
        ("e_p 206.8 mm", "e_p 212.9 mm", False),
        ("gain 1e-3", "gain 2e-3", True),
        ("gain 1e-3", "gain 3e-3", False),
        ("3 agents", "3 teams", False),
        ("from -0.3 rad/s", "from 0.3 rad/s", False),
        ("a b", "a\n  b", True),
    ],
)
def test_numbers_are_compared_with_a_tolerance(one, other, same):
    assert command_output.agree(one, other) == same


def test_a_changed_output_is_reported_and_rewritten(tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text(PAGE.format(2.0))
    assert command_output.main(["--check", str(page)]) == 1
    assert "-mass 2.0 kg\n+mass 1.35 kg" in capsys.readouterr().out
    assert page.read_text() == PAGE.format(2.0)
    assert command_output.main([str(page)]) == 0
    assert page.read_text() == PAGE.format(1.35)
    assert command_output.main(["--check", str(page)]) == 0


def test_a_command_that_fails_is_an_error(tmp_path):
    (tmp_path / "page.md").write_text(PAGE.format(1).replace("print('mass 1.35 kg')", "raise SystemExit(3)"))
    with pytest.raises(SystemExit, match="exit status 3"):
        command_output.main(["--check", str(tmp_path / "page.md")])
