"""Tests of the log: every signal has its name, axes and unit, and files are written completely or not at all."""

import csv
import dataclasses
import io
import os
import re
import resource
import signal
import struct
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from scipy.linalg import sqrtm

from colift.closed_loop import log, log_checks, log_signals
from colift.runtime import atomic_write
from tests.support import random_logs as flights

DIMENSIONS = {"time": "time", "agents": "agent", "joints": "joint", "contacts": "contact", "eta": "eta_index"}
LABELLED = {"3": {"axis", "body_axis"}, "6": {"component"}}
UNITS = {"m", "m/s", "m/s^2", "rad", "rad/s", "rad/s^2", "N", "N m", "1", "1/kg"}
PRISMATIC = {name for name in log_signals.SPECS if name.endswith("_prismatic")}


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def names(folder):
    """Return the names of all files in a folder, including hidden ones."""
    return sorted(path.name for path in folder.iterdir())


def logged(rng, shape):
    """A random flight, and the records and uncertainty that it was made of."""
    rows, sigma = flights.rows(rng, shape), flights.sigma(rng, shape)
    return rows, sigma, log.dataset(rows, team=shape.team, sigma=sigma, attrs={}, **shape.names)


def record(ds, name):
    """A signal as the records hold it: wrenches of six numbers, all joints on one axis."""
    if log_signals.has_parts(name):
        return log.stack_parts(ds, name)
    return log.all_joints(ds, name) if f"{name}_prismatic" in PRISMATIC else ds[name]


@pytest.mark.parametrize("shape", [flights.PAPER, flights.MIXED])
def test_every_record_field_is_a_variable_with_its_axes(rng, shape):
    """Every field of a record is a variable on the axes that its annotation states."""
    rows, _, ds = logged(rng, shape)
    assert set(ds.data_vars) == set(log_signals.SPECS) - (PRISMATIC if shape is flights.PAPER else set())
    np.testing.assert_array_equal(ds.time, rows.t)
    for name in {field.name for field in dataclasses.fields(rows)} - {"t"}:
        np.testing.assert_array_equal(record(ds, name), getattr(rows, name))
        for dim, stated in zip(record(ds, name).dims, flights.field_axes(name), strict=True):
            assert dim == DIMENSIONS.get(stated) or dim in LABELLED[stated], name


@pytest.mark.parametrize("shape", [flights.PAPER, flights.MIXED])
def test_every_variable_has_unit_frame_and_symbol(rng, shape, tmp_path):
    """In memory and in the file."""
    log.save(flights.dataset(rng, shape), tmp_path / "C3.nc")
    for ds in (flights.dataset(rng, shape), log.load(tmp_path / "C3.nc")):
        for name, variable in ds.data_vars.items():
            assert variable.attrs["units"] in UNITS, name
            assert variable.attrs["frame"], name
            assert variable.attrs["long_name"], name
        for dim in ("time", "time_sigma"):
            assert (ds[dim].attrs["units"], ds[dim].attrs["axis"]) == ("s", "T")
        assert ds.attrs["Conventions"] == "CF-1.11"
        assert {"title", "source", "history"} <= set(ds.attrs)


def test_rates_have_consistent_units(rng):
    ds = flights.dataset(rng)
    for name, rate in (("p", "v"), ("x", "v_agent"), ("Phi", "Phi_dot")):
        assert ds[rate].attrs["units"] == ds[name].attrs["units"] + "/s"
    names = ("f_L_force", "f_L_hat_force"), ("f_x", "sigma_f_x"), ("f_r", "sigma_f_r"), ("lam", "lam_hat")
    for exact, predicted in names:
        assert ds[exact].attrs["units"] == ds[predicted].attrs["units"]
        assert ds[exact].attrs["frame"] == ds[predicted].attrs["frame"]


