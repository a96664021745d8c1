"""Draw the figures of the documentation from a study.

Run ``python docs/figures.py OUT``. OUT is the folder of
``colift study paper --case C1,C2,C3,label_feedback,adaptive,true_residual``. The metrics over seeds are those of
``./dev evidence orderings``.

Two figures are not drawn here. ``reaction.png`` is figure 7 of a study with a change of the wind direction and a
failure of the tip force sensors (docs/learning.md):
``colift study paper --case label_feedback,gp_label_feedback,adaptive --set control.preview_step_s=0.03``.
``outdoors_tracking.png`` is figure 1 of
``colift study outdoors --case C1,C3,label_feedback,adaptive,true_residual``.
"""

import importlib
import shutil
import sys
from pathlib import Path

from colift.closed_loop import log
from colift.scenario import experiment
from colift.visualization import axes, rendering, seed_figures

FROM = {
    "study_tracking": "figure_1_tracking",
    "study_deviation": "figure_3_deviation",
    "study_rho_bar": "figure_5_rho_bar",
}
here, out = Path(__file__).with_name("figures"), Path(sys.argv[1])
for name, figure in FROM.items():
    shutil.copy(out / f"{figure}.png", here / f"{name}.png")
sys.path.insert(0, str(here.parents[1]))
seeds = importlib.import_module("evidence").stored("orderings")["items"]
seed_figures.plot_seed_spread(list(seeds.values()), experiment.ALL_CASES, out / "study_seeds")
shutil.copy(out / "study_seeds.png", here)
drawn = [
    rendering.render_data(log.load(out / f"{case}.nc"), axes.case_label(case, experiment.ALL_CASES))
    for case in ("C1", "C3")
]
rendering.render_video(drawn, here / "flight.gif", speed=4.0, dpi=80)
