"""Write the output of commands into pages: `python docs/command_output.py [--check] PAGE...`.

A page marks a command and the block that holds its output::

    <!-- output of: colift check my_team.yaml -->
    ```text
    ...
    ```
    <!-- end -->

Commands of one run share a temporary folder, in the order of the pages. With ``--check`` a page whose output differs in
its words (numbers are ignored, since computation times vary) is reported, and the exit status is 1.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

BLOCK = re.compile(r"(<!-- output of: (?P<command>.+?) -->\n)```text\n(?P<text>.*?)```\n(<!-- end -->)", re.DOTALL)


def run(command: str, folder: Path) -> str:
    """Return the standard output of a command that runs in a folder, with the checkout's Python."""
    words = shlex.split(command)
    if words[0] == "colift":
        words = [sys.executable, "-m", "colift", *words[1:]]
    elif words[0] == "python":
        words[0] = sys.executable
    env = {**os.environ, "COLUMNS": "120", "NO_COLOR": "1"}
    done = subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True, check=False)
    return "\n".join(line.rstrip() for line in done.stdout.strip("\n").splitlines()) + "\n"


def main(arguments: list[str]) -> int:
    """Rewrite or check the pages that are named."""
    check, differ = "--check" in arguments, []
    with tempfile.TemporaryDirectory() as name:
        for page in (Path(argument) for argument in arguments if argument != "--check"):
            text = page.read_text(encoding="utf-8")
            found = BLOCK.sub(lambda m: f"{m[1]}```text\n{run(m['command'], Path(name))}```\n{m[4]}", text)
            if check and words(found) != words(text):
                differ.append(str(page))
            elif not check:
                page.write_text(found, encoding="utf-8")
    for page in differ:
        print(f"{page}: the output of a command has changed; run `python docs/command_output.py {page}`")
    return int(bool(differ))


def words(text: str) -> list[str]:
    """Return the words of a text without numbers."""
    return re.findall(r"[^\W\d_]+", text)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
