"""Draws the documentation's figures of the study: `python docs/figures.py OUT`, OUT of `study paper --baselines`.

The spread over seeds is that of `./dev evidence orderings`. `reaction.png` is figure 7 of another study: `study paper
--cases F,H,C4 --set control.look_ahead_s=0.03`, with a `turn` of the wind and the tips' `until_s` as docs/learning.md
says.
"""

import json
import shutil
import sys
from pathlib import Path

from colift import picture, scene, spread, study

FROM = {
    "team": "figure_0_team",
    "study_tracking": "figure_1_tracking",
    "study_deviation": "figure_3_deviation",
    "study_rho_bar": "figure_5_rho_bar",
}
here, out, told = Path(__file__).with_name("figures"), Path(sys.argv[1]), study.CASES | study.BASELINES
for name, figure in FROM.items():
    shutil.copy(out / f"{figure}.png", here / f"{name}.png")
seeds = json.loads((here.parents[1] / "evidence" / "results" / "orderings.json").read_text())["items"]
spread.spread(list(seeds.values()), told, here / "study_seeds")
flown = scene.load(out, ("C1", "C3"))
drawn = [picture.sketch(ds, f"{case}: {told[case]}") for case, ds in flown.items()]
picture.film(drawn, here / "flight.gif", speed=4.0, dots=80)