def test_coordinate_labels_select_the_right_value(rng):
    rows, sigma, ds = logged(rng, flights.MIXED)
    assert ds.lam.sel(contact="agent3/arm1", axis="z")[4] == rows.lam[4, 6, 2]
    assert ds.r.sel(joint="agent1/joint2")[3] == rows.r[3, 5]
    assert ds.R.sel(agent="agent2", axis="x", body_axis="z")[5] == rows.R[5, 2, 0, 2]
    assert ds.W_d_moment.sel(axis="y")[0] == rows.W_d[0, 4]
    assert ds.alpha_L.sel(axis="z")[1] == rows.a_L[1, 5]
    assert ds.sigma_f_r_prismatic.sel(prismatic_joint="agent3/joint1")[2] == sigma.agent_std[2][2, 0, 7]
    assert ds.sigma_f_w.sel(agent="agent1", axis="y")[2] == sigma.agent_std[0][2, 1, 4]
    assert ds.rho_f_r.sel(joint="agent3/joint3")[2] == sigma.agent_radius[2][2, 0, 9]
    assert ds.rho_f_L_moment.sel(axis="x")[3] == sigma.payload_radius[3, 3]


def test_sigma_norms_are_frobenius_norms(rng):
    """Sigma norms are Frobenius norms of the root of the covariance, and rho_bar is that of each body."""
    _, sigma, ds = logged(rng, flights.MIXED)

    def norm(deviation):
        return np.linalg.norm(sqrtm(np.diag(deviation**2)), "fro")

    for k in range(len(sigma.t)):
        each = [group[k, j] for group in sigma.agent_std for j in range(group.shape[1])]
        for part, of in (("", slice(None)), ("_force", slice(3)), ("_moment", slice(3, None))):
            np.testing.assert_allclose(ds[f"sigma_L{part}"][k], norm(sigma.payload_std[k, of]), rtol=1e-12)
            np.testing.assert_allclose(ds[f"sigma_A{part}"][k], sum(norm(x[of]) for x in each), rtol=1e-12)
        for part, of in (("", slice(None)), ("_force", slice(3)), ("_moment", slice(3, None))):
            radii = [group[k, j, of] for group in sigma.agent_radius for j in range(group.shape[1])]
            np.testing.assert_allclose(
                ds[f"rho_bar_L{part}"][k] ** 2, sum(sigma.payload_radius[k, of] ** 2), rtol=1e-12
            )
            np.testing.assert_allclose(ds[f"rho_bar_j{part}"][k] ** 2, [sum(x * x) for x in radii], rtol=1e-12)
    # the plain norm over all parts of a body is between the largest part and their sum
    assert (ds.sigma_A <= ds.sigma_A_force + ds.sigma_A_moment + 1e-12).all()
    assert (ds.sigma_A >= np.maximum(ds.sigma_A_force, ds.sigma_A_moment) - 1e-12).all()


def test_predictive_std_without_tip_readings(rng):
    """Force variances of agents are added in periods without tip force readings."""
    rows, sigma, _ = logged(rng, flights.MIXED)
    given = [
        flights.rows(np.random.default_rng(0), flights.MIXED, label_valid=np.full(len(rows.t), x)) for x in (1.0, 0.0)
    ]
    measured, missing = (log.predictive_std(each, sigma) for each in given)
    np.testing.assert_array_equal(measured[1], missing[1])
    for k in range(len(sigma.t)):
        added = sum(sigma.force_errors_to_payload[k, :, j] @ missing[1][k, j] ** 2 for j in range(missing[1].shape[1]))
        np.testing.assert_allclose(missing[0][k] ** 2, measured[0][k] ** 2 + added, rtol=1e-12)


@pytest.mark.parametrize("shape", [flights.PAPER, flights.MIXED, flights.PAPER._replace(time=1, eta=0)])
def test_file_round_trip_is_bit_exact(rng, shape, tmp_path):
    ds = flights.dataset(rng, shape, update_times_s=[], version="0.1.0", complete=0)
    ds.lam[0, 0, 0] = np.nan  # a run that stopped
    ds.lam[0, 0, 1] = -np.inf
    log.save(ds, tmp_path / "C3.nc")
    again = log.load(tmp_path / "C3.nc")
    xr.testing.assert_identical(again.drop_attrs(deep=False), ds.drop_attrs(deep=False))
    assert again.thrust_saturated.dtype == bool
    assert again.attrs.keys() == ds.attrs.keys()
    for name, value in ds.attrs.items():
        np.testing.assert_array_equal(again.attrs[name], value)
    assert names(tmp_path) == ["C3.nc"]


