"""Versions of JAX with other primitives or parameters: the function runs on JAX, and one warning states the reason."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import colift
from colift import codegen
from colift.codegen import elementwise, jax_internals
from colift.codegen.axis_analysis import _AXIS_RULES
from colift.codegen.graph import FOLD, LIBM
from colift.codegen.interpret import RULES
from colift.math.vmap import vmap_agents

X = jnp.asarray([0.3, -0.2, 0.7])
INTERNAL = ("jax.core", "jax.extend", "jax.interpreters", "jax._src", "jaxlib")

pytestmark = pytest.mark.jax_fallback


@pytest.fixture(autouse=True)
def _new_process(monkeypatch, tmp_path):
    """An empty cache, and no warning logged before."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    codegen._warn_fallback.cache_clear()


def runs_on_jax(caplog, f, *args) -> str:
    """Compare a compiled function with JAX, alone and in a batch; return the only warning."""
    np.testing.assert_array_equal(jax.jit(codegen.compile(f))(*args), jax.jit(f)(*args))
    many = [jnp.stack([x, 2 * x]) for x in args]
    np.testing.assert_array_equal(jax.jit(jax.vmap(codegen.compile(f)))(*many), jax.jit(jax.vmap(f))(*many))
    (line,) = caplog.messages
    assert line.endswith("functions with this operation run on JAX, 4 to 100 times slower than native code")
    return line


def test_no_other_module_imports_internals_of_jax():
    """Every use of undocumented names of JAX is in `codegen.jax_internals`."""
    root, found = Path(colift.__file__).parent, []
    for path in root.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [f"{node.module}.{alias.name}" for alias in node.names] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [ast.unparse(node).replace('sys.modules["jax"]', "jax")] if isinstance(node, ast.Attribute) else []
            found += [path.name for name in names if name.startswith(INTERNAL) or "_src." in name]
    assert set(found) == {"jax_internals.py"}


def test_rules_of_loops_have_rules_of_elements():
    """An equation that becomes a part of a loop is never evaluated by JAX with parameters of the whole array."""
    assert set(_AXIS_RULES) - {"agent_map"} <= RULES.keys() | set(LIBM) | set(FOLD)


def test_an_unknown_primitive_is_named(monkeypatch, caplog):
    monkeypatch.delitem(RULES, "cumsum")
    line = runs_on_jax(caplog, lambda x: jnp.cumsum(jnp.sin(x)), X)
    assert line.startswith("codegen: primitive 'cumsum' is not supported, at ")
    assert "test_jax_internals.py" in line


def test_unknown_primitives_of_agents_and_inner_functions(monkeypatch, caplog):
    """A map over agents and a compiled function inside of the function also run on JAX."""
    monkeypatch.delitem(RULES, "sort", raising=False)
    inner = codegen.compile(jnp.sin)
    assert "'sort'" in runs_on_jax(caplog, lambda x: vmap_agents(lambda a: jnp.sort(inner(x)) * a)(x).sum(), X)


@pytest.mark.parametrize("parameters", [("axis", "reverse", "direction"), ()])
def test_changed_parameters_are_named(parameters, monkeypatch, caplog):
    """A parameter that a rule requires is missing, or JAX has one that the rule does not consider."""
    monkeypatch.setitem(jax_internals.PARAMETERS, "cumsum", parameters)
    line = runs_on_jax(caplog, lambda x: jax.lax.cumsum(x, reverse=True), X)
    found = r"another form (LookupError: no parameter 'direction')" if parameters else "has the unknown parameter "
    assert line.startswith(f"codegen: 'cumsum' of JAX {jax.__version__} ")
    assert found in line
    assert "test_jax_internals.py" in line


@pytest.mark.parametrize("error", [AttributeError("mode"), KeyError("axis"), TypeError("int"), ValueError("shape")])
def test_a_rule_that_cannot_read_an_equation(error, monkeypatch, caplog):
    def fail(*_):
        raise error

    monkeypatch.setitem(RULES, "cumsum", fail)
    line = runs_on_jax(caplog, jnp.cumsum, X)
    assert f"'cumsum' of JAX {jax.__version__} has another form ({type(error).__name__}: " in line


def test_results_of_another_shape_are_refused(monkeypatch, caplog):
    monkeypatch.setitem(RULES, "square", lambda g, eqn, a: elementwise._square(g, eqn, a)[:1])
    assert "AssertionError: shapes [(1,)] instead of [(3,)]" in runs_on_jax(caplog, jnp.square, X)


def test_sizes_of_a_scan_in_both_forms(monkeypatch, caplog):
    """JAX 0.10 has two numbers, later versions a tree; a tree of another form is refused."""
    params = {"jaxpr": None, "length": 2, "reverse": False}
    tree = SimpleNamespace(unpack=lambda: ((None,), (None, None), ()))
    read = jax_internals._under_known_names
    for one in ({"num_consts": 1, "num_carry": 2}, {"ft_in": tree}):
        found = read("scan", params | one)
        assert (found["num_consts"], found["num_carry"]) == (1, 2)
    monkeypatch.setattr(jax_internals, "_under_known_names", lambda name, p: read(name, p | {"ft_in": (1, 2)}))
    assert "'scan' of JAX" in runs_on_jax(caplog, lambda x: jax.lax.scan(lambda c, y: (c + y, c), x[0], x)[1], X)


def test_side_effects_are_kept(capfd, caplog):
    def f(x):
        jax.debug.print("seen {}", x[0])
        return 2 * x

    np.testing.assert_array_equal(jax.jit(codegen.compile(f))(X), 2 * X)
    jax.effects_barrier()
    assert capfd.readouterr().out == "seen 0.3\n"
    (line,) = caplog.messages
    assert line.startswith("codegen: side effects (")


def test_without_a_name_of_jax_nothing_is_compiled(monkeypatch, caplog):
    monkeypatch.setattr(jax_internals, "MISSING", "JAX 9: cannot import name 'Jaxpr'")
    assert runs_on_jax(caplog, jnp.sin, X).startswith("JAX 9: cannot import name 'Jaxpr': ")
    with pytest.raises(codegen.UnsupportedPrimitive, match="cannot import name"):
        codegen.kernel(jax.make_jaxpr(jnp.sin)(X))


PROGRAM = """
import jax.interpreters.{module}
del jax.interpreters.{module}.{name}
import jax.numpy as jnp
from colift import codegen
from colift.math.vmap import vmap_agents
print(codegen.compile(lambda x: vmap_agents(jnp.sin)(x).sum())(jnp.zeros(3)))
"""


@pytest.mark.parametrize(("module", "name"), [("partial_eval", "dce_jaxpr"), ("mlir", "register_lowering")])
def test_a_version_of_jax_without_a_name_imports(module, name):
    program = [sys.executable, "-c", PROGRAM.format(module=module, name=name)]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    assert done.stdout == "0.0\n"
    assert f"cannot import name '{name}'" in done.stderr
    assert "Traceback" not in done.stderr
