"""Python API: experiments of a scenario, their simulated flights, and studies, with displays for notebooks.

The names of this module are importable from `colift`. They combine the layers below and add no computation.

Example:
    ::

        import colift

        scenario = colift.load_scenario("paper", overrides={"seed": 3})
        experiment = colift.make_experiment(scenario, case="C3")
        flight = colift.run_experiment(experiment, progress=True)
        print(flight.metrics["e_p_rms_m"])
        flight.plot().savefig("tracking.png")
"""

from __future__ import annotations

import dataclasses
import functools
import html
import json
import webbrowser
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import xarray as xr

from colift.analysis import feasibility
from colift.closed_loop import batch as closed_loop_batch
from colift.closed_loop import flight as closed_loop_flight
from colift.closed_loop import log, part_checks
from colift.closed_loop.flight import FlightResult
from colift.closed_loop.simulator import WorldT
from colift.runtime import atomic_write
from colift.scenario import Scenario, experiment, loading
from colift.scenario.cases import ALL_CASES, PAPER_CASES, case_id
from colift.workflows import study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")
MAX_LINES = 30
"""Largest number of lines of a table in a notebook."""


@dataclasses.dataclass(frozen=True)
class Experiment(closed_loop_flight.Experiment[WorldT]):
    """Definition of one flight, and the scenario and case from which it was made.

    Attributes:
        scenario: Scenario of the experiment.
        case: Identifier of the case, such as ``C3``.
    """

    scenario: Scenario = dataclasses.field(kw_only=True, repr=False)
    case: str = dataclasses.field(kw_only=True)

    def __repr__(self) -> str:
        return f"Experiment({self.scenario.name!r}, case={self.case!r}, duration={self.duration:g}, seed={self.seed})"

    def _repr_html_(self) -> str:
        rows = {
            "scenario": self.scenario.name,
            "case": f"{self.case} ({ALL_CASES[self.case]})",
            "agents": ", ".join(self.agent_names),
            "duration": f"{self.duration:g} s",
            "control period": f"{self.dt:g} s",
            "model updates": ", ".join(f"{t:g} s" for t in self.update_times) or "none",
            "seed": str(self.seed),
        }
        return _table(rows, "Experiment")


class Metrics(dict[str, Any]):
    """Metrics of a flight by name, as in `summary.json`; a table in notebooks."""

    def _repr_html_(self) -> str:
        return _table({name: _shorten(value) for name, value in self.items()}, "Metrics")


@dataclasses.dataclass(frozen=True)
class Flight(FlightResult):
    """Result of a simulated flight, with its log, metrics, figure and playback.

    Attributes:
        experiment: Experiment of the flight.
    """

    experiment: Experiment = dataclasses.field(kw_only=True, repr=False)

    @functools.cached_property
    def dataset(self) -> xr.Dataset:
        """Log of the flight, in which every signal has axes, unit, frame and long name."""
        return study.flight_dataset(self.experiment.scenario, self.experiment.case, self, self.experiment)

    @functools.cached_property
    def metrics(self) -> Metrics:
        """Metrics over the second half of the flight, as in `summary.json` except for the computation times."""
        return Metrics(study.flight_metrics(self.experiment.scenario, self, self.experiment, self.dataset))

    def save(self, path: str | Path) -> None:
        """Write the log as NetCDF.

        Args:
            path: File to write; replaced atomically.

        Raises:
            OSError: If the file cannot be written.
        """
        log.save(self.dataset, Path(path))

    def plot(self) -> Figure:
        """Plot the norm of the position error and the attitude error function over time.

        Returns:
            A Matplotlib figure; a notebook shows it.
        """
        from colift.visualization import study_figures, style

        with style.style_context():
            return study_figures.plot_tracking_error({self.experiment.case: self.dataset}, ALL_CASES)

    def show(self, path: str | Path = "playback.html") -> Path:
        """Write the playback page and open it in a browser.

        Args:
            path: HTML file to write; it needs no network.

        Returns:
            Path of the file.

        Raises:
            OSError: If the file cannot be written.
        """
        from colift.visualization import playback

        file = Path(path).resolve()
        atomic_write.write_atomic(file, playback.build_page({self.experiment.case: self.dataset}, ALL_CASES).encode())
        webbrowser.open(file.as_uri())
        return file

    def __repr__(self) -> str:
        end = self.termination_reason or "complete"
        return f"Flight({self.experiment!r}, {end}, {len(self.records.t)} ticks, {len(self.updates)} model updates)"

    def _repr_html_(self) -> str:
        case = self.experiment.case
        rows = {
            "scenario, case": f"{self.experiment.scenario.name}, {case} ({ALL_CASES[case]})",
            "end": self.termination_reason or f"complete, {self.records.t[-1]:g} s",
            "model updates": str(len(self.updates)),
            "RMS position error": f"{1e3 * self.metrics['e_p_rms_m']:.3g} mm",
            "RMS attitude error": f"{1e3 * self.metrics['e_R_rms']:.3g} mrad",
            "warnings": "; ".join(self.learning_warnings) or "none",
        }
        return _table(rows, "Flight")


