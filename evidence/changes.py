"""What a change of the world does to memory, reflex and both: the table of docs/learning.md, second by second."""

from __future__ import annotations

from typing import Any

from colift import analyse, scenario, simulate, study
from evidence import collect

LOST = "sensors.then=[{{kind: intermittent, of: [agents.lam], rate_Hz: 500, until_s: {}}}]"
TURN = "disturbances.{}.turn={{angle_deg: 180, start_s: 13}}"
WIND = (TURN.format(0), TURN.format(4))
AHEAD = "control.look_ahead_s=0.03"
MOTORS = (
    "actuators={kind: motors, bandwidth_Hz: 8, delay_s: 0.006}",
    "nominal.actuators={bandwidth_Hz: 8, delay_s: 0.006}",
)
WORLDS: dict[str, tuple[str, tuple[str, ...], float]] = {  # scenario, changes, s from which errors count
    "home": ("paper", (), 10.0),
    "motors": ("paper", MOTORS, 10.0),
    "wind": ("paper", WIND, 14.0),
    "mass": ("payload_added", (), 16.0),
    "path": ("path_leaves", (), 11.0),
    "lost": ("labels_lost", (), 13.0),
    "wind lost": ("paper", (*WIND, LOST.format(16)), 17.0),
    "mass lost": ("payload_added", (LOST.format(17),), 17.0),
    "outdoors": ("outdoors", (), 14.0),
}
CASES = ("C1", "C3", "R", "F", "H", "C4", "O")


def fly(item: str) -> dict[str, Any]:
    """e_p by the second and over what counts, m; how many newtons of forces are above 20 Hz; what went wrong."""
    world, case = item.split(": ")
    name, changes, late = WORLDS[world]
    flight = simulate.fly_plan(study.plan(scenario.load(name, [AHEAD, *changes]), case))
    rows = flight.rows
    seconds = range(int(rows.t[-1]) + 1)
    by = [analyse.norm_rms(rows.e_p[(rows.t >= k) & (rows.t < k + 1)]) for k in seconds]
    return {
        "e_p_rms_m": analyse.norm_rms(rows.e_p[rows.t >= late]) if rows.t[-1] > late else None,
        "by_second_m": by,
        "chatter_N": analyse.chatter(analyse.second_half(rows)),
        "stopped": flight.stopped,
        "changed_s": [update.t for update in flight.updates if update.changed],
    }


def main() -> bool:
    """Print the table; nowhere is C4 lost, and nowhere twice as far off as the better of memory and reflex."""
    found = collect("changes", [f"{world}: {case}" for world in WORLDS for case in CASES], fly)
    print(f"{'e_p [mm]':12}" + "".join(f"{case:>8}" for case in CASES))
    good = True
    for world in WORLDS:
        each = {case: found[f"{world}: {case}"] for case in CASES}
        e = {case: None if one["stopped"] else one["e_p_rms_m"] for case, one in each.items()}
        print(f"{world:12}" + "".join(f"{'ended' if x is None else f'{1e3 * x:.1f}':>8}" for x in e.values()))
        parts = [x for x in (e["C3"], e["F"]) if x is not None]
        good &= e["C4"] is not None and e["C4"] <= 2 * min(parts)
    return good


if __name__ == "__main__":
    main()
