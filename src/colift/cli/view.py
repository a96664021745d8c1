"""Commands that show scenarios and results: draw, live, playback, report, compare and browse."""

from __future__ import annotations

import dataclasses
import time
import webbrowser
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from colift.cli import certify, common, tables
from colift.runtime import signals

if TYPE_CHECKING:
    from colift.cli.progress import Report
    from colift.visualization.camera import Camera
    from colift.visualization.rendering import Framing, RenderData

StudyArgument = Annotated[
    Path, typer.Argument(metavar="OUT", help="Folder that `colift study` or `colift run` has written.")
]
ImageOption = Annotated[
    Path | None, typer.Option("--image", metavar="FILE", help="Write an image instead: PNG, PDF or SVG.")
]
TimeOption = Annotated[float, typer.Option("--at", metavar="SECONDS", help="Time of the image in the flight.")]
VideoOption = Annotated[
    Path | None,
    typer.Option("--video", metavar="FILE", help="Write a video instead: GIF, or MP4 (requires ffmpeg)."),
]
SpeedOption = Annotated[
    float, typer.Option("--speed", min=0.1, max=20, help="Speed of the video relative to real time.")
]
PictureCasesOption = Annotated[
    list[str] | None,
    typer.Option(
        "--case",
        help="Case in the image or video; repeatable, or separated by commas; default: C3.",
        autocompletion=common.complete_case,
    ),
]
SizeOption = Annotated[
    str | None,
    typer.Option("--size", metavar="WIDTHxHEIGHT", help="Size of the image or video in pixels, such as 1280x720."),
]
ViewOption = Annotated[
    str,
    typer.Option(
        "--view",
        metavar="VIEW",
        help="Direction of view: oblique, front, side, top, or AZIMUTH,ELEVATION in degrees, such as 30,20.",
    ),
]
FollowOption = Annotated[
    bool | None,
    typer.Option(
        "--follow/--whole",
        help="Follow the payload, or show the whole flight; default: whole if the team fills 40 % of the height.",
        show_default=False,
    ),
]
StartOption = Annotated[
    float, typer.Option("--from", metavar="SECONDS", help="Time in the flight at which the video begins.")
]
EndOption = Annotated[
    float | None,
    typer.Option(
        "--to", metavar="SECONDS", help="Time in the flight at which the video ends; default: end of the flight."
    ),
]


def playback(
    out: StudyArgument,
    open_page: common.OpenOption = False,
    *,
    image: ImageOption = None,
    at: TimeOption = 0.0,
    video: VideoOption = None,
    speed: SpeedOption = 1.0,
    cases: PictureCasesOption = None,
    size: SizeOption = None,
    view: ViewOption = "oblique",
    follow: FollowOption = None,
    start: StartOption = 0.0,
    end: EndOption = None,
) -> None:
    """Write an interactive page that plays back the flights of a study, or an image or a video of them.

    The page is OUT/playback.html and requires no network (docs/playback.md).
    """
    from colift.scenario.cases import ALL_CASES
    from colift.visualization import camera, playback, rendering

    try:
        if image or video:
            framing = rendering.Framing(size=parse_size(size), follow=follow, start=start, end=end)
            requested = common.parse_cases(cases or ["C3"])
            with common.show_progress(f"reading the flights of {out}", announce=False):
                data = _render_data(out, requested, ALL_CASES, camera.parse_view(view))
            with common.show_progress(f"rendering {video or image}", announce=bool(video)) as progress:
                _render(data, image, at, video, speed, framing, progress)
            with common.guard_output():
                print(f"{', '.join(requested)}: {', '.join(str(file) for file in (image, video) if file)}")
            return
        with common.show_progress(f"writing the playback page of {out}", announce=False):
            page = playback.write(out, ALL_CASES)
    except (ValueError, OSError) as error:
        common.fail(error)
    common.print_page(f"the flights are in {page}", page, open_page)


def parse_size(text: str | None) -> tuple[int, int] | None:
    """Return the width and height of a text such as ``1280x720``; None for None.

    Raises:
        ValueError: If the text has another form.
    """
    if text is None:
        return None
    numbers = text.lower().split("x")
    if len(numbers) != 2 or not all(number.isdecimal() for number in numbers):
        raise ValueError(f"--size {text}: must be WIDTHxHEIGHT in pixels, such as 1280x720")
    return int(numbers[0]), int(numbers[1])


def _render_data(out: Path, cases: Sequence[str], titles: Mapping[str, str], direction: Camera) -> list[RenderData]:
    """Return the drawing data of some cases of a folder.

    Args:
        out: Folder of the study.
        cases: Identifiers of the cases.
        titles: Descriptions of all cases.
        direction: Camera of all images.

    Raises:
        ValueError: If the folder holds no log of a case.
    """
    from colift.closed_loop import log
    from colift.visualization import axes, rendering

    _, found = log.load_flights(out, titles)
    if missing := [case for case in cases if case not in found]:
        raise ValueError(f"{out} holds {', '.join(found)}, not {', '.join(missing)}: choose by --case")
    data = [rendering.render_data(found[case], axes.case_label(case, titles)) for case in cases]
    return [dataclasses.replace(each, camera=direction) for each in data]


def _render(
    data: Sequence[RenderData],
    image: Path | None,
    at: float,
    video: Path | None,
    speed: float,
    framing: Framing,
    progress: Report,
) -> None:
    """Write an image, a video or both.

    Args:
        data: Drawing data of each case.
        image: File of the image.
        at: Time of the image [s].
        video: File of the video.
        speed: Speed of the video relative to real time.
        framing: Size, view and time span.
        progress: Function that takes the step and the completed share.
    """
    from colift.visualization import rendering

    if image:
        rendering.render_image(data, at, image, framing)
    if video:
        rendering.render_video(
            data,
            video,
            speed,
            framing=framing,
            progress=lambda done, total: progress(f"frame {done + 1} of {total}", done / total),
        )


