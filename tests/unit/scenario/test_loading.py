"""Tests of scenario files: accepted forms, and every error with its place."""

import io
import re
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from colift import scenario
from colift.scenario import Scenario, ScenarioError
from colift.scenario.from_csv import WaypointsFromFile
from colift.scenario.from_table import SampledFromFile
from colift.scenario.from_urdf import AgentTypeFromUrdf
from colift.scenario.schema import AgentType, Body, Revolute
from colift.scenario.schema_docs import markdown
from colift.scenario.shipped import SHIPPED_DIRECTORY

SAMPLE = (Path(__file__).parents[2] / "support" / "sample_scenario.yaml").read_text(encoding="utf-8")
BODY = {"mass_kg": 1.0}


def error_lines(text: str) -> list[str]:
    """Return the lines of the error of a text."""
    with pytest.raises(ScenarioError) as refused:
        scenario.parse(text, "s.yaml")
    return str(refused.value).splitlines()


def numbers(node: object, place: str = "") -> list[tuple[str, int, int]]:
    """Return `(path, line, column)` of every number in a YAML tree, lines from 1."""
    found = []
    if isinstance(node, CommentedMap):
        items = [(f".{key}", node.lc.value(key), value) for key, value in node.items()]
    elif isinstance(node, CommentedSeq):
        items = [(f"[{i}]", node.lc.item(i), value) for i, value in enumerate(node)]
    else:
        return []
    for key, (line, column), value in items:
        if isinstance(value, int | float) and not isinstance(value, bool):
            found.append(((place + key).lstrip("."), line + 1, column))
        else:
            found += numbers(value, place + key)
    return found


NUMBERS = numbers(YAML(typ="rt").load(SAMPLE))
KEYS = sorted(
    {m[1] for m in re.finditer(r"(?:^|[{,-])\s*([A-Za-z_0-9]{4,}):", SAMPLE, re.MULTILINE)}
    - {"two_arms", "schema", "kind", "type"}
)