@dataclasses.dataclass(frozen=True)
class Study:
    """Results of a study.

    Attributes:
        path: Directory of the results.
        summary: Content of `summary.json`.
        datasets: Log of each case.
    """

    path: Path
    summary: Mapping[str, Any]
    datasets: Mapping[str, xr.Dataset] = dataclasses.field(repr=False)

    def _repr_html_(self) -> str:
        rows = {
            f"{case} ({ALL_CASES[case]})": (
                f"position {1e3 * found['e_p_rms_m']:.3g} mm, attitude {1e3 * found['e_R_rms']:.3g} mrad (RMS)"
                + ("" if found["complete"] else "; incomplete")
            )
            for case, found in self.summary["cases"].items()
        }
        return _table({"results": str(self.path), **rows}, "Study")


def load_scenario(name_or_path: str | Path, overrides: Mapping[str, Any] | Sequence[str] = ()) -> Scenario:
    """Load a shipped scenario by name, or a YAML file by path.

    Args:
        name_or_path: Name of a shipped scenario, or path of a YAML file.
        overrides: Settings that replace those of the file, as ``{"payload.mass_kg": 2}`` or ``["payload.mass_kg=2"]``.

    Returns:
        The validated settings.

    Raises:
        ScenarioError: If the file cannot be read or a setting is not valid; one line for each error.

    Example:
        ::

            scenario = colift.load_scenario("paper", overrides={"seed": 3})
    """
    if isinstance(overrides, Mapping):
        overrides = [f"{path}={json.dumps(value)}" for path, value in overrides.items()]
    return loading.load_scenario(name_or_path, overrides)


def make_experiment(scenario: Scenario, case: str = "C3") -> Experiment:
    """Make the experiment of one case of a scenario.

    Args:
        scenario: Scenario.
        case: Identifier of the case in any capitalization; see `colift.scenario.cases.ALL_CASES`.

    Returns:
        World, controller, initial state and clock as one immutable value. `dataclasses.replace` changes a part.

    Raises:
        KeyError: If there is no such case.
        ScenarioError: If the team cannot hold the payload or hover, or if a user-defined part does not fit its
            interface.
    """
    name = case_id(case)
    return _extend(Experiment, experiment.make_experiment(scenario, name), scenario=scenario, case=name)


def run_experiment(
    experiment: Experiment,
    progress: bool | Callable[[float], None] = False,
    duration: float | None = None,
    record_path: str | Path | None = None,
) -> Flight:
    """Simulate the flight of an experiment.

    Args:
        experiment: Experiment from `make_experiment`.
        progress: Whether to show a progress bar with the time left, or a function called with the simulated time [s].
        duration: Duration [s], if it differs from the experiment's.
        record_path: File to which the records are written during the flight. If the process is killed,
            `colift.closed_loop.record_file.read_records` reads the records until then.

    Returns:
        The flight. A flight that violated a termination limit states the reason in `termination_reason`.

    Raises:
        PartError: If a part of the controller does not fit its interface.
    """
    if duration is not None:
        experiment = dataclasses.replace(experiment, duration=float(duration))
    part_checks.check_parts(experiment)
    with _progress(progress, experiment.case, experiment.duration) as report:
        path = None if record_path is None else Path(record_path)
        result = closed_loop_flight.run_experiment(experiment, report, record_path=path)
    return _extend(Flight, result, experiment=experiment)


