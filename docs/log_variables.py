"""Rewrites the tables of log_variables.md from the specifications; run it after changing a variable of the log."""

from collections.abc import Mapping
from pathlib import Path

from colift.closed_loop import log_signals
from colift.closed_loop.log_signals import SignalSpec

PAGE = Path(__file__).with_name("log_variables.md")
MARK = "<!-- variables -->\n"


def table(specs: Mapping[str, SignalSpec], time: str) -> str:
    """Return the table of the variables on one time axis."""
    rows = ["| variable | dimensions | unit | frame | meaning |", "|---|---|---|---|---|"]
    for name, spec in specs.items():
        dims = ", ".join((time, *spec.dims))
        meaning = spec.long_name.replace("|", r"\|")
        rows.append(f"| `{name}` | {dims} | {spec.units} | {spec.frame} | {meaning} |")
    return "\n".join(rows)


def tables() -> str:
    """Return the generated part of the page."""
    return "\n".join(
        (
            "## Signals of each control period\n",
            table(log_signals.SIGNALS, "time"),
            "\n## Uncertainty signals\n",
            "They are computed every 0.1 s, or every control period if that is longer.\n",
            table(log_signals.UNCERTAINTY_SIGNALS, "time_sigma"),
            "",
        )
    )


if __name__ == "__main__":
    head, mark, _ = PAGE.read_text(encoding="utf-8").partition(MARK)
    PAGE.write_text(head + mark + "\n" + tables(), encoding="utf-8")