# Accepted files -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", scenario.shipped_names())
def test_shipped_scenarios_load_by_name_and_by_path(name, tmp_path):
    copy = tmp_path / "mine.yaml"
    copy.write_text((SHIPPED_DIRECTORY / f"{name}.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    assert scenario.load_scenario(name) == scenario.load_scenario(copy) == scenario.load_scenario(str(copy))
    assert scenario.load_scenario(name).name == name


def test_study_has_the_values_of_the_paper():
    s = scenario.load_scenario("paper")
    assert {"paper", "leader_block"} <= set(scenario.shipped_names())
    assert len(s.agents) == 2
    assert [(len(t.arms), len(t.joints)) for t in s.agent_types.values()] == [(2, 3)]
    assert (s.duration_s, s.control_Hz) == (20, 500)
    assert np.linalg.norm(s.initial_state.position_error_m) == pytest.approx(0.2, rel=0.01)
    assert np.linalg.norm(s.initial_state.attitude_error_deg) == pytest.approx(10, rel=0.01)
    assert len(s.learning.update_times_s) >= 4
    assert min(s.learning.update_times_s) >= 2
    assert s.learning.end_s <= 10
    assert min(s.learning.max_samples, (s.learning.end_s - s.learning.start_s) * s.learning.sample_Hz) >= 200
    noise = s.sensors
    assert (noise.position_m, noise.attitude_deg, noise.velocity_mps, noise.angular_velocity_radps) == (
        0.002,
        0.2,
        0.01,
        0.01,
    )
    assert (noise.accelerometer_mps2, noise.joint_position_deg) == (0.05, 0.1)
    assert (noise.tip_force_N, noise.tip_force_bias_N, noise.tip_force_bandwidth_Hz) == (0.1, 0.05, 50)
    assert s.payload.mass_kg == 1.5
    assert s.nominal.payload is not None
    assert s.nominal.payload.mass_kg == 1.2


def test_settings_are_immutable_and_have_a_digest():
    """Settings are immutable, and different settings have different digests."""
    s = scenario.load_scenario("paper")
    with pytest.raises(ValidationError):
        s.seed = 1  # ty: ignore[invalid-assignment]
    other = s.model_copy(update={"seed": 1})
    assert s.digest == scenario.load_scenario("paper").digest
    assert re.fullmatch("[0-9a-f]{12}", s.digest)
    assert other.digest != s.digest


def test_settings_round_trip_through_plain_data():
    s = scenario.load_scenario("paper")
    assert Scenario.model_validate(s.model_dump()) == s
    assert Scenario.model_validate_json(s.model_dump_json()) == s


@given(st.integers(0, 2**32 - 1))
def test_inertia_of_any_rigid_body_is_accepted(seed):
    """The inertia of any rigid body is accepted in each of its forms."""
    points = np.random.default_rng(seed).normal(size=(5, 3))
    points -= points.mean(0)
    J = (points**2).sum() * np.eye(3) - points.T @ points
    full = Body.model_validate(BODY | {"inertia_kgm2": J.tolist()})
    six = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
    np.testing.assert_array_equal(full.inertia_kgm2, J)
    assert Body.model_validate(BODY | {"inertia_kgm2": six}) == full
    principal = np.linalg.eigvalsh(J).tolist()
    np.testing.assert_array_equal(
        Body.model_validate(BODY | {"inertia_kgm2": principal}).inertia_kgm2, np.diag(principal)
    )


@given(st.integers(0, 2**32 - 1), st.sampled_from(["negative", "triangle", "asymmetric"]))
def test_unphysical_inertia_is_refused(seed, flaw):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.5, 2, 2)
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    J = (
        Q
        @ np.diag({"negative": [a, b, -0.01], "triangle": [a, b, 1.01 * (a + b)]}.get(flaw, [a, b, (a + b) / 2]))
        @ Q.T
    )
    J = (J + J.T) / 2
    J[0, 1] += 0.01 if flaw == "asymmetric" else 0
    expected = {"negative": "positive definite", "triangle": "triangle inequality", "asymmetric": "symmetric"}[flaw]
    with pytest.raises(ScenarioError, match=expected):
        Body.model_validate(BODY | {"inertia_kgm2": J.tolist()})


@pytest.mark.parametrize("axis", [[0, 0, 0], [0.0, -0.0, 0.0]])
def test_zero_axis_is_refused(axis):
    body = BODY | {"inertia_kgm2": [1, 1, 1]}
    with pytest.raises(ScenarioError, match="must not be zero"):
        Revolute.model_validate({"name": "j", "type": "revolute", "axis": axis, "body": body})


# Errors ---------------------------------------------------------------------------------------------------------------

WRONG = [  # original text, replacement, line of the error
    (
        "mass_kg: 1.5, inertia_kgm2: [0.02",
        "mass_kg: -1.5, inertia_kgm2: [0.02",
        "base.mass_kg [kg]: must be from 1e-6 to 100000 (from a milligram to 100 t), got -1.5",
    ),
    ("thrust_max_N", "thrust_mx_N", "two_arms.thrust_mx_N [N]: is not a setting here; did you mean 'thrust_max_N'?"),
    ("thrust_max_N", "thrust_mx_N", "two_arms.thrust_max_N [N]: is required"),
    ("[0.02, 0.02, 0.035]", "[0.02, 0.02, 0.05]", "base.inertia_kgm2 [kg m²]: breaks the triangle inequality"),
    ("center_m: [0, 0, 2]", "center_m: [0, 0]", "reference.center_m[2] [m]: is missing"),
    (
        "center_m: [0, 0, 2]",
        "center_m: [0, 0, 2, 1]",
        "reference.center_m [m]: must have at most 3 values, got 4 values",
    ),
    ("duration_s: 20", "duration_s: .inf", "duration_s [s]: must be finite, got inf"),
    ("duration_s: 20", "duration_s: true", "duration_s [s]: must be a number, got True"),
    ("duration_s: 20", "duration_s:", "duration_s [s]: must be a number, got nothing"),
    ("seed: 0", "seed: 0.5", "seed: must be a whole number, got 0.5"),
    ("K_p: 5", "K_p: [5, 5, 0]", "control.K_p[2] [1/s²]: must be from 1e-6 to 1e8 (unstable at"),
    ("kind: jet", "kind: jett", "disturbances[2]: kind must be one of"),
    ("kind: jet", "kind: jett", "got 'jett'; did you mean 'jet'?"),
    ("kind: least_squares", "kind: leader_follower", "allocation.leader_contacts: is required"),
    ("acts_on: front", "acts_on: frnt", "disturbances[4].acts_on: 'frnt' is not the payload"),
    ("acts_on: front", "acts_on: payload", "disturbances[4].acts_on: rotor_bias acts on agents"),
    ("acts_on: front", "acts_on: front, body: lft", "disturbances[4].body: 'lft' is not a body of agent 'front'"),
    ("name: tether,", "name: tether, body: waist,", "disturbances[1].body: must be omitted"),
    ("name: tether,", "name: load_wind,", "disturbances[1].name: 'load_wind' is used twice"),
    ("name: rear,", "name: front,", "agents[1].name: 'front' is used twice"),
    ("name: rear,", "name: payload,", "agents[1].name: 'payload' is a reserved name"),
    ("name: rear, type: two_arms", "name: rear, type: two_arm", "agents[1].type: 'two_arm' is not one of agent_types"),
    ("[[-0.5, 0.36, 0.05], ", "[", "agents[1].contact_positions_m [m]: must hold one contact for each of the 2 arms"),
    (
        "parent: waist\n        position_m: [0, 0.08",
        "parent: right\n        position_m: [0, 0.08",
        "joints[1].parent: 'right' is not a body listed above",
    ),
    ("name: left, joint: left", "name: left, joint: lift", "arms[0].joint: 'lift' is not a body of this agent type"),
    ("rear/right, 1.0", "rear/righ, 1.0", "pairs[1][1]: 'rear/righ' is not a contact"),
    ("[rear/left, rear/right", "[rear/left, rear/left", "pairs[1][1]: must be another contact"),
    ("ramp_time_s: 0.5", "ramp_time_s: 5", "internal.ramp_time_s [s]: two ramps must fit"),
    ("[2.5, 4.5, 6.5", "[2.5, 6.5, 4.5", "update_times_s[2] [s]: must exceed the one before, 6.5, got 4.5"),
    ("[2.5, 4.5", "[0.2, 4.5", "update_times_s[0] [s]: must exceed start_s = 0.5"),
    ("  end_s: 10\n", "  end_s: 30\n", "learning.end_s [s]: must not exceed duration_s = 20, got 30"),
    ("  end_s: 10\n", "  end_s: 9\n", "update_times_s[4] [s]: must not exceed end_s = 9, got 10"),
    ("seed: 0", "seed: 9223372036854775808", "seed: must be from 0 to 9223372036854775807 (63 bits, the range"),
    ("seed: 0", "seed: 1234567890123456789012345678901", "got 1234567890123456789012345678901"),
    ("seed: 0", f"seed: {'9' * 5000}", "seed: is not a number that can be read"),
    ("seed: 0", f"seed: 0x{'f' * 5000}", "got a whole number of 20000 bits"),
    ("seed: 0", "seed: !!bool foo", "s.yaml:7: seed: tags are not used in a scenario, got '!!bool'"),
    ("seed: 0", "seed: 0\nseed: 1", "s.yaml:7: seed: occurs twice, in lines 7 and 8"),
    ("seed: 0", "1: 0", "scenario: the name of a setting must be text, got '1' in line 7"),
    ("seed: 0", "<<: 0", "scenario: `<<` must be a section, or a list of sections, got '0'"),
    ("name: sample", 'name: "\\ud800"', "name: holds characters that are not text"),
    ("name: sample", f"name: {'x' * 101}", "name: must have at most 100 characters"),
    ("control_Hz: 500", "control_Hz: 19", "control_Hz [Hz]: must be from 20 to 10000 (attitude loops require 20 Hz"),
    (
        "control_Hz: 500",
        "control_Hz: 20",
        "control.joint_filter_Hz [Hz]: must not exceed half of control_Hz, 10, got 30",
    ),
    ("control_Hz: 500", "control_Hz: 24", "learning.sample_Hz [Hz]: must not exceed control_Hz = 24, got 25"),
    (
        "label_filter_Hz: 4",
        "label_filter_Hz: 251",
        "learning.label_filter_Hz [Hz]: must not exceed half of control_Hz, 250, got 251",
    ),
    (
        "duration_s: 20",
        "duration_s: 3000",
        "the log of this team at 500 Hz would take 4.13 GB; 2 GB are allowed, 1453 s",
    ),
    (
        "max_samples: 256",
        "max_samples: 2283",
        "the 24 outputs of the models would take 1 GB; 1 GB are allowed, 2282 points",
    ),
    ("max_samples: 256", "max_samples: 1", "learning.max_samples: must be from 2 to 20000 (a fit requires two samples"),
    (
        "ramp_time_s: 3\n",
        "ramp_time_s: 20\nrandom_residual: {rkhs_norm: 1}\n",
        "reference.ramp_time_s [s]: must be less than duration_s = 20",
    ),
    ("[2.5, 4.5", "[2.5, 2.53", "update_times_s[1] [s]: must be a period of sample_Hz = 25 after the one before, 2.5"),
    ("[2.5, 4.5", "[0.52, 4.5", "update_times_s[0] [s]: must be a period of sample_Hz = 25 after start_s, 0.5"),
    (
        "[2.5, 0, 1]",
        "[25, 0, 1]",
        "gusts[0].wave_vector_radpm [rad/m]: has a wavelength of 0.251 m, less than the 1.23 m",
    ),
    ("[2.5, 0, 1]", "[250, 0, 1]", "wave_vector_radpm[0] [rad/m]: must be from -63 to 63 (a wavelength of 10 cm"),
    ("[2.5, 0, 1]", "[1e-4, 0, 1e-4]", "wave_vector_radpm [rad/m]: has a wavelength above 10 km, which is a mean wind"),
    ("center_m: [0, 0, 2]", "center_m: [<<, 0, 2]", "reference.center_m[0] [m]: must be a number, got '<<'"),
    ("axis: [0, 0, 1]", "axis: [0, 0, 1e-7]", "joints[0].axis: must not be zero"),
    ("two_arms:", "two_arms: 5\n  other:", "agent_types.two_arms: must be settings by name, got 5"),
    (
        "moment_Nm: 0.02}\n",
        "moment_Nm: 0.02}\n    lengthscale: 40\n",
        "learning.payload.lengthscale [of each feature]: must be from 0.1 to 30 "
        "(bounds of the length-scales in the fit",
    ),
    (
        "position_error_m: [",
        "position_error_m: [5, 0, 0]  # [",
        "initial_state.position_error_m [m]: is 5 m from the reference",
    ),
    (
        "kind: joint_friction, acts_on: agents",
        "kind: joint_friction, acts_on: payload",
        "joint_friction acts on agents",
    ),
]


@pytest.mark.parametrize(("written", "instead", "answer"), WRONG)
def test_error_messages(written, instead, answer):
    assert SAMPLE.count(written) >= 1
    lines = error_lines(SAMPLE.replace(written, instead, 1))
    assert any(answer in line for line in lines), lines


def test_consequential_errors_are_not_reported():
    assert len(error_lines(SAMPLE.replace("seed: 0", "seed: !!bool foo"))) == 1
    assert len(error_lines(SAMPLE.replace("max_samples: 256", "max_samples: 1e6"))) == 1


def test_many_errors_are_truncated_and_counted():
    """The first of many errors are reported, and the others are counted."""
    lines = error_lines(SAMPLE + "\n".join(f"a{i}: 1" for i in range(500)))
    assert len(lines) == 101
    assert lines[-1] == "and 400 more errors"


def test_all_errors_are_reported_in_file_order():
    text = SAMPLE
    for written, instead in [
        ("thrust_max_N", "thrust_mx_N"),
        ("acts_on: front", "acts_on: frnt"),
        ("K_p: 5", "K_p: -5"),
    ]:
        text = text.replace(written, instead)
    lines = error_lines(text)
    assert len(lines) == 4  # the misspelt setting is also missing
    numbered = [int(line.split(":")[1]) for line in lines]
    assert numbered == sorted(numbered)
    assert all(re.match(r"s\.yaml:\d+: \S+( \[[^]]+\])?: \S", line) for line in lines)


@pytest.mark.parametrize(("path", "line", "column"), NUMBERS[::3], ids=lambda x: str(x))
def test_error_states_its_place(path, line, column):
    rows = SAMPLE.splitlines()
    rows[line - 1] = rows[line - 1][:column] + "oops_" + rows[line - 1][column:]
    lines = error_lines("\n".join(rows))
    assert any(told_line.startswith(f"s.yaml:{line}: {path}") and "'oops_" in told_line for told_line in lines), lines


@given(st.sampled_from(KEYS), st.integers(1, 3), st.booleans())
@settings(max_examples=40)
def test_misspelled_setting_gets_a_suggestion(key, at, double):
    wrong = key[:at] + (key[at] + key[at] if double else "") + key[at + 1 :]
    text = re.sub(rf"(?<![A-Za-z_0-9]){key}:", f"{wrong}:", SAMPLE, count=1)
    assume(wrong not in KEYS and text != SAMPLE)
    lines = error_lines(text)
    assert any(f"{wrong}" in line and f"did you mean '{key}'?" in line for line in lines), lines


# Overrides ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "instead"),
    [
        ("payload.mass_kg=2", ("mass_kg: 1.5, inertia_kgm2: [0.04", "mass_kg: 2, inertia_kgm2: [0.04")),
        ("agents.1.yaw_deg=30", ("name: rear,", "name: rear, yaw_deg: 30,")),
        ("agents.rear.yaw_deg=30", ("name: rear,", "name: rear, yaw_deg: 30,")),
        ("agents.0.contact_positions_m.1.2=0.04", ("[0.5, -0.36, 0.05]", "[0.5, -0.36, 0.04]")),
        ("sensors.tip_force_N=0.2", ("\ncontrol:", "\nsensors: {tip_force_N: 0.2}\ncontrol:")),
        ("allocation={kind: least_squares}", (SAMPLE[SAMPLE.index("  internal:") : SAMPLE.index("\nlearning:")], "")),
        ("description= a = b", ("A scenario for tests.\n", "a = b\n")),
    ],
)
def test_override_equals_the_same_text_in_the_file(change, instead):
    written = SAMPLE.replace("# A scenario for tests:", "#").replace(*instead, 1)
    assert written != SAMPLE
    assert scenario.parse(SAMPLE, "s.yaml", (change,)) == scenario.parse(written, "s.yaml")