def run_batch(experiments: Sequence[Experiment], progress: bool = False) -> tuple[Flight, ...]:
    """Simulate several experiments; those of one structure advance together in the lanes of a vector.

    Records agree with those of `run_experiment` to rounding. The flights keep their models without factors.

    Args:
        experiments: Experiments from `make_experiment`.
        progress: Whether to show a progress bar.

    Returns:
        The flights in the order of the experiments.

    Raises:
        PartError: If a part of a controller does not fit its interface.
    """
    for each in experiments:
        part_checks.check_parts(each)
    with _progress(progress, "batch", sum(each.duration for each in experiments)) as report:
        results = dict(closed_loop_batch.run_batch(experiments, report))
    return tuple(_extend(Flight, results[k], experiment=each) for k, each in enumerate(experiments))


def run_study(
    scenario: Scenario,
    cases: Sequence[str] = tuple(PAPER_CASES),
    out: str | Path | None = None,
    progress: bool | Callable[[float], None] = False,
    replace: bool = False,
) -> Study:
    """Simulate cases of a scenario, and write logs, figures, tables and `summary.json`.

    Cases that the directory already contains are kept if all settings are equal.

    Args:
        scenario: Scenario.
        cases: Identifiers of the cases in any capitalization.
        out: Directory of the results; by default `out/SCENARIO`.
        progress: Whether to show a progress bar for each case.
        replace: Whether to remove earlier results from the directory.

    Returns:
        The results, also read back from `out`.

    Raises:
        KeyError: If there is no such case.
        ScenarioError: If the team cannot hold the payload or hover.
        OSError: If the directory cannot be written, is in use, or contains results of another run.
    """
    names = [case_id(case) for case in cases]
    experiments = experiment.make_experiments(scenario, names)
    preview = feasibility.assess_feasibility(scenario, experiments)
    folder = Path(out) if out is not None else Path("out") / scenario.name
    shown: dict[str, Any] = {}
    with (
        study.open_run_directory(scenario, folder, replace) as directory,
        _study_progress(progress, experiments) as report,
    ):
        shown = study.run_study(scenario, directory, experiments, preview, report)
    _, datasets = log.load_flights(folder, tuple(shown["cases"]))
    return Study(path=folder, summary=shown, datasets=datasets)


def _extend(kind: type[T], value: Any, **more: Any) -> T:
    """Return a value of a dataclass that extends the dataclass of another value by some fields."""
    inherited = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    return kind(**inherited, **more)


@contextmanager
def _progress(
    progress: bool | Callable[[float], None], title: str, duration: float
) -> Generator[Callable[[float], None], None, None]:
    """Yield the function that reports the simulated time."""
    if callable(progress):
        yield progress
    elif progress:
        with _bar() as bar:
            task = bar.add_task(title, total=duration)
            yield lambda t: bar.update(task, completed=t)
    else:
        yield lambda _t: None


@contextmanager
def _study_progress(
    progress: bool | Callable[[float], None], experiments: Mapping[str, closed_loop_flight.Experiment]
) -> Generator[Callable[[str, float], None], None, None]:
    """Yield the function that reports case and simulated time."""
    if callable(progress):
        yield lambda _case, t: progress(t)
    elif progress:
        with _bar() as bar:
            tasks = {case: bar.add_task(case, total=each.duration) for case, each in experiments.items()}
            yield lambda case, t: bar.update(tasks[case], completed=t)
    else:
        yield lambda _case, _t: None


def _bar() -> Any:
    """Return a progress bar with the time left, for terminals and notebooks."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    return Progress(TextColumn("{task.description}"), BarColumn(), "{task.completed:.1f} s", TimeRemainingColumn())


def _shorten(value: Any) -> str:
    """Return a value as short text."""
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _table(rows: Mapping[str, str], caption: str) -> str:
    """Return an HTML table of at most `MAX_LINES` lines."""
    shown = list(rows.items())[: MAX_LINES - 3]
    lines = [f"<tr><th style='text-align:left'>{html.escape(k)}</th><td>{html.escape(v)}</td></tr>" for k, v in shown]
    if len(rows) > len(shown):
        lines.append(f"<tr><td colspan=2>and {len(rows) - len(shown)} more</td></tr>")
    return "\n".join([f"<table><caption>{html.escape(caption)}</caption>", *lines, "</table>"])
