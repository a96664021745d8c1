"""Roofline bound of the computing time: operations of the emitted graph over the measured peak rate.

The native back end emits a graph of scalar operations, including loops. An addition, subtraction, multiplication,
division or square root is one operation; sines and cosines are counted separately (a pair is one call). The peak is the
rate of a 1500 x 1500 matrix product on one thread in the same run, with full vector lanes and fused multiply-adds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks import Outcome, gp, plant, rounds
from colift import codegen
from colift.codegen import liveness
from colift.codegen.blocks import Function, Map, Scan
from colift.codegen.graph import Graph
from colift.codegen.interpret import interpret
from colift.codegen.jax_internals import Program
from colift.codegen.vmap_primitive import trace
from colift.math.vmap import vmap_agents
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import AgentState, State, zero_residual
from colift.simulation import contact_dynamics

ARITHMETIC = ("add", "sub", "mul", "div", "sqrt")
BATCH = 1024


def operations(f: Callable[..., Any], *args: Any) -> Counter[str]:
    """Return the number of each scalar operation in one call of `f`, as emitted."""
    leaves, tree = jax.tree.flatten(args)
    jaxpr, _ = trace(f, tree, [jax.ShapeDtypeStruct(np.shape(x), jax.dtypes.result_type(x)) for x in leaves])
    g = Graph()
    program = Program.from_jaxpr(jaxpr)
    nodes = [g.array(v.size, "in", k).reshape(v.shape) for k, v in enumerate(program.inputs)]
    outputs = [x.ravel() for x in interpret(g, program, nodes)]
    function = Function(inputs=tuple(v.size for v in program.inputs), graph=g, outputs=outputs)
    return _count(function, liveness.analyze_liveness(function, liveness.all_elements(outputs)))


def _count(function: Function, need: liveness.Liveness) -> Counter[str]:
    g = function.graph
    live = [g.code[node] for node in np.flatnonzero(need.nodes).tolist() if node in g.code]
    found = Counter(op for op, *_ in live if op in ARITHMETIC)
    found["sincos"] = len({argument for op, argument, *_ in live if op in ("sin", "cos")})
    for block, call in need.calls.items():
        b = g.blocks[block]
        length = b.length if isinstance(b, Map | Scan) else 1
        for f, inner in zip(b.functions, call.functions, strict=True):
            for op, times in _count(f, inner).items():
                found[op] += times * length
    return found


def stages() -> dict[str, Callable[..., Any]]:
    """Return cumulative stages of one evaluation; the cost of a stage is its difference to the one before."""

    def geometry(team: Team, z: State, _u: contact_dynamics.TeamInputs) -> Any:
        return vmap_agents(aerial_manipulator.forward_kinematics)(team.agent_groups[0], z.agents[0].r)

    def mass(team: Team, z: State, _u: contact_dynamics.TeamInputs) -> Any:
        return vmap_agents(
            lambda agent, r: aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r))
        )(team.agent_groups[0], z.agents[0].r)

    def bias(team: Team, z: State, _u: contact_dynamics.TeamInputs) -> Any:
        def one(agent: AerialManipulator, a: AgentState) -> Any:
            g = aerial_manipulator.forward_kinematics(agent, a.r)
            q = aerial_manipulator.centroidal_model(agent, g)
            return q, aerial_manipulator.bias_forces(agent, g, q, a.omega, a.r_dot)

        return vmap_agents(one)(team.agent_groups[0], z.agents[0])

    def forced(team: Team, z: State, u: contact_dynamics.TeamInputs) -> Any:
        f = zero_residual(team).agents[0]
        of_agents = vmap_agents(contact_dynamics._forced, in_axes=(0, 0, None, 0, 0, None))
        return of_agents(team.agent_groups[0], z.agents[0], z.payload, u[0], f, team.gravity)

    def eliminated(team: Team, z: State, u: contact_dynamics.TeamInputs) -> Any:
        return vmap_agents(contact_dynamics._eliminate)(forced(team, z, u))

    def whole(team: Team, z: State, u: contact_dynamics.TeamInputs) -> Any:
        return contact_dynamics.forward_dynamics(team, z, u, zero_residual(team))

    return {
        "geometry of the tree": geometry,
        "mass matrix, Jacobians": mass,
        "bias": bias,
        "forces, contact frames": forced,
        "elimination of the agents": eliminated,
        "payload 6 x 6, back-substitution": whole,
    }


def run(seconds: float) -> Outcome:
    """Print the counts for the reference team and the measured step."""
    case = plant.supported_team(2)
    rows, before = {}, Counter()
    for name, f in stages().items():
        so_far = operations(f, *case)
        rows[name] = Counter({op: so_far[op] - before[op] for op in so_far})
        before = so_far
    rows["one evaluation"] = before
    rows["projection"] = operations(contact_dynamics.project_to_constraints, *case[:2])
    rows["one step"] = operations(plant.step, *case, jnp.array(plant.DT))
    with threadpool_limits(1):
        rate = gp.dgemm_rate()
    args = (*case, jnp.array(plant.DT))
    one = jax.jit(codegen.compile(plant.rollout(200), threads=1))
    many = jax.jit(jax.vmap(codegen.compile(plant.rollout(5), threads=1)))
    tiled = jax.tree.map(lambda x: jnp.repeat(x[None], BATCH, 0), args)
    times = rounds(
        {
            "one team": (lambda: jax.block_until_ready(one(*args)), 200),
            f"{BATCH} teams": (lambda: jax.block_until_ready(many(*tiled)), 5 * BATCH),
        },
        seconds,
    )
    flops = {name: sum(found[op] for op in ARITHMETIC) for name, found in rows.items()}
    bound = float(flops["one step"] / rate)
    print(f"{'':<34} {'operations':>10} {'of which':>9} {'sincos':>7}")
    for name, found in rows.items():
        print(f"{name:<34} {flops[name]:>10} {found['div'] + found['sqrt']:>5} / √ {found['sincos']:>7}")
    print(f"matrix product, one thread: {rate / 1e9:.1f} GFLOP/s; roofline bound of a step {bound * 1e6:.3g} us")
    measured = {name: float(np.median(t)) for name, t in times.items()}
    for name, t in measured.items():
        print(f"  {name}: {t * 1e6:.3g} us per step, {t / bound:.1f} times the bound")
    return Outcome(
        {
            "counts": {name: dict(found) for name, found in rows.items()},
            "operations": flops,
            "gflop_per_second": float(rate) / 1e9,
            "roofline_time_per_step_us": bound * 1e6,
            "time_per_step_us": {name: t * 1e6 for name, t in measured.items()},
            "time_over_roofline": {name: t / bound for name, t in measured.items()},
        }
    )