def test_last_override_counts():
    assert scenario.load_scenario("paper", ("payload.mass_kg=2", "payload.mass_kg=3")).payload.mass_kg == 3
    assert scenario.load_scenario(
        "paper", ("payload={mass_kg: 2, inertia_kgm2: [1, 1, 1]}", "payload.mass_kg=3")
    ).payload == (scenario.load_scenario("paper", ("payload.mass_kg=3", "payload.inertia_kgm2=[1, 1, 1]")).payload)


def test_override_replaces_an_invalid_value():
    assert scenario.parse(SAMPLE.replace("duration_s: 20", "duration_s: x"), "s.yaml", ("duration_s=20",)) == (
        scenario.parse(SAMPLE, "s.yaml")
    )


@pytest.mark.parametrize(
    ("change", "answer"),
    [
        ("payload.mass_kg=two", "--set payload.mass_kg [kg]: must be a number, got 'two'"),
        ("payload.mass_kg=-1", "--set payload.mass_kg [kg]: must be from 1e-6 to 100000"),
        ("payload.mass_kg=", "--set payload.mass_kg [kg]: must be a number, got nothing"),
        ("payload.mass_kg=!!float 2", "--set payload.mass_kg [kg]: tags are not used"),
        ("payload.mass=2", "--set payload.mass: is not a setting here; did you mean 'mass_kg'?"),
        ("payloda.mass_kg=2", "--set payloda: is not a setting here; did you mean 'payload'?"),
        ("payload={mass_kg: 2}", "--set payload.inertia_kgm2 [kg m²]: is required"),
        ("payload=[2", "--set payload: not valid YAML"),
        ("payload.mass_kg", "--set 'payload.mass_kg': must be `path=value`, for example payload.mass_kg=2"),
        ("=2", "--set '=2': must be `path=value`"),
        ("agents.2.name=a", "--set agents.2.name: must be one of the list's entries 0 to 1 ('front', 'rear'), got '2'"),
        (
            "agents.side.name=a",
            "--set agents.side.name: must be one of the list's entries 0 to 1 ('front', 'rear'), got 'side'",
        ),
        ("agents.0.contact_positions_m.rear=1", "must be one of the list's entries 0 to 1, got 'rear'"),
        ("agents.0.contact_positions_m.0.3=1", "must be one of the list's entries 0 to 2, got '3'"),
        ("duration_s.x=1", "--set duration_s.x: duration_s is 20, which holds no settings"),
        ("a" + ".a" * 2000 + "=1", "is nested more than 20 deep"),
        ("duration_s=5", "s.yaml:96: learning.end_s [s]: must not exceed duration_s = 5, got 10"),
    ],
)
def test_invalid_override_gives_one_line(change, answer):
    with pytest.raises(ScenarioError) as refused:
        scenario.parse(SAMPLE, "s.yaml", (change,))
    (line,) = str(refused.value).splitlines()
    assert answer in line