def test_file_is_readable_by_other_libraries(rng, tmp_path):
    ds = flights.dataset(rng)
    log.save(ds, tmp_path / "C3.nc")
    with xr.open_dataset(tmp_path / "C3.nc") as plain:  # no options: times must not turn into dates
        np.testing.assert_array_equal(plain.time, ds.time)
        np.testing.assert_array_equal(plain.lam, ds.lam)
    with h5py.File(tmp_path / "C3.nc") as file:
        assert file["lam"].attrs["units"] == "N"
        assert file["lam"].compression == "gzip"
        assert [label.decode() for label in file["contact"]] == flights.PAPER.names["contacts"]


@pytest.mark.parametrize("wrong", ["agents", "joints", "contacts"])
def test_inconsistent_names_are_refused(rng, wrong):
    shape = flights.PAPER
    names_given = shape.names
    names_given[wrong] = names_given[wrong][:-1]
    rows, sigma = flights.rows(rng, shape), flights.sigma(rng, shape)
    with pytest.raises(ValueError, match=wrong[:-1]):
        log.dataset(rows, team=shape.team, sigma=sigma, attrs={}, **names_given)


def test_unwritable_folder_gives_one_line(rng, tmp_path):
    ds = flights.dataset(rng)
    (tmp_path / "file").write_text("")
    for folder, reason in (("missing", "No such file or directory"), ("file", "Not a directory")):
        with pytest.raises(OSError, match=reason) as caught:
            log.save(ds, tmp_path / folder / "C3.nc")
        assert str(tmp_path / folder / "C3.nc") in str(caught.value)
        assert "\n" not in str(caught.value)
    assert names(tmp_path) == ["file"]


@pytest.mark.parametrize("free_bytes", [0, 100, 4096])
def test_full_disk_keeps_the_earlier_file(rng, tmp_path, free_bytes):
    path = tmp_path / "C3.nc"
    path.write_bytes(b"before")
    ds = flights.dataset(rng)
    soft_limit, hard_limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (free_bytes, hard_limit))  # limit of the file size of this process
    try:
        with pytest.raises(OSError, match="cannot write") as caught:
            log.save(ds, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft_limit, hard_limit))
        signal.signal(signal.SIGXFSZ, handler)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == b"before"
    assert names(tmp_path) == ["C3.nc"]


def test_interrupted_write_keeps_the_earlier_file(tmp_path, monkeypatch):
    path = tmp_path / "summary.json"
    path.write_bytes(b"before")

    def interrupt(descriptor):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        atomic_write.write_atomic(path, b"after")
    assert path.read_bytes() == b"before"
    assert names(tmp_path) == ["summary.json"]


def test_other_files_are_refused(rng, tmp_path):
    with pytest.raises(FileNotFoundError):
        log.load(tmp_path / "C3.nc")
    log.save(flights.dataset(rng), tmp_path / "C3.nc")
    whole = (tmp_path / "C3.nc").read_bytes()
    # h5netcdf prints a traceback if HDF5 refuses the header; the settings of the tests make this an error
    for content in (b"", b"no NetCDF", whole[: len(whole) // 2], whole[:8] + bytes(56) + whole[64:]):
        (tmp_path / "C3.nc").write_bytes(content)
        with pytest.raises(ValueError, match=r"C3\.nc: not a NetCDF-4 file"):
            log.load(tmp_path / "C3.nc")


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo, lambda path: path.symlink_to(path.name)])
def test_a_log_of_another_kind_is_not_omitted(rng, tmp_path, make):
    """The other cases would be shown without it."""
    log.save(flights.dataset(rng), tmp_path / "C1.nc")
    make(tmp_path / "C3.nc")
    with pytest.raises(OSError, match=r"C3\.nc"):
        log.load_flights(tmp_path, ("C1", "C3"))


def without(name):
    return lambda ds: ds.drop_vars(name)


