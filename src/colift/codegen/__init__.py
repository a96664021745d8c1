"""C code generation from jaxprs: compile a JAX function for the CPU and vectorize it over a batch.

`jax.make_jaxpr` traces the function, and `loop_fusion` forms loops over agents and large arrays. `interpret` evaluates
the jaxpr on the symbolic scalars of `graph`. `emit` writes C; `build` compiles and caches it. The result is called
through `jax.ffi`. JAX defines the value and the derivatives, so no second description
of the model exists. A function is compiled for one sample, or for as many samples as fit a vector register.

Example:
    >>> import jax, jax.numpy as jnp
    >>> from colift import codegen
    >>> f = jax.jit(codegen.compile(lambda x: jnp.sin(x) * x))
    >>> f(jnp.ones(3)).shape
    (3,)

See Also:
    docs/decisions/0002-generate-c-from-jaxprs.md: the reasons for this design and its measured cost.
"""

from __future__ import annotations

import ctypes
import functools
import json
import logging
from collections.abc import Callable, Collection, Sequence
from importlib import resources
from typing import Any, NamedTuple

import jax
import jax.ffi
import numpy as np

from colift.codegen import (
    build,
    elementwise,
    emit,
    indexing,
    jax_internals,
    linalg,
    liveness,
    loops,
    program_cache,
    reduction,
    shape_rules,
)
from colift.codegen.blocks import Function
from colift.codegen.build import CompilerError
from colift.codegen.equations import batch_axes, evaluate_with_jax
from colift.codegen.fingerprint import jaxpr_digest
from colift.codegen.graph import Graph
from colift.codegen.interpret import interpret
from colift.codegen.jax_internals import Program, UnsupportedPrimitive
from colift.codegen.layout import FunctionLayout
from colift.codegen.vmap_primitive import trace

__all__ = ["CompilerError", "UnsupportedPrimitive", "compile", "read_arguments", "source"]

RULES = (elementwise, shape_rules, indexing, reduction, linalg, loops)  # each registers its rules on import

program_cache.install()

log = logging.getLogger(__name__)

native_p = jax_internals.new_primitive("native")

MAX_GROUPED_SIZE = 1024  # elements; a larger argument is passed on its own, which avoids a copy
TYPES = ("float64", "int64", "int32", "uint32", "bool")


def compile(f: Callable[..., Any], *, threads: int | None = None) -> Callable[..., Any]:  # noqa: A001
    """Compile a JAX function to native code that is usable under `jit`, `vmap` and `grad`.

    The value equals that of `f` to rounding. Derivatives and devices other than a CPU use `f` itself. So does a host
    without a C compiler, or one that cannot load the library. A function with side effects, or with an operation that
    has no rule or another form in the installed version of JAX, also runs on JAX. One warning states each reason.

    Constants that `f` closes over become literals in the code, so varying numbers must be arguments. Integers are
    carried as doubles: a call fails with a JAX runtime error if one exceeds 2^53 or the range of its type.

    The first call raises `OverflowError` for a constant integer out of range. It raises `TypeError` for other array
    types or a traced constant. It raises `CompilerError` if the C compiler fails.

    Args:
        f: Function of PyTrees of float64, integer or boolean arrays; returns such a PyTree.
        threads: Maximum number of threads for a batch; default: the processors available to this process.

    Returns:
        A function with the signature of `f`. Under `vmap`, each argument may have a batch axis or not.

    Raises:
        ValueError: If `threads` is less than 1.

    Example:
        >>> import jax, jax.numpy as jnp
        >>> norms = jax.jit(jax.vmap(compile(lambda x: jnp.sqrt(x @ x))))
        >>> norms(jnp.ones((5, 4))).tolist()
        [2.0, 2.0, 2.0, 2.0, 2.0]
    """
    limit = threads if threads is not None else build.available_cores()
    if limit < 1:
        raise ValueError(f"threads is {limit}, must be at least 1")

    @functools.cache
    def traced(tree: Any, avals: tuple[Any, ...]) -> tuple[Any, Any] | None:
        try:
            jaxpr, out = trace(f, tree, avals)
            constants = Program.from_jaxpr(jaxpr).constants
        except UnsupportedPrimitive as error:
            _warn_unsupported(str(error))
            return None
        if any(map(jax_internals.is_traced, constants)):
            raise TypeError(f"codegen.compile: {f} closes over a traced value; pass it as an argument")
        if effects := jax_internals.side_effects(jaxpr):
            _warn_unsupported(f"codegen: side effects ({effects}) are not supported")
            return None
        return jaxpr, out

    @functools.wraps(f)
    def compiled(*args: Any) -> Any:
        if jax_internals.MISSING:
            _warn_unsupported(jax_internals.MISSING)
            return f(*args)
        leaves, tree = jax.tree.flatten(args)
        avals = tuple(jax.ShapeDtypeStruct(np.shape(x), jax.dtypes.result_type(x)) for x in leaves)
        found = traced(tree, avals)
        if found is None:
            return f(*args)
        jaxpr, out = found
        return jax.tree.unflatten(out, native_p.bind(*leaves, jaxpr=jaxpr, threads=limit))

    return compiled