@pytest.mark.parametrize("name", scenario.shipped_names())
def test_yaml_round_trip(name):
    settings = scenario.load_scenario(name, ("gravity_mps2=[0, 0, -1.62e-5]", "description='a: b # c'"))
    assert scenario.parse(scenario.to_yaml(settings), "s.yaml") == settings


# Files ----------------------------------------------------------------------------------------------------------------


def test_file_may_extend_another(tmp_path):
    """Sections merge by setting, entries of lists by name, sections of another kind as a whole; also over two files."""
    one, two = tmp_path / "one.yaml", tmp_path / "two.yaml"
    one.write_text(
        "schema: 2\nextends: paper\nname: one\npayload: {mass_kg: 2}\ndisturbances:\n"
        "  - {name: clamp, force_N: [0, 0, -2]}\n"
        "  - {name: more, kind: constant, acts_on: payload, force_N: [1, 0, 0]}\nallocation:\n"
        "  {kind: leader_follower, leader_contacts: [front/left, front/right, rear/left]}\n"
    )
    two.write_text("schema: 2\nextends: one.yaml\nname: two\n")
    paper, found = scenario.load_scenario("paper"), scenario.load_scenario(one)
    assert found.payload.mass_kg == 2
    assert found.payload.inertia_kgm2 == paper.payload.inertia_kgm2
    names = [source.name for source in paper.disturbances]
    assert [source.name for source in found.disturbances] == [*names, "more"]
    clamps = [next(x for x in s.disturbances if x.name == "clamp") for s in (paper, found)]
    assert clamps[1] == clamps[0].model_copy(update={"force_N": (0.0, 0.0, -2.0)})
    assert found.allocation.internal is None
    assert scenario.load_scenario(two) == found.model_copy(update={"name": "two"})


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("schema: 2\nextends: paper\npayload: {mass_kg: -2}\n", "own.yaml:3: payload.mass_kg [kg]: must be"),
        (
            "schema: 2\nextends: paper\ndisturbances:\n  - {name: clamp, force: 1}\n",
            "own.yaml:4: disturbances[3].force: is not a setting",
        ),
        ("schema: 2\nextends: papr\n", "own.yaml:2: extends: there is no scenario 'papr' (shipped: "),
        ("schema: 2\nextends: nowhere.yaml\n", "own.yaml:2: extends: 'nowhere.yaml' cannot be read: "),
        ("schema: 2\nextends: [paper]\n", "own.yaml:2: extends: must be the name of a shipped scenario"),
        ("schema: 2\nextends: own.yaml\n", "own.yaml:2: extends: 4 files that extend one another are the limit"),
        (
            "schema: 2\nname: a\nextends: paper\npayload_mass_step: {mass_kg: -2, start_s: 1}\n",
            "own.yaml:4: payload_mass_step.mass_kg [kg]: must leave some of",
        ),
    ],
)
def test_errors_in_an_extending_file_state_its_line(text, answer, tmp_path):
    """Errors in a file that extends another one state its line."""
    path = tmp_path / "own.yaml"
    path.write_text(text)
    with pytest.raises(scenario.ScenarioError) as lines:
        scenario.load_scenario(path)
    assert answer in str(lines.value)