def with_value(name, value):
    def changed(ds):
        ds[name].values[(1,) * ds[name].ndim] = value
        return ds

    return changed


DAMAGES = {
    "the variable e_p is missing": without("e_p"),
    "the variable sigma_f_L_force is missing": without("sigma_f_L_force"),
    "the variable r is missing": without("r"),
    "the coordinate time is missing or has a wrong type": without("time"),
    "the coordinate agent is missing": without("agent"),
    "joint and joint_order must occur together": without("joint_order"),
    "the variable p has the dimensions": lambda ds: ds.assign(p=ds.p.isel(axis=0, drop=True)),
    "the variable p contains no numbers": lambda ds: ds.assign(p=ds.p.astype(str)),
    "the variable lam has 1 values that are not finite": with_value("lam", np.nan),
    "the variable u has 1 values that are not finite": with_value("u", -np.inf),
    "finite and increasing times": lambda ds: ds.assign_coords(time=ds.time.values[::-1]),
    "time_sigma exceeds the times": lambda ds: ds.assign_coords(time_sigma=ds.time_sigma.values + 1.0),
    "different names": lambda ds: ds.assign_coords(agent=["a"] * ds.sizes["agent"]),
    "it has no time": lambda ds: ds.isel(time=slice(0, 0)),
    "the attribute T_end_s is missing": lambda ds: ds.assign_attrs(T_end_s=None),
    "T_end_s is 'late', not a finite number": lambda ds: ds.assign_attrs(T_end_s="late"),
    "the attribute T_end_s has 2 numbers": lambda ds: ds.assign_attrs(T_end_s=[1.0, 2.0]),
    "the attribute case is .*, not a text": lambda ds: ds.assign_attrs(case=5),
    "scenario_json is not the JSON of a scenario": lambda ds: ds.assign_attrs(scenario_json="[1"),
    "update_times_s is .*, not a finite number": lambda ds: ds.assign_attrs(update_times_s=[1.0, np.nan]),
    "schema 5": lambda ds: ds.assign_attrs(schema=5),
    "damaged: ": lambda ds: ds.assign_attrs(schema=[3, 3]),
}


@pytest.mark.parametrize("reason", DAMAGES)
def test_a_damaged_log_is_refused_in_one_line(tmp_path, reason):
    ds = DAMAGES[reason](flights.dataset(np.random.default_rng(5)))
    ds.attrs = {name: value for name, value in ds.attrs.items() if value is not None}
    ds.to_netcdf(tmp_path / "C3.nc", engine="h5netcdf")
    with pytest.raises(ValueError, match=reason) as refused:
        log.load(tmp_path / "C3.nc")
    assert str(refused.value).startswith(f"{tmp_path / 'C3.nc'}: ")
    assert "\n" not in str(refused.value)


def test_a_heap_that_hdf5_reads_endlessly_is_refused(tmp_path):
    """In each collection of a log, the free space or the first object gets the size zero."""
    log.save(flights.dataset(np.random.default_rng(5)), tmp_path / "whole.nc")
    whole = (tmp_path / "whole.nc").read_bytes()
    log_checks.refuse_endless_heap(whole)
    heaps = [found.start() for found in re.finditer(log_checks.HEAP_SIGNATURE, whole)]
    assert len(heaps) > 1
    for start in heaps:
        for index, size in ((0, 0), (1, 2**64 - 16)):
            content = bytearray(whole)
            struct.pack_into("<H6xQ", content, start + log_checks.HEAP_HEADER, index, size)
            (tmp_path / "C3.nc").write_bytes(content)
            with pytest.raises(ValueError, match=f"damaged: object {index} of the heap at byte {start} has the size"):
                log.load(tmp_path / "C3.nc")


def test_overlapping_heaps_are_refused():
    """Each collection covers the rest of the file, and each object the header of the next collection."""
    header, first = log_checks.HEAP_SIGNATURE + struct.pack("<4xQ", 2**40), struct.pack("<H6xQ", 1, 16)
    with pytest.raises(ValueError, match="damaged: its heaps overlap"):
        log_checks.refuse_endless_heap((header + first) * 100)