def read_arguments(f: Callable[..., Any], *args: Any) -> frozenset[int] | None:
    """Return the arguments that the native code of a batch reads.

    Args:
        f: Function from `compile`.
        *args: Arguments of one sample.

    Returns:
        Indices of the leaves of `args`; None if the function runs on JAX.
    """
    with jax_internals.readable("jaxpr"):
        equations = Program.from_jaxpr(jax.make_jaxpr(f)(*args)).equations
    jaxpr = next((e.eqn.params["jaxpr"] for e in equations if e.name == native_p.name), None)
    if jaxpr is None:
        return None
    try:
        build.require_compiler()
        return frozenset(k for group in _target(jaxpr, True)[1] for k in group)
    except (build.LibraryUnavailable, UnsupportedPrimitive):
        return None


def _batch_shape(args: Sequence[Any], jaxpr: Any) -> tuple[int, ...]:
    """Return the broadcast shape of the batch axes; empty for one sample."""
    axes = batch_axes(args, jaxpr)
    return np.broadcast_shapes(*(np.shape(a)[:axes] for a in args)) if axes else ()


def _abstract(*args: Any, jaxpr: Any, threads: int) -> list[Any]:  # noqa: ARG001
    """Return the abstract results of the primitive."""
    batch = _batch_shape(args, jaxpr)
    return [jax_internals.abstract_array((*batch, *v.shape), v.dtype) for v in Program.from_jaxpr(jaxpr).outputs]


def _batch(args: Sequence[Any], dims: Sequence[int | None], **params: Any) -> tuple[Any, list[int]]:
    """Batching rule: move each batch axis to the front; shared arguments get an axis of length one."""
    move = [x[None] if d is None else jax.numpy.moveaxis(x, d, 0) for x, d in zip(args, dims, strict=True)]
    out = native_p.bind(*move, **params)
    return out, [0] * len(out)


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], **params: Any) -> tuple[Any, Any]:
    """Differentiation rule: the derivative of the JAX function."""
    f = functools.partial(evaluate_with_jax, **params)
    return jax.jvp(f, tuple(primals), jax_internals.dense_tangents(tangents))


def _call_library(*args: Any, jaxpr: Any, threads: int) -> list[Any]:
    """Call the compiled library.

    The small arguments of one sample are concatenated to one array per type. Each array costs about 0.2 us per call in
    a loop of XLA. Results stay separate: splitting a concatenated result costs more than it saves.

    Returns:
        The results.
    """
    batch, batched = _batch_shape(args, jaxpr), batch_axes(args, jaxpr) > 0
    name, groups = _target(jaxpr, batched)
    joined = [
        args[group[0]] if batched else jax.numpy.concatenate([args[k].ravel() for k in group]) for group in groups
    ]
    results = [jax.ShapeDtypeStruct((*batch, *v.shape), v.dtype) for v in Program.from_jaxpr(jaxpr).outputs]
    return list(jax.ffi.ffi_call(name, results)(*joined, threads=np.int64(threads)))