def test_unknown_name_error_lists_the_shipped_scenarios():
    with pytest.raises(
        ScenarioError, match=r"no scenario 'papr' \(shipped: .*leader_block.*paper.*did you mean 'paper'"
    ) as e:
        scenario.load_scenario("papr")
    assert "\n" not in str(e.value)


def test_unreadable_file_gives_one_line(tmp_path):
    binary, folder = tmp_path / "binary.yaml", tmp_path / "folder"
    binary.write_bytes(b"\xff\xfe\x00")
    folder.mkdir()
    for path, reason in [
        (binary, ":1: cannot be read: not UTF-8"),
        (folder, "a folder, not a file"),
        (tmp_path / "absent.yaml", "No such file"),
        (Path("~nobody_of_that_name/a.yaml"), "home directory"),
        (Path("/dev/zero"), "a pipe, socket or device, not a regular file"),
    ]:
        with pytest.raises(ScenarioError, match=reason) as e:
            scenario.load_scenario(path)
        assert "\n" not in str(e.value)
        assert str(path) in str(e.value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "- 1",
        "just words",
        "a: [1",
        "a: *nowhere",
        "\tb: 1",
        "---\na: 1\n---\nb: 2",
        "\0",
        "a: " + "[" * 5000,
        "a: &a [*a]",
        "a: &a {<<: *a}",
        "a0: &a0 [1]\n" + "".join(f"a{i}: &a{i} [{f'*a{i - 1},' * 9}]\n" for i in range(1, 12)),
        "a: " + "x" * 2_000_000,
        "%YAML 1.3\n---\na: 1",
        "ok: 1\nb: \x07",
    ],
)
def test_invalid_yaml_gives_one_line(text):
    """Text that is no mapping or no YAML gives one line with its number."""
    (line,) = error_lines(text)
    assert re.match(r"s\.yaml:\d+: \S", line)
    assert len(line) < 300


