"""Draw the figures of the documentation: `python docs/figures.py OUT [NAME ...]`.

OUT holds the flights. A folder of `FLIGHTS` that is missing there is computed by its command, which takes some minutes.
The figures of `./dev evidence` and `./dev bench` are drawn from the stored results. `playback.png` requires Chromium.
The pictures of the notebook gallery are the first figures of the executed notebooks, so they require `./dev docs`
before. Without NAME all figures are drawn. `limits` also writes the tables of `docs/limits.md`. `team.svg`, `loop.svg`
and `labels.svg` are sources.
"""

import base64
import functools
import importlib
import io
import json
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from PIL import Image

from colift.closed_loop import log
from colift.scenario.cases import ALL_CASES
from colift.visualization import axes, playback, rendering, seed_figures, style

ROOT = Path(__file__).parents[1]
HERE = ROOT / "docs" / "figures"
TURN = "disturbances.{}.direction_change={{change_deg: 180, start_s: 13}}"
LOST = "sensors.models=[{kind: intermittent, channels: [agents.lam], rate_Hz: 500, failure_time_s: 16}]"
EVENTS = ("control.preview_step_s=0.03", TURN.format("load_wind"), TURN.format("agent_wind"), LOST)
FLIGHTS = {  # folder, and the command that writes it
    "study": ("study", "paper", "--case", "C1,C2,C3,label_feedback,adaptive,true_residual"),
    "reaction": (
        *("study", "paper", "--case", "label_feedback,gp_label_feedback,adaptive"),
        *(word for setting in EVENTS for word in ("--set", setting)),
    ),
    "certified": ("certify", "certified"),
    "grips": ("study", "rigid_beam", "--case", "C1"),
}
COPIED = {  # figure of a page, and where it is
    "study_tracking": "study/figure_1_tracking",
    "study_deviation": "study/figure_3_deviation",
    "study_rho_bar": "study/figure_5_rho_bar",
    "reaction": "reaction/figure_7_reaction",
    "certificate": "certified/figure_6_certificate",
    "rigid_beam": "grips/figure_0_team",
}
LIMITS_PAGE = ROOT / "docs" / "limits.md"  # its commands, figures and tables
EVENT, BEFORE = 14.0, 9.0  # s, time of all events of that page, and start of the window before it
SHOWN = ("C1", "C2", "C3")  # cases of the playback page
THUMBNAIL, PAGE_PIXELS = 360, 1400  # px, width of a picture of the gallery and of a page


def flights(out: Path, name: str) -> Path:
    """Return a folder of flights, computed first if it is missing."""
    if not (out / name).is_dir():
        command = [sys.executable, "-m", "colift", *FLIGHTS[name], "--out", str(out / name)]
        subprocess.run(command, check=True)
    return out / name


def copied(name: str, out: Path) -> None:
    """Copy a figure of a study."""
    folder, figure = COPIED[name].split("/")
    shutil.copy(flights(out, folder) / f"{figure}.png", HERE / f"{name}.png")


def seeds(out: Path) -> None:
    """Draw the metrics of all cases over the seeds."""
    found = importlib.import_module("evidence").stored("orderings")["items"]
    seed_figures.plot_seed_spread(list(found.values()), ALL_CASES, out / "study_seeds")
    shutil.copy(out / "study_seeds.png", HERE)


def stored(name: str, _out: Path) -> None:
    """Draw the figure of an evidence module from its stored result."""
    module, found = importlib.import_module(f"evidence.{name}"), importlib.import_module("evidence").stored(name)
    module.draw(found["items"], HERE / f"{name}.png")


def limits(out: Path) -> None:
    """Compute the flights of the page on limits by its commands, copy their figures and write its tables."""
    commands = re.findall(r"^\./dev (colift study .*?[^\\])$", LIMITS_PAGE.read_text(encoding="utf-8"), re.M | re.S)
    for found in commands:
        words = shlex.split(found.replace("\\\n", " "))
        place = words.index("--out") + 1
        name = Path(words[place]).name
        folder = out / f"limits_{name}"
        words[place] = str(folder)
        if not folder.is_dir():  # a flight that ends early has status 1
            subprocess.run([sys.executable, "-m", *words], check=False)
        write_small(Image.open(folder / "figure_9_limits.png"), f"limits_{name}", PAGE_PIXELS)
        _, logs = log.load_flights(folder, ALL_CASES)
        rows = ["| case | $e_p$ before [mm] | $e_p$ [mm] | attitude error [deg] | contact force [N] | end |"]
        rows += ["|---|---:|---:|---:|---:|---|", *(limits_row(case, ds) for case, ds in logs.items())]
        picture = f"![Errors, contact force and active limits](figures/limits_{name}.png)"
        text = "\n".join([f"<!-- flights: {name} -->", *rows, "", picture, "<!-- end -->"])
        page, of = LIMITS_PAGE.read_text(encoding="utf-8"), rf"<!-- flights: {name} -->.*?<!-- end -->"
        LIMITS_PAGE.write_text(re.sub(of, lambda _, text=text: text, page, flags=re.S), encoding="utf-8")