def _group_arguments(avals: Sequence[Any], used: Sequence[bool], batched: bool) -> list[list[int]]:
    """Group the used arguments that are passed as one array: small ones of one type; none of a batch."""
    kinds = {k: k if batched or v.size > MAX_GROUPED_SIZE else v.dtype.name for k, v in enumerate(avals) if used[k]}
    return [[k for k, kind in kinds.items() if kind == one] for one in dict.fromkeys(kinds.values())]


def _lower(ctx: Any, *args: Any, **params: Any) -> Any:
    """Lowering rule for the CPU: the compiled library, or JAX if native code is unavailable."""
    try:
        build.require_compiler()
        return jax_internals.lowering(_call_library)(ctx, *args, **params)
    except build.LibraryUnavailable as error:
        _warn_fallback(f"{error}: native code runs on JAX instead, 10 to 100 times slower")
    except UnsupportedPrimitive as error:
        _warn_unsupported(str(error))
    return jax_internals.lowering(evaluate_with_jax)(ctx, *args, **params)


def _warn_unsupported(reason: str) -> None:
    """Warn once per reason that functions run on JAX."""
    _warn_fallback(f"{reason}: functions with this operation run on JAX, 4 to 100 times slower than native code")


@functools.cache
def _warn_fallback(message: str) -> None:
    """Log a warning, each message once."""
    log.warning("%s", message)


@functools.cache
def _target(jaxpr: Any, batched: bool) -> tuple[str, list[list[int]]]:
    """Emit, compile and register a function; return its XLA target name and its argument groups.

    The library stores its argument groups, so a cached library is used without emitting the C source again.

    Returns:
        Target name and argument groups.
    """
    name = build.key(jaxpr_digest(jaxpr), str(batched))
    shared = build.library(name, lambda: source(jaxpr, batched))
    groups = json.loads(ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(shared, "colift_argument_groups"))))
    jax.ffi.register_ffi_target(f"colift_{name}", jax.ffi.pycapsule(shared.colift_native), platform="cpu")
    return f"colift_{name}", groups


class Kernel(NamedTuple):
    """C text of a function and its interface; the parameters are the arguments, then the results.

    Attributes:
        text: C definitions, callees first.
        name: Name of the C function.
        arguments: Indices of the arguments that are parameters.
        results: Indices of the results that are parameters.
        widths: Vector widths that the text uses; `lanes_header` provides their types and functions.
    """

    text: str
    name: str
    arguments: list[int]
    results: list[int]
    widths: list[int]


def kernel(
    jaxpr: Any,
    lanes: int = 1,
    agent_lanes: int = 1,
    stack_bytes: int = emit.STACK_BYTES,
    in_place_results: Collection[tuple[int, int]] = (),
) -> Kernel:
    """Generate the C functions of a jaxpr without the interface to XLA.

    Raises `UnsupportedPrimitive` for an operation without a rule and `OverflowError` for a constant integer out of
    range.

    Args:
        jaxpr: Jaxpr of a function of float64, integer or boolean arrays, from `jax.make_jaxpr`.
        lanes: Samples per vector; 1 for a single sample.
        agent_lanes: Agents or rows per vector inside loops of a single sample.
        stack_bytes: Maximum size of the arrays of one C function on the stack; larger ones are allocated.
        in_place_results: Pairs of result and argument. The result is written into the argument if only some of its
            elements change.

    Returns:
        The C text and its interface.

    Raises:
        TypeError: If an argument or result has another array type.
    """
    if jax_internals.MISSING:
        raise UnsupportedPrimitive(jax_internals.MISSING)
    program = Program.from_jaxpr(jaxpr)
    for v in (*program.inputs, *program.outputs):
        if v.dtype.name not in TYPES:
            raise TypeError(f"codegen: arrays must be of type {', '.join(TYPES)}; got {v.dtype.name}")
    g = Graph()
    nodes = []
    for k, v in enumerate(program.inputs):
        own = g.array(v.size, "in", k)
        nodes.append((g.map("flag", own) if v.dtype == bool else own).reshape(v.shape))
    outputs = interpret(g, program.without_dead_code(), nodes)
    function = Function(
        inputs=tuple(v.size for v in program.inputs),
        graph=g,
        outputs=[g.as_numbers(x) for x in outputs],
    )
    live = liveness.analyze_liveness(function, liveness.all_elements(function.outputs))
    unit = emit.TranslationUnit(agent_lanes, stack_bytes)
    written = tuple((k, j) for k, j in in_place_results if liveness.writes_in_place(function, live, k, j))
    name = unit.add(function, live, FunctionLayout(lanes, written=written))
    return Kernel(
        text=unit.functions(),
        name=name,
        arguments=[k for k, used in enumerate(live.used) if used.any() or k in {j for _, j in written}],
        results=[k for k, required in enumerate(live.required) if required.any() and k not in {k for k, _ in written}],
        widths=sorted(unit.widths),
    )