@pytest.mark.parametrize("given", ["", "a\0b.yaml", "a" * 5000, "a" * 5000 + ".yaml", "\ud800"])
def test_invalid_file_name_gives_one_line(given):
    with pytest.raises(ScenarioError) as e:
        scenario.load_scenario(given)
    assert "\n" not in str(e.value)
    assert len(str(e.value)) < 400


def test_equivalent_notations_are_read_alike(tmp_path):
    plain = scenario.parse(SAMPLE, "s.yaml")
    merged = SAMPLE.replace("payload: {mass_kg: 1.5,", "payload: {<<: {mass_kg: 9}, mass_kg: 1.5,", 1)
    for text in ("\ufeff" + SAMPLE, SAMPLE.replace("\n", "\r\n"), "%YAML 1.1\n---\n" + SAMPLE, merged):
        path = tmp_path / "s.yaml"
        path.write_bytes(text.encode())
        assert scenario.load_scenario(path) == plain
    brought = scenario.parse(merged.replace("{mass_kg: 9}, mass_kg: 1.5,", "{mass_kg: 9},"), "s.yaml")
    assert brought.payload.mass_kg == 9


NESTED = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 3) | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=10,
)


@given(st.sampled_from(sorted(Scenario.model_fields)), NESTED)
@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
def test_any_section_content_gives_a_list_of_errors(section, value):
    """Any content of a section gives a list of errors."""
    data = YAML(typ="safe").load(SAMPLE) | {section: value}
    stream = io.StringIO()
    YAML(typ="safe").dump(data, stream)
    try:
        parsed = scenario.parse(stream.getvalue(), "s.yaml")
    except ScenarioError as error:
        assert all(line.startswith("s.yaml:") for line in str(error).splitlines())
    else:
        assert isinstance(parsed, Scenario)


