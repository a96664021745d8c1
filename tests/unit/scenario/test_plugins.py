"""User-defined plugins in a scenario file: import, checks, construction, and the place in every error message."""

import dataclasses
import re
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

import colift
from colift import scenario
from colift.cli.app import app
from colift.scenario import Scenario, ScenarioError
from colift.scenario.plugins import plugin_path
from tests.support import small_team as light

SAMPLE = (Path(__file__).parents[2] / "support" / "sample_scenario.yaml").read_text(encoding="utf-8")
MODULE = '''
import dataclasses
from typing import Annotated, Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float
from pydantic import Field

from colift import gp
from colift.math.pytree import pytree
from colift.scenario import Section, fields
from colift.simulation import actuators, disturbances, sensors
from colift.trajectories import lissajous


@pytree
class Scaled:
    payload_controller: Any
    share: Float[Array, ""]

    def init(self):
        return self.payload_controller.init()

    def compute(self, state, context):
        command, state = self.payload_controller.compute(state, context)
        return dataclasses.replace(command, a=self.share * command.a), state


class ScaledController(Section):
    share: Annotated[float, Field(gt=0, le=1)] = 1.0

    def build(self, controller):
        return Scaled(payload_controller=controller.payload_controller, share=self.share)


@pytree
class Hovering:
    path: lissajous.Lissajous

    def evaluate(self, t):
        return self.path.evaluate(jnp.zeros(()))


class Hover(Section):
    """A constant position."""

    position_m: fields.Position

    def build(self):
        zero, one = jnp.zeros(3), jnp.ones(3)
        return Hovering(
            path=lissajous.Lissajous(
                center=jnp.array(self.position_m), amplitude=zero, period=one, phase=zero, ramp_time=jnp.ones(()),
                R=jnp.eye(3), rotation_amplitude=zero, rotation_period=one, rotation_phase=zero,
            )
        )


@pytree
class Sway(disturbances.DisturbanceModel):
    force: Float[Array, "3"]
    time_invariant: ClassVar[bool] = False

    def __call__(self, at, t, state):
        return self.force * jnp.sin(t), jnp.zeros(3)


class SwayForce(Section):
    force_N: fields.Force

    def build(self):
        return Sway(force=jnp.array(self.force_N))


@pytree
class Late(Sway):
    def init(self):
        return jnp.zeros(3)

    def update(self, at, t, state, dt):
        return at.v


class LateForce(SwayForce):
    def build(self):
        return Late(force=jnp.array(self.force_N))


@pytree
class Offset(sensors.SensorModel):
    by: Float[Array, "3"]

    def apply(self, measurement, truth, clock, state, noise):
        payload = dataclasses.replace(measurement.payload, p=measurement.payload.p + self.by)
        return dataclasses.replace(measurement, payload=payload), state


class OffsetSensor(Section):
    by_m: fields.Position

    def build(self):
        return Offset(by=jnp.array(self.by_m))


@pytree
class Weak(actuators.IdealActuators):
    share: Float[Array, ""]

    def __call__(self, command, state, clock):
        return tuple(dataclasses.replace(c, u=self.share * c.u) for c in command), state


class WeakActuators(Section):
    share: fields.Fraction = 0.9

    def build(self, world):
        assert world.team.agent_groups
        return Weak(share=self.share)


class SamePlant(Section):
    def build(self, world):
        return world.plant


@pytree
class PositionOnly:
    """The payload's position, and an agent's center of mass."""

    def payload(self, x):
        return x[..., :3]

    def agent(self, x):
        return x[..., 9:12]

    def payload_names(self):
        return ("p_x", "p_y", "p_z")

    def agent_names(self, joints):
        return ("x_x", "x_y", "x_z")


class PositionFeatures(Section):
    def build(self):
        return PositionOnly()


@pytree
class RationalQuadratic(gp.Kernel):
    a: jnp.ndarray

    def __call__(self, r2):
        return (1 + r2 / (2 * self.a)) ** -self.a


class RationalQuadraticKernel(Section):
    a: float

    def build(self):
        return RationalQuadratic(a=jnp.asarray(self.a))


class Nothing(Section):
    def build(self, *_):
        return {"a": 1.0}


class Bare(Section):
    pass


class Plain:
    def build(self):
        pass


class NoTree:
    """No PyTree."""

    def init(self):
        return ()

    def compute(self, state, context):
        return context.setpoint.a, state


class NoTreeController(Section):
    def build(self, controller):
        return NoTree()


class FailingController(Section):
    def build(self, controller):
        raise RuntimeError("no gains")


@pytree
class Branching:
    base: Any

    def init(self):
        return self.base.init()

    def compute(self, state, context):
        if context.clock.t > 1:  # BRANCH
            return self.base.compute(state, context)
        return self.base.compute(state, context)


class BranchingController(Section):
    def build(self, controller):
        return Branching(base=controller.payload_controller)


@pytree
class ForceOnly(disturbances.DisturbanceModel):
    time_invariant: ClassVar[bool] = True

    def __call__(self, at, t, state):
        return at.v


class ForceOnlyDrag(Section):
    def build(self):
        return ForceOnly()


@pytree
class NoState(sensors.SensorModel):
    def apply(self, measurement, truth, clock, state, noise):
        return measurement


class NoStateSensor(Section):
    def build(self):
        return NoState()


@pytree
class Point:
    position: Any

    def evaluate(self, t):
        return self.position


class PointReference(Section):
    def build(self):
        return Point(position=jnp.zeros(3))


@pytree
class HalfActuators(actuators.IdealActuators):
    def __call__(self, command, state, clock):
        return command


class HalfActuatorSettings(Section):
    def build(self, world):
        return HalfActuators()
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a module of parts, of a name that no other test has."""
    path = tmp_path_factory.mktemp("own")
    (path / "plugins_of_tests.py").write_text(MODULE)
    yield path
    sys.path.remove(str(path))
    del sys.modules["plugins_of_tests"]


def read(folder: Path, more: str, text: str = SAMPLE) -> Scenario:
    (folder / "mine.yaml").write_text(text + more)
    return scenario.load_scenario(folder / "mine.yaml")


def own(name: str, settings: str = "{}") -> str:
    return f"{{kind: plugin, class_path: 'plugins_of_tests:{name}', settings: {settings}}}"


def part(name: str, settings: str = "{}") -> str:
    return own(name, settings).replace("kind: plugin, ", "")


def refused(folder: Path, more: str) -> str:
    """Return the error message of a text with one error, without `file:line`."""
    with pytest.raises(ScenarioError) as error:
        read(folder, more)
    place, _, words = str(error.value).partition(": ")
    assert place == f"{folder}/mine.yaml:{SAMPLE.count(chr(10)) + 2}", str(error.value)
    return words


def test_parts_of_every_kind_are_built_from_their_settings(folder):
    """Parts of every kind are built from their settings and fly."""

    def named(name: str, **settings: object) -> dict[str, object]:
        return {"kind": "plugin", "class_path": f"plugins_of_tests:{name}", "settings": settings}

    sway = named("SwayForce", force_N=[1, 0, 0])
    with plugin_path(folder):
        path = light.write(
            folder / "all.yaml",
            disturbances=[sway | {"name": "sway", "acts_on": "payload"}, sway | {"name": "sways", "acts_on": "agents"}],
            sensors={"models": [named("OffsetSensor", by_m=[0, 0, 0.1])]},
            reference=named("Hover", position_m=[1, 2, 3]),
            actuators=named("WeakActuators"),
            physics=named("SamePlant"),
            plugins={
                "payload_controller": {"class_path": "plugins_of_tests:ScaledController", "settings": {"share": 0.5}},
                "features": {"class_path": "plugins_of_tests:PositionFeatures"},
                "kernel": {"class_path": "plugins_of_tests:RationalQuadraticKernel", "settings": {"a": 0.7}},
            },
        )
    settings = scenario.load_scenario(path)
    plan = colift.make_experiment(settings, "C2")
    assert (
        plan.controller.residual_model.payload.X.shape[-1] == plan.controller.residual_model.agents[0].X.shape[-1] == 3
    )
    assert type(plan.controller.payload_controller).__name__ == "Scaled"
    assert plan.controller.payload_controller.share == 0.5
    assert plan.controller.payload_controller.share.dtype == float
    assert type(plan.world.actuators).__name__ == "Weak"
    assert type(plan.world.sensor_models[0]).__name__ == "Offset"
    assert [m.name for m in plan.world.disturbances.payload if not m.model.time_invariant] == ["sway"]
    recorder = dataclasses.replace(plan.controller.recorder, start=jnp.asarray(0.0))
    pilot = dataclasses.replace(plan.controller, recorder=recorder)
    flight = colift.run_experiment(dataclasses.replace(plan, controller=pilot, update_times=(0.2,), duration=0.3))
    assert not flight.termination_reason
    assert flight.updates[0].fits["payload"].lengthscales.shape == (6, 3)
    assert {type(fit.hyper.kernel).__name__ for fit in flight.updates[0].fits.values()} == {"RationalQuadratic"}
    assert (flight.uncertainty.payload_std[-1] < flight.uncertainty.payload_std[0]).all(), (
        "what was learned is seen where it was learned"
    )
    assert np.allclose(flight.records.p_d, [1.0, 2.0, 3.0])


def test_exact_residuals_are_refused_for_laws_with_a_state(folder):
    """Exact residuals are refused if a disturbance law has an internal state."""
    with plugin_path(folder):
        laws = [
            {"kind": "plugin", "class_path": f"plugins_of_tests:{law}", "settings": {"force_N": [1, 0, 0]}}
            | {"name": f"{law}_{bodies}", "acts_on": bodies}
            for law in ("SwayForce", "LateForce")
            for bodies in ("payload", "agents")
        ]
        settings = scenario.load_scenario(light.write(folder / "late.yaml", disturbances=laws))
    with pytest.raises(
        ScenarioError,
        match=r"case true_residual evaluates .* these disturbances have an internal state: "
        r"LateForce_payload, LateForce_agents$",
    ):
        colift.make_experiment(settings, "true_residual")
    assert colift.make_experiment(settings, "C1").world.disturbances.payload


def test_settings_are_part_of_what_identifies_a_run_and_survive(folder):
    """Settings are part of what identifies a run and survive a copy."""
    one, two = (
        read(folder, f"\nplugins: {{payload_controller: {part('ScaledController', f'{{share: {x}}}')}}}")
        for x in (0.5, 0.6)
    )
    assert one.digest != two.digest
    again = Scenario.model_validate_json(one.model_dump_json())
    assert again == one
    assert again.digest == one.digest
    assert one.model_copy(update={"seed": 5}).plugins == one.plugins


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("class_path: 3", "plugins.payload_controller.class_path: must be text, got 3"),
        ("class_path: 'parts:'", "plugins.payload_controller.class_path: must be `module:Name`, got 'parts:'"),
        ("class_path: 'no_such_module:A'", "there is no module 'no_such_module' in "),
        (
            "class_path: 'plugins_of_tests:ScaledControlle'",
            "plugins_of_tests has no 'ScaledControlle'; did you mean 'ScaledController'?",
        ),
        (
            "class_path: 'plugins_of_tests:Bare'",
            "must be a class that extends colift.scenario.Section and has a method",
        ),
        (
            "class_path: 'plugins_of_tests:Plain'",
            "must be a class that extends colift.scenario.Section and has a method",
        ),
        ("class_path: 'plugins_of_tests:MODULE'", "plugins_of_tests has no 'MODULE'"),
        ("class_path: 'plugins_of_tests:jnp'", "must be a class"),
        (
            "class_path: 'plugins_of_tests:ScaledController', settings: 3",
            "plugins.payload_controller.settings: must be settings by name, got 3",
        ),
        (
            "class_path: 'plugins_of_tests:ScaledController', settings: {share: 2}",
            "plugins.payload_controller.settings.share: must be at most 1, got 2",
        ),
        (
            "class_path: 'plugins_of_tests:ScaledController', settings: {share: 0}",
            "plugins.payload_controller.settings.share: must exceed 0, got 0",
        ),
        (
            "class_path: 'plugins_of_tests:ScaledController', settings: {shar: 1}",
            "is not a setting here; did you mean 'share'?",
        ),
        (
            "class_path: 'plugins_of_tests:ScaledController', setting: {}",
            "is not a setting here; did you mean 'settings'?",
        ),
        ("settings: {}", "plugins.payload_controller.class_path: is required"),
    ],
)
def test_mistakes_in_a_part_are_told_with_their_place(folder, more, says):
    assert says in refused(folder, f"\nplugins: {{payload_controller: {{{more}}}}}")


def test_a_range_of_a_part_s_quantity_says_why(folder):
    assert refused(folder, f"\nactuators: {own('WeakActuators', '{share: 3}')}") == (
        "actuators.settings.share: must be from 0 to 0.99 (a share of less than 1), got 3"
    )


@pytest.mark.parametrize(
    ("module", "code", "says"),
    [
        ("own_raises", "x = 1\nraise RuntimeError('so it is')\n", "own_raises.py:2: RuntimeError: so it is"),
        ("own_syntax", "x = 1\ny = = 2\n", "own_syntax.py:2: SyntaxError: invalid syntax"),
        ("own_import", "import no_such_thing\n", "own_import.py:1: ModuleNotFoundError: No module named 'no_such"),
    ],
)
def test_a_module_that_cannot_be_imported_says_where_and_why(folder, module, code, says):
    (folder / f"{module}.py").write_text(code)
    assert f"{module} cannot be imported: {says}" in refused(
        folder, f"\nplugins: {{payload_controller: {{class_path: '{module}:A'}}}}"
    )


def test_of_two_modules_of_one_name_the_other_is_refused(folder, tmp_path):
    read(folder, f"\nplugins: {{payload_controller: {part('ScaledController')}}}")
    (tmp_path / "plugins_of_tests.py").write_text(MODULE)
    assert "give it another name" in refused(tmp_path, f"\nplugins: {{payload_controller: {part('ScaledController')}}}")
    sys.path.remove(str(tmp_path))


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (
            f"plugins: {{payload_controller: {part('Nothing')}}}",
            "plugins.payload_controller: plugins_of_tests:Nothing built a value of type dict",
        ),
        (f"physics: {own('Nothing')}", "which does not fit colift.simulation.world.Plant"),
        (f"actuators: {own('Nothing')}", "IdealActuators: its class must extend it (docs/change_a_part.md)"),
        (f"physics: {own('Nothing')}", "Plant: it has no method forward_dynamics, step (docs/change_a_part.md)"),
    ],
)
def test_what_is_built_must_be_a_part(folder, more, says):
    settings = read(folder, "\n" + more)
    with pytest.raises(ScenarioError, match="does not fit colift") as error:
        colift.make_experiment(settings, "C1")
    assert says in str(error.value)


BRANCH_LINE = 1 + MODULE[: MODULE.index("# BRANCH")].count("\n")
DRAG = "{kind: plugin, name: drag, acts_on: agents, class_path: 'plugins_of_tests:ForceOnlyDrag'}"


@pytest.mark.parametrize(
    ("section", "value", "message"),
    [
        (
            "plugins",
            f"{{payload_controller: {part('NoTreeController')}}}",
            "plugins.payload_controller: plugins_of_tests:NoTreeController built a value of type NoTree, "
            "which is not a PyTree; decorate its class with `colift.math.pytree.pytree`",
        ),
        (
            "plugins",
            f"{{payload_controller: {part('FailingController')}}}",
            "plugins.payload_controller: plugins_of_tests:FailingController.build: RuntimeError: no gains",
        ),
        (
            "plugins",
            f"{{payload_controller: {part('BranchingController')}}}",
            f"payload_controller: Branching.compute (plugins_of_tests.py:{BRANCH_LINE}): a Python condition depends on "
            "an array; use `jnp.where` or `jax.lax.cond` instead of `if` (docs/change_a_part.md)",
        ),
        (
            "disturbances",
            f"[{DRAG}]",
            "disturbances.drag: ForceOnly.__call__: the result is float64[3]; must be (float64[3], float64[3]) "
            "(docs/change_a_part.md)",
        ),
        (
            "sensors",
            f"{{models: [{own('NoStateSensor')}]}}",
            "sensors.models.0: NoState.apply: returned Measurement; must return (result, next state) "
            "(docs/change_a_part.md)",
        ),
        (
            "reference",
            own("PointReference"),
            "reference: Point.evaluate: the result is float64[3]; must be PayloadSetpoint (docs/change_a_part.md)",
        ),
        (
            "actuators",
            own("HalfActuatorSettings"),
            "actuators: HalfActuators.__call__: returned (AgentInput); must return (result, next state) "
            "(docs/change_a_part.md)",
        ),
    ],
)
def test_parts_that_do_not_fit_are_refused_before_a_flight(folder, section, value, message):
    """The command line reports part, method, what is required and what was returned, in one line."""
    text = re.sub(rf"^{section}:.*\n(  .*\n)*", "", SAMPLE, flags=re.MULTILINE)
    settings = read(folder, f"\n{section}: {value}\n", text)
    with pytest.raises(ScenarioError) as error:
        colift.make_experiment(settings, "C1")
    assert str(error.value) == message
    done = CliRunner().invoke(app, ["study", str(folder / "mine.yaml"), "--quiet", "--out", str(folder / "out")])
    assert (done.exit_code, done.stderr) == (2, f"{message}\n")


def test_a_scenario_without_parts_of_one_s_own_leaves_the_import(tmp_path):
    """A scenario without parts of one is own leaves the import path alone."""
    before = list(sys.path)
    read(tmp_path, "")
    assert sys.path == before


def test_random_residuals_need_a_built_in_reference(folder):
    path = f"reference: {own('Hover', '{position_m: [0, 0, 1]}')}\n"
    text = re.sub(r"^reference:\n(  .*\n)*", path, SAMPLE, flags=re.MULTILINE)
    read(folder, "", text)
    with pytest.raises(ScenarioError, match="random_residual: must be omitted with a user-defined reference"):
        read(folder, "\nrandom_residual: {rkhs_norm: 2}\n", text)
