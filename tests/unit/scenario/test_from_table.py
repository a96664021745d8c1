"""Tables of poses: formats of logs and planners, and every mistake with the table's line."""

import cProfile
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import colift
from colift import scenario
from colift.scenario import Scenario, ScenarioError, schema, trajectories
from colift.trajectories import pose_spline

SAMPLE = (Path(__file__).parents[2] / "support" / "sample_scenario.yaml").read_text(encoding="utf-8")
along = jax.jit(jax.vmap(lambda path, t: path.evaluate(t), (None, 0)))
T = 0.1 * np.arange(60)
P = np.stack([np.sin(T), 0.5 * np.cos(T), 1 + 0.1 * T], axis=1)
TURNED = Rotation.from_euler("ZYX", np.stack([0.5 * T, 0.1 * np.sin(T), 0.2 * np.cos(T)], axis=1))
HEAD = "time_s,x_m,y_m,z_m"


def read(folder: Path, table: str | bytes, options: str = "") -> Scenario:
    (folder / "log.csv").write_bytes(table if isinstance(table, bytes) else table.encode())
    reference = f"{{kind: sampled, file: log.csv{options and ', '}{options}}}"
    text = re.sub(r"^reference:\n(  .*\n)*", f"reference: {reference}\n", SAMPLE, flags=re.MULTILINE)
    (folder / "mine.yaml").write_text(text)
    return scenario.load_scenario(folder / "mine.yaml")


def refused(folder: Path, table: str | bytes, options: str = "") -> list[str]:
    with pytest.raises(ScenarioError) as error:
        read(folder, table, options)
    return [line.partition(": reference.")[2] for line in str(error.value).splitlines()]


def path(settings: Scenario) -> pose_spline.PoseSpline:
    made = trajectories.make_reference(settings)
    assert isinstance(made, pose_spline.PoseSpline)
    return made


def table(columns: list[np.ndarray], separator: str = ",", head: str = "") -> str:
    rows = np.column_stack(columns)
    return head + "\n".join(separator.join(f"{x:.9g}" for x in row) for row in rows) + "\n"


def wxyz(turned: Rotation) -> np.ndarray:
    return turned.as_quat()[:, [3, 0, 1, 2]]


def check(settings: Scenario, t: np.ndarray = T, p: np.ndarray = P, turned: Rotation = TURNED) -> None:
    """The reference has the poses at their times."""
    d = along(path(settings), jnp.asarray(t))
    np.testing.assert_allclose(d.p, p, atol=1e-4)
    np.testing.assert_allclose(d.R, turned.as_matrix(), atol=1e-4)


def test_names_in_the_header_state_units_and_order(tmp_path):
    head = "qz, qw, time_ms, x_m, y_m, z_m, qx, qy\n"
    x, y, z, w = TURNED.as_quat().T
    check(read(tmp_path, table([z, w, 1e3 * T, P, x, y], ", ", head)))
    check(read(tmp_path, "\ufeff" + table([z, w, 1e3 * T, P, x, y], ",", head).replace("\n", "\r\n\r\n")))


def test_the_format_of_tum_with_comments_and_spaces(tmp_path):
    head = "# ground truth\n# file: 'a.bag'\n# timestamp tx ty tz qx qy qz qw\n"
    text = head + "".join(
        f"{1_300_000_000 + t:.4f} {' '.join(f'{x:.6f}' for x in row)}\n"
        for t, row in zip(T, np.column_stack([P, TURNED.as_quat()]), strict=True)
    )
    check(read(tmp_path, text, "columns: [time_s, x_m, y_m, z_m, qx, qy, qz, qw]"))