# Settings in Python ---------------------------------------------------------------------------------------------------

PAPER = scenario.load_scenario("paper")


@pytest.mark.parametrize(
    ("change", "answer"),
    [
        ({"agents": []}, "agents: must have at least 1 value, got 0 values"),
        ({"seed": -1}, "seed: must be from 0 to"),
        ({"duration_s": 5.0}, r"learning.end_s \[s\]: must not exceed duration_s = 5, got 10"),
        ({"sed": 1}, "sed: is not a setting here; did you mean 'seed'?"),
        ({"disturbances": [{"kind": "jett"}]}, r"disturbances\[0\]: kind must be one of .* did you mean 'jet'?"),
        (
            {"disturbances": [{"kind": "wind", "name": "a", "acts_on": "payload", "mean_wind_mps": [0.0, 0.0, 999.0]}]},
            r"disturbances\[0\].mean_wind_mps\[2\] \[m/s\]: must be from -340 to 340 \(the speed of sound\), got 999",
        ),
    ],
)
def test_python_settings_have_the_same_errors(change, answer):
    data = PAPER.model_dump() | change
    for make in (
        lambda: Scenario(**data),
        lambda: Scenario.model_validate(data),
        lambda: PAPER.model_copy(update=change),
    ):
        with pytest.raises(ScenarioError, match=f"^{answer}") as e:
            make()
        assert "pydantic" not in str(e.value)