def live(
    name: common.ScenarioArgument,
    case: common.CaseOption = "C3",
    overrides: common.OverridesOption = None,
    duration: common.DurationOption = None,
    seed: common.SeedOption = None,
    open_page: common.OpenOption = False,
) -> None:
    """Simulate one case and show it in a browser while it runs, until Ctrl-C.

    The page is available on this computer only. No file is written; use ``colift run`` to keep a flight.
    """
    from colift import codegen, scenario
    from colift.scenario import experiment
    from colift.scenario.cases import ALL_CASES
    from colift.visualization import live_view

    case = common.parse_case(case)

    def ready(address: str) -> None:
        with common.guard_output():
            print(f"{case} of {settings.name}: {address} (Ctrl-C ends it)", flush=True)
        if open_page:
            webbrowser.open(address)

    signals.raise_if_interrupted()
    try:
        settings = common.load_settings(name, overrides, duration, seed)
        with live_view.serve_live_flight(
            settings, experiment.make_experiment(settings, case), case, ALL_CASES[case], ready
        ) as flight:
            reason = f": {flight.termination_reason}" if flight.termination_reason else ""
            with common.guard_output():
                print(f"the flight has ended{reason}", flush=True)
            while True:  # the page stays available
                signals.raise_if_interrupted()
                time.sleep(0.1)
    except (scenario.ScenarioError, codegen.CompilerError, OSError) as error:
        common.fail(error)


def report(out: StudyArgument, open_page: common.OpenOption = False) -> None:
    """Write a report of a study on one page.

    The page is OUT/report.html and requires no network. It contains the settings, warnings, tables, figures, playback
    and, where it exists, the certificate (docs/playback.md).
    """
    from colift.scenario.cases import ALL_CASES
    from colift.visualization.report import write_report

    try:
        with common.show_progress(f"writing the report of {out}", announce=False):
            page = write_report(
                out,
                ALL_CASES,
                tables.study_table,
                lambda summary: (
                    tables.certificate_table(summary),
                    certify.certificate_notes(summary),
                    tables.CERTIFICATE_COLUMNS,
                ),
            )
    except (ValueError, OSError) as error:
        common.fail(error)
    common.print_page(f"the report is {page}", page, open_page)


def compare(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="OUT...", help="Folders that `colift study` or `colift run` has written; two or more."),
    ],
    cases: Annotated[
        list[str] | None,
        typer.Option(
            "--case",
            help="Case to compare; repeatable, or separated by commas; default: all.",
            autocompletion=common.complete_case,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for page and figure; default: out/SCENARIO-comparison.")
    ] = None,
    open_page: common.OpenOption = False,
) -> None:
    """Compare the runs of several folders on one page and in one figure.

    The page contains the metrics of every case with their ratios to the first folder, the tracking errors over time,
    and the settings that differ. It requires no network.
    """
    from colift.analysis import comparison
    from colift.scenario.cases import ALL_CASES
    from colift.visualization import comparison_page

    required = common.parse_cases(cases or ())
    try:
        with common.show_progress(f"comparing {len(folders)} folders", announce=False):
            runs = comparison.load_runs(folders, required or tuple(ALL_CASES), required)
            target = common.results_folder(out, suffix="-comparison")(runs[0].settings)
            page, figure, _ = comparison_page.write_comparison(runs, target, ALL_CASES)
    except (ValueError, OSError) as error:
        common.fail(error)
    found = comparison.compare_cases(runs)
    lines = comparison.describe_differences(comparison.differing_settings(runs), runs[0].name)
    with common.guard_output(f"; the comparison is {page}"):
        tables.print_table(tables.comparison_table(found), num_repeated=2)
        common.print_wrapped([comparison.describe_reference(runs), *lines], 2)
    common.print_page(f"the comparison is {page}, the figure {figure}", page, open_page)


def browse(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder below which runs are searched.")] = Path(
        "out"
    ),
    open_page: common.OpenOption = False,
) -> None:
    """Write an index page of all runs below a folder.

    The page is FOLDER/index.html: a table that can be sorted and filtered, with links to reports and playbacks. It
    requires no network. A damaged run has a row with the reason.
    """
    from colift.scenario.cases import ALL_CASES
    from colift.visualization import index_page

    try:
        with common.show_progress(f"searching {folder}", announce=False):
            page, runs = index_page.write_index(folder, ALL_CASES)
    except (ValueError, OSError) as error:
        common.fail(error)
    damaged = sum(bool(run.damage) for run in runs)
    note = f", {damaged} of them damaged" if damaged else ""
    common.print_page(f"the index of {len(runs)} run{'s' * (len(runs) != 1)}{note} is {page}", page, open_page)


def draw(
    name: common.ScenarioArgument,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for the figure; default: out/SCENARIO-team, with the options given."),
    ] = None,
    overrides: common.OverridesOption = None,
    duration: common.DurationOption = None,
) -> None:
    """Draw the team of a scenario at its initial state, without a simulation.

    The figure shows the names of agents and contacts, the reference path, and thrusts and contact forces in hover
    without disturbances. It is written as PDF and PNG.
    """
    from colift import scenario
    from colift.visualization import team_figure

    try:
        settings = common.load_settings(name, overrides, duration)
        folder = common.results_folder(out, overrides, duration, suffix="-team")(settings)
        with common.show_progress(f"drawing {settings.name}", announce=False):
            files = team_figure.write_team_figure(settings, folder)
    except (scenario.ScenarioError, OSError) as error:
        common.fail(error)
    with common.guard_output():
        print(f"the team is drawn in {' and '.join(str(file) for file in files)}")