def test_the_format_of_euroc_in_nanoseconds_with_more_columns(tmp_path):
    names = ["timestamp", *(f"p_RS_R_{axis} [m]" for axis in "xyz"), *(f"q_RS_{axis} []" for axis in "wxyz"), "b_w []"]
    start = 1_403_715_524_907_143_168
    rows = zip(T, np.column_stack([P, wxyz(TURNED), T]), strict=True)
    text = "#" + ", ".join(names) + "\n"
    text += "".join(f"{start + round(1e9 * t)},{','.join(f'{x:.6f}' for x in row)}\n" for t, row in rows)
    ours = dict(zip(("time_ns", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"), names[:-1], strict=True))
    columns = "columns: {" + ", ".join(f"{name}: '{theirs}'" for name, theirs in ours.items()) + "}"
    check(read(tmp_path, text, f"{columns}, extra_columns: ignore"))
    assert refused(tmp_path, text, columns) == [
        "file: 'log.csv': line 1: column 'b_w []' is not known; extra_columns: ignore skips it"
    ]


@pytest.mark.parametrize(
    ("separator", "named"), [(";", "auto"), ("\t", "auto"), ("  ", "auto"), (";", "semicolon"), (" ", "space")]
)
def test_separators(tmp_path, separator, named):
    text = table([T, P, wxyz(TURNED)], separator, separator.join([*HEAD.split(","), "qw", "qx", "qy", "qz"]) + "\n")
    check(read(tmp_path, text, f"separator: {named}"))
    if separator.strip():  # one separator at the end of each line
        check(read(tmp_path, text.replace("\n", f"{separator}\n"), f"separator: {named}"))


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_an_empty_last_cell_is_a_cell(tmp_path, separator):
    lines = table([T, P, T], separator, f"{HEAD},note\n".replace(",", separator)).splitlines()
    for rows in (slice(1, None), slice(30, 31)):
        blank = [line.rpartition(separator)[0] + separator if k > 0 else line for k, line in enumerate(lines)]
        text = "\n".join([*lines[: rows.start], *blank[rows], *lines[rows.stop or len(lines) :]])
        check(read(tmp_path, text, "extra_columns: ignore"), turned=Rotation.identity(60))
        ended = text.replace("\n", f"{separator}\n") + separator  # a separator behind each line
        check(read(tmp_path, ended, "extra_columns: ignore"), turned=Rotation.identity(60))


def test_a_missing_last_cell_is_refused(tmp_path):
    text = f"{HEAD},note\n0,0,0,1,\n1,0,0,1\n"
    assert refused(tmp_path, text, "extra_columns: ignore") == ["file: 'log.csv': line 3: must have 5 values, got 4"]
    assert "x_m: must be a number, got ''" in refused(tmp_path, f"time_s,y_m,z_m,x_m\n{GOOD}2,0,1,\n")[0]


@pytest.mark.parametrize("note", ['"a,b"', '"a; b"', '"the ""left, lower"" arm"', '"# 1"', "a #1", '5"', '""', " "])
def test_quoted_cells_may_contain_separators(tmp_path, note):
    lines = table([T, P]).splitlines()
    middle = [f"{t},{note},{rest}" for t, _, rest in (line.partition(",") for line in lines)]
    text = "\n".join(['"time_s","a note, quoted","x_m","y_m","z_m"', *middle])
    check(read(tmp_path, text, "extra_columns: ignore"), turned=Rotation.identity(60))
    last = "\n".join([f"{HEAD},note", *(f"{line}, {note}" for line in lines)])
    check(read(tmp_path, last, "extra_columns: ignore"), turned=Rotation.identity(60))


@pytest.mark.parametrize("separator", [",", ";", " "])
@pytest.mark.parametrize("note", [" # point 1, x; y", "# 1", "  #", " # 2.0", " # a, # b"])
def test_comments_behind_poses_are_dropped(tmp_path, separator, note):
    head = HEAD.replace(",", separator)
    rows = table([T, P], separator).replace("\n", f"{note}\n")
    still = Rotation.identity(60)
    check(read(tmp_path, f"{head} # of 3\n# section 2\n{rows}"), turned=still)
    check(read(tmp_path, f"# {head}\n{rows}"), turned=still)
    check(read(tmp_path, rows, f"columns: [{HEAD}]"), turned=still)
    check(read(tmp_path, rows.replace("#", "//"), f"columns: [{HEAD}], comment: //"), turned=still)


def test_a_mark_in_a_name_is_no_comment(tmp_path):
    text = table([T, P, T], head=f"{HEAD},#sats\n")
    check(read(tmp_path, text, "extra_columns: ignore"), turned=Rotation.identity(60))
    check(read(tmp_path, text.replace("#sats", "# of sats"), "extra_columns: ignore"), turned=Rotation.identity(60))


def test_angles_in_degrees_or_radians_or_yaw_alone(tmp_path):
    yaw, pitch, roll = TURNED.as_euler("ZYX").T
    check(read(tmp_path, table([T, P, roll, pitch, yaw], head=f"{HEAD},roll_rad,pitch_rad,yaw_rad\n")))
    degrees = [np.rad2deg(x) for x in (yaw, roll, pitch)]
    check(read(tmp_path, table([T, P, *degrees], head=f"{HEAD},yaw_deg,roll_deg,pitch_deg\n")))
    yaw = 90 * T  # more than a turn
    alone = read(tmp_path, table([T, P, yaw], head=f"{HEAD},yaw_deg\n"))
    check(alone, turned=Rotation.from_euler("z", yaw[:, None], degrees=True))
    check(read(tmp_path, table([T, P], head=f"{HEAD}\n")), turned=Rotation.identity(len(T)))


def test_north_east_down_becomes_z_up(tmp_path):
    """A position 2 m up and 1 m north, heading east, is (0, 1, 2) with x along the world's x."""
    east = Rotation.from_euler("z", np.full((60, 1), 90.0), degrees=True)
    text = table([T, np.tile([1.0, 0.0, -2.0], (60, 1)), wxyz(east)], head=f"{HEAD},qw,qx,qy,qz\n")
    check(read(tmp_path, text, "frame: ned"), p=np.tile([0.0, 1.0, 2.0], (60, 1)), turned=Rotation.identity(60))


def test_times_are_shifted_and_scaled(tmp_path):
    text = table([100 + T, P], head=f"{HEAD}\n")
    still = Rotation.identity(len(T))
    check(read(tmp_path, text), turned=still)
    check(read(tmp_path, text, "time_offset_s: -99.5"), t=T + 0.5, turned=still)
    slow = read(tmp_path, text, "time_scale: 2")
    check(slow, t=2 * T, turned=still)
    assert slow.reference.end_s == pytest.approx(2 * T[-1])


def test_a_scenario_contains_the_reference_without_its_table(tmp_path):
    loaded = read(tmp_path, table([T, P, wxyz(TURNED)], head=f"{HEAD},qw,qx,qy,qz\n"))
    (tmp_path / "log.csv").unlink()
    again = scenario.parse(scenario.to_yaml(loaded), "again.yaml")
    assert again == loaded
    check(again)
    assert loaded.reference.name == f"log.csv, {len(T)} poses"


def test_a_row_takes_at_most_25_function_calls(tmp_path):
    """The package's own calls are counted: their number does not depend on the machine, in contrast to the time."""
    package, calls = str(Path(colift.__file__).parent), []
    for rows in (1036, 8288):
        t = 0.01 * np.arange(rows)
        p = np.stack([2 * np.sin(0.7 * t), np.cos(0.9 * t), 2 + 0.3 * np.sin(t)], axis=1)
        turned = Rotation.from_euler("ZYX", np.stack([0.5 * t, 0.1 * np.sin(t), 0.1 * np.cos(t)], axis=1))
        text = table([t, p, wxyz(turned)], head=f"{HEAD},qw,qx,qy,qz\n")
        read(tmp_path, text)  # imports, and programs for this number of rows
        profile = cProfile.Profile()
        loaded = profile.runcall(read, tmp_path, text)
        entries = [entry for entry in profile.getstats() if getattr(entry.code, "co_filename", "").startswith(package)]
        calls.append(sum(entry.callcount for entry in entries))
        check(loaded, t, p, turned)
    assert calls[1] - calls[0] <= 25 * (8288 - 1036)


GOOD = "0,0,0,1\n1,1,0,1\n"


@pytest.mark.parametrize(
    ("text", "options", "says"),
    [
        ("", "", "must hold two poses or more, got 0"),
        (f"{HEAD}\n0,0,0,1\n", "", "must hold two poses or more, got 1"),
        (GOOD, "", "has no line of column names: state reference.columns, such as [time_s, x_m, y_m, z_m]"),
        (f"when,x_m,y_m,z_m\n{GOOD}", "", "line 1: one column of time is required (time_s, time_ms, time_us, time_ns)"),
        (f"time_s,x_m,y_m,h\n{GOOD}", "", "line 1: column z_m is required"),
        (f"{HEAD},qw\n0,0,0,1,1\n1,0,0,1,1\n", "", "line 1: qw, qx, qy, qz must occur together"),
        (
            f"{HEAD},roll_deg,yaw_deg\n0,0,0,1,1,1\n",
            "",
            "line 1: roll_deg, pitch_deg, yaw_deg must occur together, or yaw_deg",
        ),
        (
            f"{HEAD},yaw_deg,yaw_rad\n0,0,0,1,1,1\n",
            "",
            "line 1: the attitude is stated twice, by yaw_deg and by yaw_rad",
        ),
        (f"{HEAD},x_m\n0,0,0,1,1\n", "", "line 1: column x_m stands twice"),
        (f"{HEAD},vx\n0,0,0,1,1\n", "", "line 1: column 'vx' is not known"),
        (GOOD, "columns: [time_s, x_m, y_m]", "reference.columns has 3 names, but the table has 4 columns"),
        (f"{HEAD}\n{GOOD}", "columns: {time_s: t}", "line 1: has no column 't' for time_s"),
        (f"{HEAD}\n{GOOD}2,a,0,1\n", "", "line 4: x_m: must be a number, got 'a'"),
        (f"{HEAD}\n{GOOD}2,0,1\n", "", "line 4: must have 4 values, got 3"),
        (f"{HEAD}\n{GOOD}2,nan,0,1\n", "", "line 4: must have finite numbers"),
        (f"{HEAD}\n{GOOD}2,1e5,0,1\n", "", "line 4: the position must be within 10000 m"),
        (f"{HEAD}\n{GOOD}1,0,0,1\n", "", "line 4: time_s: must exceed that of line 3, 1, by 1e-06 s, got 1; unord"),
        (f"{HEAD}\n0,0,0,1\n5e-324,0,0,1\n1,0,0,1\n", "", "line 3: time_s: must exceed that of line 2, 0, by 1e-06 s"),
        (f"{HEAD}\n{GOOD}{'9' * 400},0,0,1\n", "", "line 4: must have finite numbers"),
        ("time_s;x_m;y_m;z_m\n0;0,5;0;1\n", "", "line 2: x_m: must be a number, got '0,5'; the decimal separator is a"),
        (
            f"{HEAD},qw,qx,qy,qz\n0,0,0,1,1,1,0,0\n1,0,0,1,1,0,0,0\n",
            "",
            "line 2: the quaternion has the norm 1.414, not 1",
        ),
        (f"{HEAD}\n{GOOD}", "time_offset_s: 1e9", "the times must be within 100000 s, got 1e+09 to 1e+09 s"),
        (b"\xff\xfe\x00", "", "cannot be read: 'utf-8' codec can't decode byte 0xff"),
    ],
)
def test_mistakes_in_a_table_have_its_line(tmp_path, text, options, says):
    assert refused(tmp_path, text, options)[0].startswith(f"file: 'log.csv': {says}")


@pytest.mark.parametrize(
    ("head", "clock"),
    [
        ("t,p_x,p_y,p_z,q_w,q_x,q_y,q_z,v_x", T),
        (
            "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], b",
            1e9 * T,
        ),
        ("time,x,y,z,qw,qx,qy,qz,note", T),
        ("# timestamp tx ty tz qw qx qy qz vx", T),
        ("Time (s),Position.X,Position.Y,Position.Z,quat_w,quat_x,quat_y,quat_z,Yaw", T),
    ],
)
def test_names_in_common_use_have_one_proposal_that_works(tmp_path, head, clock):
    separator = "," if "," in head else " "
    rows = table([np.round(clock), P, wxyz(TURNED), T] if clock[1] > 1 else [clock, P, wxyz(TURNED), T], separator)
    if clock[1] > 1:
        rows = re.sub(r"^([\d.e+]+)", lambda found: f"{float(found[1]):.0f}", rows, flags=re.MULTILINE)
    (line,) = refused(tmp_path, f"{head}\n{rows}")
    start = "file: 'log.csv': line 1: the columns have other names: state reference.columns, such as "
    assert line.startswith(start)
    columns, _, rest = line.removeprefix(start).partition(", and ")
    check(read(tmp_path, f"{head}\n{rows}", f"columns: {columns}, {rest}"))


def test_a_time_in_a_finer_unit_is_proposed(tmp_path):
    for first, step, unit in (
        (1403715524907143168, 5_000_000, "ns"),
        (1403715524907143, 5_000_000, "us"),
        (0, 10**6, "ms"),
    ):
        rows = "".join(f"{first + k * step},{k},0,1\n" for k in range(101))
        (line,) = refused(tmp_path, rows, f"columns: [{HEAD}]")
        assert line.endswith(f" s; name the column time_{unit} if that is its unit")


def test_positions_far_from_the_origin_are_one_error(tmp_path):
    rows = [T, P + [458_000.0, 5_400_000.0, 160.0]]
    (line,) = refused(tmp_path, table(rows, head=f"{HEAD}\n"))
    assert line.endswith(
        "line 2: the position must be within 10000 m; subtract an origin from all positions of the table"
    )


def test_poses_out_of_order_can_be_skipped(tmp_path):
    text = table([T, P], head=f"{HEAD}\n").splitlines()
    text.insert(30, text[20])
    loaded = read(tmp_path, "\n".join(text), "unordered_rows: skip")
    assert loaded.reference.name == f"log.csv, {len(T)} poses"
    check(loaded, turned=Rotation.identity(len(T)))


def test_many_mistakes_are_cut_off(tmp_path):
    lines = refused(tmp_path, f"{HEAD}\n" + "".join(f"{t},a,0,1\n" for t in range(100)))
    assert len(lines) == 21


def test_a_deviation_that_no_spline_has_is_refused(tmp_path):
    t = 0.01 * np.arange(9000)
    p = np.random.default_rng(0).normal(size=(9000, 3))
    (line,) = refused(tmp_path, table([t, p], head=f"{HEAD}\n"), "deviation_m: 0.01")
    assert re.match(r"deviation_m \[m\]: is too small for a spline of these poses: the least is 1\.\d+ m", line)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("file: nowhere.csv", "file: 'nowhere.csv': cannot be read: No such file or directory"),
        ("frame: up", "frame: must be one of enu, ned, got 'up'"),
        ("poses: []", "poses: is not a setting here"),
        ("time_scale: 0", "time_scale: must be from 0.01 to 100"),
    ],
)
def test_mistakes_about_a_table_are_told(tmp_path, options, says):
    (tmp_path / "log.csv").write_text(f"{HEAD}\n{GOOD}")
    reference = f"{{kind: sampled, {options if 'file' in options else f'file: log.csv, {options}'}}}"
    text = re.sub(r"^reference:\n(  .*\n)*", f"reference: {reference}\n", SAMPLE, flags=re.MULTILINE)
    with pytest.raises(ScenarioError) as error:
        scenario.parse(text, str(tmp_path / "mine.yaml"))
    assert str(error.value).partition(": reference.")[2].startswith(says)


def test_knots_that_are_no_table_are_refused(tmp_path):
    tables = read(tmp_path, table([T, P], head=f"{HEAD}\n")).reference.tables
    for wrong in ("?", tables["position_knots"][:100], "", tables["box"]):
        with pytest.raises(ScenarioError, match="tables: position_knots: must"):
            schema.Sampled(kind="sampled", name="log", start_s=0, end_s=1, tables=tables | {"position_knots": wrong})
    with pytest.raises(ScenarioError, match="tables: must have the tables position_knots, "):
        schema.Sampled(kind="sampled", name="log", start_s=0, end_s=1, tables={})
