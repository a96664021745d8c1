"""The native back end: a JAX function as C, for the CPU, vectorized over a batch.

The function is traced to a jaxpr as `jax.jit` would, the jaxpr is evaluated on symbolic scalars (`interpret`,
`graph`), and what remains is written as C (`emit`), compiled by the host's compiler, cached (`build`), and called
through `jax.ffi`. There is no second description of any model: JAX's value is the definition, and its
derivatives are JAX's. Code is made for one sample, and for as many side by side as fit the processor's vectors.
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
import jax.core
import jax.ffi
import numpy as np
from jax.extend import core
from jax.interpreters import ad, batching, mlir, partial_eval

from colift.codegen import build, elementwise, emit, indexing, linalg, liveness, loops, reduction, shape_rules
from colift.codegen.blocks import Function
from colift.codegen.build import CompilerError
from colift.codegen.equations import batch_axes, evaluate_with_jax
from colift.codegen.fingerprint import jaxpr_digest
from colift.codegen.graph import Graph
from colift.codegen.interpret import UnsupportedPrimitive, interpret
from colift.codegen.layout import FunctionLayout
from colift.codegen.vmap_primitive import trace

__all__ = ["CompilerError", "UnsupportedPrimitive", "compile", "source"]

RULES = (elementwise, shape_rules, indexing, reduction, linalg, loops)  # each registers its own

log = logging.getLogger(__name__)

native_p = core.Primitive("native")
native_p.multiple_results = True

MAX_GROUPED_SIZE = 1024  # elements: an argument of more travels alone, and is not copied
TYPES = ("float64", "int64", "int32", "uint32", "bool")


def compile(f: Callable[..., Any], *, threads: int | None = None) -> Callable[..., Any]:  # noqa: A001
    """`f` in native code: same arguments, same value to rounding, usable under `jit`, `vmap` and `grad`.

    Arguments and results are PyTrees of float64, integer or boolean arrays. Under `vmap`, samples are
    cut among `threads` threads (default: the processors this process may use); every argument may have a batch
    axis or not. Numbers `f` closes over are folded into the code; numbers that vary are to be arguments.
    Derivatives, and devices other than a CPU, use `f` itself, as does everything where no C compiler is found or no
    library can be loaded (one warning says so). Integers are JAX's as long as they stay below 2^53 and in the range of
    their type; a call in which one does not is an error of JAX's. Raises `UnsupportedPrimitive` for what the emitter
    does not know, `OverflowError` for a known integer out of range, `TypeError` for other types, `CompilerError` where
    the C compiler does not work.
    """
    limit = threads if threads is not None else build.available_cores()
    if limit < 1:
        raise ValueError(f"threads: {limit}; at least 1 is required")

    @functools.cache
    def traced(tree: Any, avals: tuple[Any, ...]) -> tuple[core.ClosedJaxpr, Any]:
        jaxpr, out = trace(f, tree, avals)
        if any(isinstance(c, jax.core.Tracer) for c in jaxpr.consts):
            raise TypeError(f"native.compile: {f} closes over a traced value; pass it as an argument")
        return jaxpr, out

    @functools.wraps(f)
    def compiled(*args: Any) -> Any:
        leaves, tree = jax.tree.flatten(args)
        avals = tuple(jax.ShapeDtypeStruct(np.shape(x), jax.dtypes.result_type(x)) for x in leaves)
        jaxpr, out = traced(tree, avals)
        return jax.tree.unflatten(out, native_p.bind(*leaves, jaxpr=jaxpr, threads=limit))

    return compiled


def _batch_shape(args: Sequence[Any], jaxpr: core.ClosedJaxpr) -> tuple[int, ...]:
    axes = batch_axes(args, jaxpr)
    return np.broadcast_shapes(*(np.shape(a)[:axes] for a in args)) if axes else ()


def _abstract(*args: Any, jaxpr: core.ClosedJaxpr, threads: int) -> list[Any]:  # noqa: ARG001
    batch = _batch_shape(args, jaxpr)
    return [jax.core.ShapedArray((*batch, *v.shape), v.dtype) for v in jaxpr.out_avals]


def _batch(args: Sequence[Any], dims: Sequence[int | None], **params: Any) -> tuple[Any, list[int]]:
    move = [x[None] if d is None else jax.numpy.moveaxis(x, d, 0) for x, d in zip(args, dims, strict=True)]
    out = native_p.bind(*move, **params)
    return out, [0] * len(out)


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], **params: Any) -> tuple[Any, Any]:
    f = functools.partial(evaluate_with_jax, **params)
    return jax.jvp(f, tuple(primals), tuple(map(ad.instantiate_zeros, tangents)))


def _call_library(*args: Any, jaxpr: core.ClosedJaxpr, threads: int) -> list[Any]:
    """The value by the compiled code. One sample's arguments travel as one array a type: called in a loop of XLA, each
    further array costs about 0.2 us a step. Joining arguments is cheap; parting joined results is not.
    """
    batch, batched = _batch_shape(args, jaxpr), batch_axes(args, jaxpr) > 0
    name, groups = _target(jaxpr, batched)
    joined = [
        args[group[0]] if batched else jax.numpy.concatenate([args[k].ravel() for k in group]) for group in groups
    ]
    results = [jax.ShapeDtypeStruct((*batch, *v.shape), v.dtype) for v in jaxpr.out_avals]
    return list(jax.ffi.ffi_call(name, results)(*joined, threads=np.int64(threads)))


def _group_arguments(avals: Sequence[Any], used: Sequence[bool], batched: bool) -> list[list[int]]:
    """Which of the arguments that are used travel together: small ones of one type; of a batch, none."""
    kinds = {k: k if batched or v.size > MAX_GROUPED_SIZE else v.dtype.name for k, v in enumerate(avals) if used[k]}
    return [[k for k, kind in kinds.items() if kind == one] for one in dict.fromkeys(kinds.values())]


def _lower(ctx: mlir.LoweringRuleContext, *args: Any, **params: Any) -> Any:
    try:
        build.require_compiler()
        return _lower_to_library(ctx, *args, **params)
    except build.Unavailable as error:
        _warn_fallback(str(error))
        return _lower_with_jax(ctx, *args, **params)


@functools.cache
def _warn_fallback(why: str) -> None:
    log.warning("%s: native code runs on JAX instead, 10 to 100 times slower", why)


@functools.cache
def _target(jaxpr: core.ClosedJaxpr, batched: bool) -> tuple[str, list[list[int]]]:
    """Emit, compile and register a function; the name XLA knows it by, and what arguments travel together.

    A library says itself what travels together, so that one from the cache is not emitted again.
    """
    name = build.key(jaxpr_digest(jaxpr), str(batched))
    shared = build.library(name, lambda: source(jaxpr, batched))
    groups = json.loads(ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(shared, "colift_argument_groups"))))
    jax.ffi.register_ffi_target(f"colift_{name}", jax.ffi.pycapsule(shared.colift_native), platform="cpu")
    return f"colift_{name}", groups


class Kernel(NamedTuple):
    """A function as C: its text, its name, and which arguments and results are its parameters, in that order."""

    text: str
    name: str
    arguments: list[int]
    results: list[int]
    widths: list[int]


def kernel(
    jaxpr: core.ClosedJaxpr,
    lanes: int = 1,
    agent_lanes: int = 1,
    stack_bytes: int = emit.STACK_BYTES,
    in_place_results: Collection[tuple[int, int]] = (),
) -> Kernel:
    """A function for `lanes` samples side by side, or for one and its agents; arrays beyond `stack` bytes allocated.

    in_place_results: results, each with the argument that it may be written in_place_results where only a few of its elements change.
    Raises `UnsupportedPrimitive`, `OverflowError` and `TypeError` as `compile` does.
    """
    for v in (*jaxpr.in_avals, *jaxpr.out_avals):
        if v.dtype.name not in TYPES:
            raise TypeError(f"native: arrays must be of type {', '.join(TYPES)}; got {v.dtype.name}")
    g = Graph()
    nodes = []
    for k, v in enumerate(jaxpr.in_avals):
        own = g.array(v.size, "in", k)
        nodes.append((g.map("flag", own) if v.dtype == bool else own).reshape(v.shape))
    reduced, _ = partial_eval.dce_jaxpr(jaxpr.jaxpr, [True] * len(jaxpr.out_avals), instantiate=True)
    outputs = interpret(g, reduced, jaxpr.consts, nodes)
    function = Function(
        inputs=tuple(v.size for v in jaxpr.in_avals),
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


def lanes_h(widths: Sequence[int]) -> str:
    """What kernels of some widths are made of."""
    text = resources.files("colift.codegen").joinpath("lanes.h").read_text()
    one = "#define WIDTH_{w} 1\n#define AT_{w}(x, l) (x)"
    many = "#define WIDTH_{w} {w}\n#define AT_{w}(x, l) (x)[l]"
    lanes = f"#if LANES == 1 || defined ONE_LANE\n{one}\n#else\n{many}\n#endif"
    return "\n".join(f"#define LANES {w}\n{lanes.format(w=w)}\n{text}" for w in widths)


def source(jaxpr: core.ClosedJaxpr, batched: bool) -> str:
    """The C source of a function as XLA calls it, for one sample or for as many as fit a vector."""
    width = build.lanes() if batched else 1
    made = kernel(jaxpr, width, 1 if batched else build.lanes())
    groups = _group_arguments(jaxpr.in_avals, [k in made.arguments for k in range(len(jaxpr.in_avals))], batched)
    sizes = [[jaxpr.in_avals[k].size for k in group] for group in groups]
    starts = [np.cumsum([0, *size]) for size in sizes]
    place = {k: f"in[{i}] + {at}" for i, p in enumerate(groups) for k, at in zip(p, starts[i], strict=False)}
    args = [place[k] for k in made.arguments] + [f"out[{k}]" for k in made.results]
    files = resources.files("colift.codegen")
    numbers = lambda x: ", ".join(map(str, x)) or "0"  # noqa: E731
    return "\n".join([
        files.joinpath("prelude.h").read_text(),
        lanes_h(made.widths),
        made.text,
        f"#if IN(0)\n#define WIDTH {width}\n#define V V_{width}\n#define SPLAT splat_{width}",
        f"#define ARGUMENTS {len(groups)}\n#define RESULTS {len(jaxpr.out_avals)}",
        f"#define RESULT_RANK {len(jaxpr.out_avals[0].shape)}",
        f"static const int64_t ARGUMENT_SIZE[] = {{{numbers(map(sum, sizes))}}};",
        f"static const int64_t RESULT_SIZE[] = {{{numbers(v.size for v in jaxpr.out_avals)}}};",
        f"static void KERNEL(V **in, V **out) {{ {made.name}({', '.join(args)}); }}",
        files.joinpath("ffi.h").read_text(),
        f'__attribute__((visibility("default"))) const char colift_argument_groups[] = "{json.dumps(groups)}";',
        "#endif",
    ])  # fmt: skip


@functools.cache
def _jitted(**params: Any) -> Callable[..., Any]:
    return jax.jit(functools.partial(native_p.bind, **params))


_lower_with_jax = mlir.lower_fun(evaluate_with_jax, multiple_results=True)
_lower_to_library = mlir.lower_fun(_call_library, multiple_results=True)
native_p.def_impl(lambda *args, **params: _jitted(**params)(*args))
native_p.def_abstract_eval(_abstract)
mlir.register_lowering(native_p, _lower_with_jax)
mlir.register_lowering(native_p, _lower, platform="cpu")
ad.primitive_jvps[native_p] = _jvp
batching.primitive_batchers[native_p] = _batch
