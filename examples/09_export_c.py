"""Controller step as C with its learned model: simulate C3, write the code, and build the replay if possible.

`colift export c` does the same. Run it with `python examples/09_export_c.py`.
"""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
import tempfile
from pathlib import Path

import colift
from colift.integrations import c_export

PLATE = Path(__file__).with_name("plate.yaml")
TICKS = 250


def main() -> None:
    """Print the written files, and the difference between the commands of the program and those of Python."""
    experiment = colift.make_experiment(colift.load_scenario(PLATE), "C3")
    experiment = dataclasses.replace(experiment, duration=2.0, update_times=(1.0,))
    flight = colift.run_experiment(experiment)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        c_export.export_c(experiment, flight.model, TICKS, folder, "plate, C3")
        for file in sorted(folder.iterdir()):
            print(f"{file.name:16} {file.stat().st_size / 1e3:8.1f} kB")
        if (compiler := shutil.which("cc")) is None:
            print("no C compiler: not built")
            return
        sources = [folder / f"{name}.c" for name in ("colift", "learned", "replay")]
        program = [folder / "replay", folder / "flight.bin"]
        subprocess.run([compiler, "-O1", "-Wno-psabi", *sources, "-o", program[0], "-lm"], check=True)
        print(subprocess.run(program, check=True, capture_output=True, text=True).stdout, end="")


if __name__ == "__main__":
    main()
