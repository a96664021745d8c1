"""Log of a flight: labelled signals with units, read by xarray.

`colift study` writes such a log for every case, for example `out/paper/C3.nc`. Run the example with
`python examples/07_read_a_log.py`.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import numpy as np

import colift
from colift.closed_loop import log

PLATE = Path(__file__).with_name("plate.yaml")


def main() -> None:
    """Simulate, save and read a flight; print the tracking error, the contact forces and the predictive uncertainty."""
    experiment = colift.make_experiment(colift.load_scenario(PLATE), "C3")
    flight = colift.run_experiment(dataclasses.replace(experiment, duration=2.0, update_times=(1.0,)))
    with tempfile.TemporaryDirectory() as folder:
        flight.save(Path(folder) / "C3.nc")
        ds = log.load(Path(folder) / "C3.nc")
    print(f"{ds.attrs['scenario']}, {ds.attrs['case']}: {len(ds.data_vars)} signals, {ds.sizes['time']} ticks")
    late = ds.sel(time=slice(1.5, None))
    distance = np.sqrt((late.e_p**2).sum("axis")).mean()
    print(
        f"{ds.e_p.attrs['long_name']}, {ds.e_p.attrs['frame']} frame: mean {1e3 * float(distance):.1f} mm after 1.5 s"
    )
    for contact in ds.contact.values:
        share = late.lam.sel(contact=contact, axis="z").mean()
        print(f"{contact} supports {float(share):.2f} {ds.lam.attrs['units']} of the payload's weight")
    before, after = (float(ds.sigma_L_force.sel(time_sigma=t, method="nearest")) for t in (0.5, 1.5))
    print(f"sigma_L, force: {before:.2f} {ds.sigma_L_force.attrs['units']} before the update, {after:.2f} after it")


if __name__ == "__main__":
    main()