@pytest.mark.parametrize("end", range(4, 33))
def test_an_incomplete_heap_is_no_error_of_the_check(end):
    log_checks.refuse_endless_heap(b"x" + (b"GCOL" + bytes(4) + bytes([255] * 24))[:end])


def test_an_incomplete_flight_may_end_with_nan(tmp_path):
    ds = with_value("lam", np.nan)(flights.dataset(np.random.default_rng(5), complete=0))
    log.save(ds, tmp_path / "C3.nc")
    assert np.isnan(log.load(tmp_path / "C3.nc").lam.values[1, 1, 1])


def test_a_pipe_in_place_of_a_log_is_refused(tmp_path):
    os.mkfifo(tmp_path / "C3.nc")
    with pytest.raises(OSError, match="a pipe, socket or device"):
        log.load(tmp_path / "C3.nc")


def test_std_table_has_one_row_per_output(rng):
    """The table of standard deviations covers all outputs of a model: six, and one per joint."""
    shape = flights.MIXED
    _, _, ds = logged(rng, shape)
    outputs = sum(n * (6 + joints) for n, joints, _ in shape.groups)
    for what in ("sigma", "rho"):
        assert sum(record(ds, f"{what}_{f}")[0].size for f in ("f_x", "f_w", "f_r")) == outputs


def test_csv_round_trip_is_exact():
    ds = flights.dataset(np.random.default_rng(5), flights.MIXED)
    head, *rows = csv.reader(io.StringIO(log.to_csv(ds)))
    columns = {name: [row[i] for row in rows] for i, name in enumerate(head)}
    assert len(columns) == len(head)
    assert {len(row) for row in rows} == {len(head)}
    assert set(columns["run"]) == {flights.RUN}
    numbers = lambda name: np.array([float(x) for x in columns[name] if x])  # noqa: E731
    np.testing.assert_array_equal(numbers("time [s]"), ds.time)
    np.testing.assert_array_equal(numbers("p y [m]"), ds.p.sel(axis="y"))
    np.testing.assert_array_equal(numbers("Psi [1]"), ds.Psi)
    np.testing.assert_array_equal(numbers("lam agent2/arm0 z [N]"), ds.lam.sel(contact="agent2/arm0", axis="z"))
    np.testing.assert_array_equal(numbers("R agent3 x z [1]"), ds.R.sel(agent="agent3", axis="x", body_axis="z"))
    np.testing.assert_array_equal(numbers("W_d_moment x [N m]"), ds.W_d_moment.sel(axis="x"))
    np.testing.assert_array_equal(numbers("a_L z [m/s^2]"), ds.a_L.sel(axis="z"))
    np.testing.assert_array_equal(numbers("alpha_L z [rad/s^2]"), ds.alpha_L.sel(axis="z"))
    np.testing.assert_array_equal(numbers("r agent3/joint0 [rad]"), ds.r.sel(joint="agent3/joint0"))
    slides = ds.r_prismatic.sel(prismatic_joint="agent3/joint2")
    np.testing.assert_array_equal(numbers("r_prismatic agent3/joint2 [m]"), slides)
    np.testing.assert_array_equal(numbers("q agent1 w [1]"), ds.q.sel(agent="agent1", quaternion="w"))
    np.testing.assert_array_equal(numbers("thrust_saturated agent0 [1]"), ds.thrust_saturated.sel(agent="agent0"))
    np.testing.assert_array_equal(numbers("eta 3 [N]"), ds.eta[:, 3])
    count = 2 + sum(x.size // len(x) for x in ds.data_vars.values())
    assert len(head) == count


def test_csv_std_rows_are_at_their_times():
    ds = flights.dataset(np.random.default_rng(6))
    head, *rows = csv.reader(io.StringIO(log.to_csv(ds)))
    at = head.index("rho_f_x agent1 y [N]")
    found = {float(row[0]): float(row[at]) for row in rows if row[at]}
    assert list(found) == ds.time_sigma.values.tolist()
    np.testing.assert_array_equal(list(found.values()), ds.rho_f_x.sel(agent="agent1", axis="y"))
