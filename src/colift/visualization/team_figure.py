"""Figure of a team at its initial state, and of the reference path; without a flight for a scenario."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from colift.models.state import zero_residual
from colift.runtime import run_directory
from colift.scenario import Scenario, controllers, initial_states, termination, trajectories
from colift.scenario import team as team_module
from colift.visualization import rendering, scene, style

FIGURE_FILE = "team"
PATH_POINTS = 400
ARROW_LABELS = {"thrust": "thrust", "contact": "contact force on the payload", "disturbance": "disturbance force"}
"""Names of the arrows in the key; `playback.ARROWS` are those of the page."""


def plot_team(data: rendering.RenderData, values: bool = False) -> Figure:
    """Plot the team at the first row with the names of agents and contacts, and the whole path at scale.

    Args:
        data: Drawing data of a flight, or of a scenario.
        values: True if thrusts and contact forces [N] are written below the names.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(style.PAGE_WIDTH, 3.4))
    near, far = figure.subplots(1, 2)
    rendering.draw(near, data, 0, close=True, names=True, values=values)
    near.set_title("team at its initial state" + ", forces in hover" * values)
    rendering.draw(far, data, 0)
    far.set_title("whole path")
    path = data.camera.project(data.signals["p_d"])
    hidden = {"color": rendering.REFERENCE, "linewidth": 0.6, "alpha": 0.6}  # the part behind bodies
    far.plot(*path.T, **hidden, zorder=6, scalex=False, scaley=False)
    handles, labels = _key(data)
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _key(data: rendering.RenderData) -> tuple[list[Artist], list[str]]:
    """Return handles and labels of the arrows that are drawn, with their scale, and of the lines."""
    forces = {"thrust": "u", "contact": "lam", "disturbance": "disturbance"}
    handles: list[Artist] = []
    labels = []
    for kind, scale in data.arrow_scales.items():
        longest = np.abs(data.signals[forces[kind]][0]).max() / scale
        if longest > scene.MIN_LINK_LENGTH:
            color = rendering.COLORS[kind]
            handles.append(Line2D([], [], color=color, marker=r"$\uparrow$", markersize=9, linestyle="none"))
            labels.append(f"{ARROW_LABELS[kind]}, {scale:g} N per m")
    handles.append(Line2D([], [], color=rendering.REFERENCE, linewidth=0.8))
    labels.append("reference path of the payload")
    handles.append(Line2D([], [], color=rendering.REFERENCE, linewidth=0.7, dashes=(3, 2)))
    labels.append("reference pose at the start")
    handles.append(Line2D([], [], color="#D3D8DD", linewidth=0.8))
    labels.append(f"grid of {rendering.GRID_SPACING:g} m")
    return handles, labels


def write_team_figure(settings: Scenario, out: Path) -> list[Path]:
    """Write the figure of the team of a scenario with the forces in hover, as PDF and PNG.

    Args:
        settings: Scenario.
        out: Folder for the files; it is created.

    Returns:
        Paths of the files.

    Raises:
        ScenarioError: If there is no initial state, or if the allocation is impossible.
        OSError: If the folder cannot be written, or if a file of one of these names was not written by colift.
    """
    data = scenario_data(settings)
    out.mkdir(parents=True, exist_ok=True)
    run_directory.refuse_foreign_files(out / f"{FIGURE_FILE}.{kind}" for kind in ("pdf", "png"))
    run = run_directory.run_id(version("colift"), settings.digest)
    with style.style_context():
        return style.save_figure(plot_team(data, values=True), out / FIGURE_FILE, run)


def scenario_data(settings: Scenario) -> rendering.RenderData:
    """Return the drawing data of a scenario at its initial state, with the forces in hover and the reference path.

    Thrusts and contact forces are those at rest without disturbances, with the allocation of the scenario. Nothing is
    simulated.

    Args:
        settings: Scenario.

    Returns:
        Drawing data with one row.

    Raises:
        ScenarioError: If there is no initial state, or if the allocation is impossible.
    """
    truth, nominal = team_module.team(settings)
    state = initial_states.initial_state(settings, truth, moving=False)
    controller = controllers.make_controller(settings, nominal)
    u, lam = termination.hover_forces(truth, controller, state, zero_residual(truth), jnp.zeros(()))
    reference = trajectories.make_reference(settings)
    times = jnp.linspace(0.0, settings.duration_s, PATH_POINTS)
    path = np.asarray(jax.jit(jax.vmap(lambda t: reference.evaluate(t).p))(times))
    tracks = scene.state_poses(truth, state, trajectories.setpoint(reference, jnp.zeros(())))
    tracks |= {
        "u": np.asarray(u)[None],
        "lam": np.asarray(lam)[None],
        "disturbance": np.zeros((1, 3)),
        "e_p": np.linalg.norm(tracks["p"] - tracks["p_d"], axis=1)[:, None],
    }
    shape = scene.team_geometry(truth, settings)
    return rendering.RenderData(
        case="C1",
        title="",
        t=np.zeros(1),
        signals=tracks | {"p_d": path},
        shape=shape,
        arrow_scales=scene.arrow_scales({"": tracks}, shape["size_m"]),
        ground=scene.ground_height({"": tracks | {"p": path}}),
    )
