"""Error bounds of one flight in a scenario in which every assumption holds, compared with the observed errors.

`colift certify certified` prints the same and more. Run it with `python examples/08_certify_a_flight.py`; it takes one
to two minutes.
"""

from __future__ import annotations

import colift
from colift.workflows import certification


def main() -> None:
    """Print the bound of every error, the observed error, and the assumptions of the bounds."""
    result = certification.certify(colift.load_scenario("certified"), names=("energy", "recovery"))
    certificate = result.certificate
    start, end = certificate.window
    print(f"errors observed from {start:.0f} to {end:.0f} s")
    for method, bounds in certificate.ultimate_bounds.items():
        for error, bound in bounds.a_posteriori.items():
            observed = certificate.observed[error]
            print(f"{method:>8}, {error:>7}: at most {bound:.3g}, observed {observed:.3g}")
        print(f"{'':>8}  assumed: {', '.join(bounds.assumptions)}")
    if certificate.violations:
        raise SystemExit(f"above their bound: {', '.join(sorted({each.error for each in certificate.violations}))}")


if __name__ == "__main__":
    main()
