"""Bounds of one flight's errors: fly a scenario in which every assumption holds, and set the radii beside the errors.

`colift certify certified` prints the same and more. Run it with `python examples/08_certify_a_flight.py`; it takes a
minute or two.
"""

from __future__ import annotations

import colift
from colift.workflows import certification


def main() -> None:
    """Print the radius of every error of the flown path, what was observed, and what the radii rest on."""
    made = certification.certify(colift.load_scenario("certified"), names=("energy", "recovery"))
    found = made.certificate
    first, last = found.window
    for bound, radii in found.ultimate_bounds.items():
        for error, radius in radii.a_posteriori.items():
            seen = found.observed[error]
            print(f"{bound:>8}, {error:>7}: at most {radius:.3g}, observed {seen:.3g} from {first:.0f} to {last:.0f} s")
        print(f"{'':>8}  assumed: {', '.join(radii.assumptions)}")
    if found.violations:
        raise SystemExit(f"above their radius: {', '.join(sorted({each.error for each in found.violations}))}")


if __name__ == "__main__":
    main()