def limits_row(case: str, ds: xr.Dataset) -> str:
    """Return the row of a flight: errors before and after the event, largest attitude error and contact force."""
    before, after = ds.sel(time=slice(BEFORE, EVENT)), ds.sel(time=slice(EVENT, None))
    if not after.sizes["time"]:
        return f"| `{case}` | | | | | {float(ds.time[-1]):.2f} s |"
    errors = [1e3 * float(np.sqrt((part.e_p**2).sum("axis").mean())) for part in (before, after)]
    force = float(np.sqrt((after.lam**2).sum("axis")).max())
    attitude = float(np.rad2deg(np.arccos(np.clip(1 - after.Psi, -1, 1))).max())
    end = "" if ds.attrs["complete"] else f"{float(ds.time[-1]):.2f} s"
    return f"| `{case}` | {errors[0]:.1f} | {errors[1]:.1f} | {attitude:.2f} | {force:.1f} | {end} |"


def write_small(picture: Image.Image, name: str, pixels: int) -> None:
    """Write a picture with few colors, with at most this width and height."""
    picture = picture.convert("RGB")
    picture.thumbnail((pixels, pixels))
    picture.quantize(64, dither=Image.Dither.NONE).save(HERE / f"{name}.png", optimize=True)


def work_precision(out: Path) -> None:
    """Draw CPU time over error of colift and MuJoCo from the stored benchmark."""
    series = importlib.import_module("benchmarks.status").stored()["work_precision"]["figures"]["series"]
    with style.style_context():
        figure = Figure(figsize=(style.PAGE_WIDTH, 3.4))
        ax = figure.subplots()
        looks = {
            "colift": ("#004488", "o"),
            "RK4": ("#DDAA33", "s"),
            "Euler": ("#BB5566", "^"),
            "implicit": ("#000000", "v"),
        }
        for name, points in series.items():
            color, marker = next(look for part, look in looks.items() if part in name)
            dashes = ":" if "default" in name else "-"
            error, ms = [one["error_m"] for one in points], [1e-3 * one["cpu_us_per_s"] for one in points]
            ax.loglog(error, ms, dashes, color=color, marker=marker, markersize=3, label=name)
        ax.set_xlabel("error of the payload position after 0.5 s [m]")
        ax.set_ylabel("CPU time of a simulated second [ms]")
        ax.grid(alpha=0.3)
        ax.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.01, 0.5))
        style.save_figure(figure, out / "work_precision")
    write_small(Image.open(out / "work_precision.png"), "work_precision", PAGE_PIXELS)


def film(out: Path) -> None:
    """Draw the film of the start page."""
    logs = {case: log.load(flights(out, "study") / f"{case}.nc") for case in ("C1", "C3")}
    drawn = [rendering.render_data(ds, axes.case_label(case, ALL_CASES)) for case, ds in logs.items()]
    rendering.render_video(drawn, HERE / "flight.gif", speed=4.0, dpi=100)


def page(out: Path) -> None:
    """Take a picture of the playback page."""
    browser = importlib.import_module("tests.support.browser")
    logs = {case: log.load(flights(out, "study") / f"{case}.nc") for case in SHOWN}
    with tempfile.TemporaryDirectory() as folder, browser.page(Path(folder) / "profile") as window:
        file = Path(folder) / "playback.html"
        file.write_text(playback.build_page(logs, ALL_CASES), encoding="utf-8")
        window.open(file)
        window.evaluate("document.querySelector('.chip').click(), seek(12)")
        window.wait_until_drawn()
        Image.open(io.BytesIO(window.screenshot())).convert("RGB").save(HERE / "playback.png", optimize=True)


def gallery(_out: Path) -> None:
    """Draw the pictures of the notebook gallery."""
    for path in sorted((ROOT / "docs" / "_build" / "jupyter_execute" / "notebooks").glob("*.ipynb")):
        outputs = [each for cell in json.loads(path.read_text())["cells"] for each in cell.get("outputs", [])]
        images = [each["data"]["image/png"] for each in outputs if "image/png" in each.get("data", {})]
        write_small(Image.open(io.BytesIO(base64.b64decode(images[0]))), f"notebook_{path.stem}", THUMBNAIL)


DRAW: dict[str, Callable[[Path], None]] = {
    **{name: functools.partial(copied, name) for name in COPIED},
    **{name: functools.partial(stored, name) for name in ("campaign", "corollary", "curve")},
    "study_seeds": seeds,
    "work_precision": work_precision,
    "limits": limits,
    "flight": film,
    "playback": page,
    "gallery": gallery,
}

if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    for each in sys.argv[2:] or DRAW:
        print(each, flush=True)
        DRAW[each](Path(sys.argv[1]))