def test_python_sections_have_the_same_errors():
    kind = PAPER.agent_types["two_arms"].model_dump()
    with pytest.raises(ScenarioError, match=r"^arms: must have at least 1 value, got 0 values$"):
        AgentType(**kind | {"arms": []})
    with pytest.raises(ScenarioError, match=r"^agent_types.two_arms.arms: must have at least 1 value, got 0 values$"):
        Scenario(**PAPER.model_dump() | {"agent_types": {"two_arms": kind | {"arms": []}}})
    with pytest.raises(ScenarioError, match=r"^scenario: must be JSON"):
        Scenario.model_validate_json("{")
    with pytest.raises(ScenarioError) as e:
        Body(mass_kg=-1.0, inertia_kgm2=(1.0, 1.0, 5.0))  # ty: ignore[invalid-argument-type]
    assert [line.partition(":")[0] for line in str(e.value).splitlines()] == ["mass_kg [kg]", "inertia_kgm2 [kg m²]"]


# Documentation --------------------------------------------------------------------------------------------------------


def test_settings_page_is_up_to_date():
    page = (Path(__file__).parents[3] / "docs" / "scenarios.md").read_text(encoding="utf-8")
    lines = page.partition("<!-- settings -->\n")[2]
    assert lines.strip() == markdown(Scenario, AgentTypeFromUrdf, WaypointsFromFile, SampledFromFile).strip(), (
        "rebuild it: .venv/bin/python docs/settings.py"
    )
    missing = [line for line in lines.splitlines() if line.startswith("| `") and line.rstrip().endswith("|  |")]
    assert not missing, "settings without a description"
    cells = [line.split("|")[2] for line in lines.split("## Ranges")[0].splitlines() if line.startswith("| `")]
    assert not [cell for cell in cells if re.search(r"number(?! from | between )", cell)], "numbers without a range"


def test_a_file_of_yaml_1_1_gives_no_warnings(recwarn: pytest.WarningsRecorder):
    """ruamel.yaml would print eleven lines for each number such as `3e1`."""
    settings = scenario.parse("%YAML 1.1\n---\nschema: 2\nextends: hover\nduration_s: 3e1\n", "s.yaml")
    assert settings.duration_s == 30
    assert not recwarn.list