def lanes_header(widths: Sequence[int]) -> str:
    """Return the C types and functions for vectors of several widths.

    Args:
        widths: Numbers of lanes, `Kernel.widths`.

    Returns:
        C text; one copy of `lanes.h` per width.
    """
    text = resources.files("colift.codegen").joinpath("lanes.h").read_text()
    one = "#define WIDTH_{w} 1\n#define AT_{w}(x, l) (x)"
    many = "#define WIDTH_{w} {w}\n#define AT_{w}(x, l) (x)[l]"
    lanes = f"#if LANES == 1 || defined ONE_LANE\n{one}\n#else\n{many}\n#endif"
    return "\n".join(f"#define LANES {w}\n{lanes.format(w=w)}\n{text}" for w in widths)


def source(jaxpr: Any, batched: bool) -> str:
    """Return the C source of a function with its XLA entry point.

    Args:
        jaxpr: Jaxpr of a function of float64, integer or boolean arrays, from `jax.make_jaxpr`.
        batched: Whether the lanes of a vector hold samples of a batch; otherwise agents of one sample.

    Returns:
        The complete C translation unit.
    """
    width = build.lanes() if batched else 1
    made = kernel(jaxpr, width, 1 if batched else build.lanes())
    inputs, results = Program.from_jaxpr(jaxpr).inputs, Program.from_jaxpr(jaxpr).outputs
    groups = _group_arguments(inputs, [k in made.arguments for k in range(len(inputs))], batched)
    sizes = [[inputs[k].size for k in group] for group in groups]
    starts = [np.cumsum([0, *size]) for size in sizes]
    pointers = {k: f"in[{i}] + {at}" for i, p in enumerate(groups) for k, at in zip(p, starts[i], strict=False)}
    args = [pointers[k] for k in made.arguments] + [f"out[{k}]" for k in made.results]
    files = resources.files("colift.codegen")
    numbers = lambda x: ", ".join(map(str, x)) or "0"  # noqa: E731
    return "\n".join([
        files.joinpath("prelude.h").read_text(),
        lanes_header(made.widths),
        made.text,
        f"#if IN(0)\n#define WIDTH {width}\n#define V V_{width}\n#define SPLAT splat_{width}",
        f"#define ARGUMENTS {len(groups)}\n#define RESULTS {len(results)}",
        f"#define RESULT_RANK {len(results[0].shape)}",
        f"static const int64_t ARGUMENT_SIZE[] = {{{numbers(map(sum, sizes))}}};",
        f"static const int64_t RESULT_SIZE[] = {{{numbers(v.size for v in results)}}};",
        f"static void KERNEL(V **in, V **out) {{ {made.name}({', '.join(args)}); }}",
        files.joinpath("ffi.h").read_text(),
        f'__attribute__((visibility("default"))) const char colift_argument_groups[] = "{json.dumps(groups)}";',
        "#endif",
    ])  # fmt: skip


@functools.cache
def _jitted(**params: Any) -> Callable[..., Any]:
    """Return the jitted primitive, for calls outside of `jax.jit`."""
    return jax.jit(functools.partial(native_p.bind, **params))


jax_internals.define_primitive(
    native_p,
    implementation=lambda *args, **params: _jitted(**params)(*args),
    abstract=_abstract,
    jvp=_jvp,
    batch=_batch,
    lower=evaluate_with_jax,
    lower_on_cpu=_lower,
)
