"""Write the output of commands into pages: `python docs/command_output.py [--check] PAGE...`.

A page marks a command and the block that holds its output::

    <!-- output of: colift check my_team.yaml -->
    ```text
    ...
    ```
    <!-- end -->

Commands of one run share a temporary folder, in the order of the pages. A command that fails is an error. With
``--check`` the outputs are compared instead, and the exit status is 1 where one differs. Words must be equal. Numbers
may differ by the tolerance `RELATIVE`, or by one unit of their last digit, because processors round differently.
"""

from __future__ import annotations

import difflib
import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

BLOCK = re.compile(r"(<!-- output of: (?P<command>.+?) -->\n)```text\n(?P<text>.*?)```\n(<!-- end -->)", re.DOTALL)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
RELATIVE = 0.02
COLUMNS = 92  # characters, the width of a block of the documentation


def run(command: str, folder: Path) -> str:
    """Return the standard output of a command that runs in a folder, with the checkout's Python."""
    words = shlex.split(command)
    if words[0] == "colift":
        words = [sys.executable, "-m", "colift", *words[1:]]
    elif words[0] == "python":
        words[0] = sys.executable
    env = {**os.environ, "COLUMNS": str(COLUMNS), "NO_COLOR": "1"}
    done = subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{command}: exit status {done.returncode}\n{done.stdout}{done.stderr}")
    return "\n".join(line.rstrip() for line in done.stdout.strip("\n").splitlines()) + "\n"


def agree(one: str, other: str) -> bool:
    """Return whether two outputs have the same words, and numbers within the tolerance."""
    if NUMBER.sub("0", one).split() != NUMBER.sub("0", other).split():
        return False
    pairs = zip(NUMBER.findall(one), NUMBER.findall(other), strict=True)
    return all(abs(float(a) - float(b)) <= max(RELATIVE * abs(float(a)), 1.01 * unit(a)) for a, b in pairs)


def unit(number: str) -> float:
    """Return one unit of the last digit of a number."""
    mantissa, _, exponent = number.partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def main(arguments: list[str]) -> int:
    """Rewrite or check the pages that are named."""
    check, differ = "--check" in arguments, []
    with tempfile.TemporaryDirectory() as name:

        def put(block: re.Match[str]) -> str:
            printed = run(block["command"], Path(name))
            same = agree(block["text"], printed)
            if same and (check or block["text"].count("\n") == printed.count("\n")):
                return block[0]  # other line breaks alone are no error, but are rewritten
            differ.append(f"{page}: the output of `{block['command']}` has changed")
            lines = (block["text"].splitlines(), printed.splitlines())
            differ.extend(difflib.unified_diff(*lines, "page", "output", lineterm="", n=0))
            return f"{block[1]}```text\n{printed}```\n{block[4]}"

        for page in (Path(argument) for argument in arguments if argument != "--check"):
            found = BLOCK.sub(put, page.read_text(encoding="utf-8"))
            if not check:
                page.write_text(found, encoding="utf-8")
    if check and differ:
        print("\n".join([*differ, "run `python docs/command_output.py PAGE`"]))
    return int(check and bool(differ))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
