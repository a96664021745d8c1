"""The one module that touches internals of JAX: jaxprs, primitives with their rules, and the cache of programs.

JAX documents neither the form of a jaxpr nor the parameters of its primitives as stable. This module reads them into
`Program` and `TracedEquation`, and checks the parameters of every equation. Where JAX has changed, it raises
`UnsupportedPrimitive`, and the function runs on JAX. If a name of JAX is missing, `MISSING` states it, and no
function is compiled.

See Also:
    docs/versions.md: the tested versions.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax

MISSING = ""
"""Error of an import from JAX that this package requires; "" if there is none."""

try:
    from jax.core import ShapedArray, Tracer, eval_jaxpr
    from jax.extend.core import ClosedJaxpr, Jaxpr, Literal, Primitive, jaxpr_as_fun
    from jax.extend.source_info_util import summarize
    from jax.interpreters.ad import instantiate_zeros, primitive_jvps
    from jax.interpreters.batching import primitive_batchers
    from jax.interpreters.mlir import lower_fun, register_lowering
    from jax.interpreters.partial_eval import dce_jaxpr
except (ImportError, AttributeError) as error:
    MISSING = f"JAX {jax.__version__}: {error}"

_NESTED = (tuple,) if MISSING else (tuple, ClosedJaxpr, Jaxpr)
"""Types of parameters that are or may contain jaxprs."""


class UnsupportedPrimitive(NotImplementedError):
    """A function contains an operation for which code generation has no rule."""


CALLS = {"jit", "custom_jvp_call", "custom_vjp_call", "remat2"}
"""Primitives whose jaxpr is inlined; their other parameters do not change the value."""

_REDUCTIONS = ("reduce_sum", "reduce_prod", "reduce_max", "reduce_min", "reduce_and", "reduce_or", "argmax", "argmin")
_SCATTERS = ("scatter", "scatter-add", "scatter-mul", "scatter-min", "scatter-max")
PARAMETERS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(_REDUCTIONS, ("axes",)),
    **dict.fromkeys(_SCATTERS, ("dimension_numbers", "mode")),
    **dict.fromkeys(("cumsum", "cumprod", "cummax", "cummin"), ("axis", "reverse")),
    "broadcast_in_dim": ("shape", "broadcast_dimensions"),
    "concatenate": ("dimension",),
    "cond": ("branches",),
    "custom_linear_solve": ("const_lengths", "jaxprs"),
    "dot_general": ("dimension_numbers",),
    "dynamic_slice": ("slice_sizes",),
    "eigh": ("lower",),
    "gather": ("dimension_numbers", "slice_sizes", "mode", "fill_value"),
    "integer_pow": ("y",),
    "iota": ("shape", "dimension"),
    "pad": ("padding_config",),
    "reshape": ("new_sizes", "dimensions"),
    "rev": ("dimensions",),
    "round": ("rounding_method",),
    "scan": ("jaxpr", "length", "reverse", "num_consts", "num_carry"),
    "slice": ("start_indices", "limit_indices", "strides"),
    "split": ("sizes", "axis"),
    "squeeze": ("dimensions",),
    "stack": ("axis",),
    "tile": ("reps",),
    "transpose": ("permutation",),
    "triangular_solve": ("left_side", "lower", "transpose_a", "unit_diagonal"),
    "unstack": ("axis",),
    "while": ("cond_nconsts", "cond_jaxpr", "body_nconsts", "body_jaxpr"),
}
"""Parameters that the rules of code generation read, by primitive."""

NEUTRAL = {
    "accuracy", "branches_platforms", "conjugate_a", "copy_semantics", "devices", "dtype", "ft_in", "ft_out",
    "index_dtype", "indices_are_sorted", "new_dtype", "out_dtype", "out_sharding", "precision",
    "preferred_element_type", "sharding", "sort_eigenvalues", "srcs", "unique_indices", "unroll", "update_consts",
    "update_jaxpr", "weak_type",
}  # fmt: skip
"""Parameters that do not change the value, or that the types of the results contain."""


def is_traced(x: Any) -> bool:
    """Return whether a value is a tracer of JAX."""
    return isinstance(x, Tracer)


def is_literal(v: Any) -> bool:
    """Return whether an operand of a `TracedEquation` is a literal, with the attribute `val`."""
    return isinstance(v, Literal)


def abstract_array(shape: Sequence[int], dtype: Any) -> Any:
    """Return the abstract value of an array.

    Args:
        shape: Shape.
        dtype: Type of the elements.

    Returns:
        The abstract value.
    """
    return ShapedArray(tuple(shape), dtype)


@dataclass(frozen=True, eq=False)
class Program:
    """Jaxpr whose first inputs are its constants.

    Attributes:
        jaxpr: Jaxpr of JAX without values of constants.
        constants: Values of its first inputs.
    """

    jaxpr: Any
    constants: tuple[Any, ...]

    @classmethod
    def from_jaxpr(cls, jaxpr: Any) -> Program:
        """Read a jaxpr of JAX with its constants.

        Args:
            jaxpr: Result of `jax.make_jaxpr`, or a jaxpr among the parameters of a primitive.

        Returns:
            The program.

        Raises:
            UnsupportedPrimitive: If JAX represents constants in another way.
        """
        with readable("jaxpr"):
            constants, inner = tuple(getattr(jaxpr, "consts", ())), getattr(jaxpr, "jaxpr", jaxpr)
            if constants and len(constants) != len(inner.constvars):
                raise ValueError(f"{len(constants)} constants, {len(inner.constvars)} variables")
            if constants and hasattr(inner, "consts"):  # since JAX 0.11 a jaxpr contains its constants
                inner = inner.replace(constvars=(), invars=[*inner.constvars, *inner.invars])
            return cls(inner, constants)

    @property
    def inputs(self) -> list[Any]:
        """Abstract values of the inputs that are not constants."""
        return [v.aval for v in self.variables[len(self.constants) :]]

    @property
    def outputs(self) -> list[Any]:
        """Abstract values of the results."""
        return [v.aval for v in self.jaxpr.outvars]

    @property
    def variables(self) -> list[Any]:
        """Variables of JAX for constants and inputs."""
        return [*self.jaxpr.constvars, *self.jaxpr.invars]

    @property
    def results(self) -> list[Any]:
        """Variables or literals of JAX for the results."""
        return list(self.jaxpr.outvars)

    @functools.cached_property
    def equations(self) -> list[TracedEquation]:
        """Equations in order of evaluation, with checked parameters."""
        return [TracedEquation.from_jax(eqn) for eqn in self.jaxpr.eqns]

    def without_dead_code(self) -> Program:
        """Remove the equations that no result depends on; all inputs are kept."""
        jaxpr, _ = dce_jaxpr(self.jaxpr, [True] * len(self.jaxpr.outvars), instantiate=True)
        return Program(jaxpr, self.constants)


class TracedEquation(NamedTuple):
    """Equation of a jaxpr.

    Attributes:
        name: Name of the primitive.
        params: Parameters; jaxprs are of type `Program`.
        invars: Operands, variables or literals of JAX.
        outvars: Results, variables of JAX.
        eqn: Equation of JAX.
    """

    name: str
    params: dict[str, Any]
    invars: list[Any]
    outvars: list[Any]
    eqn: Any

    @classmethod
    def from_jax(cls, eqn: Any) -> TracedEquation:
        """Read an equation of JAX.

        Args:
            eqn: Equation of JAX.

        Returns:
            The equation.

        Raises:
            UnsupportedPrimitive: If the parameters of the primitive are not the known ones.
        """
        name, params = eqn.primitive.name, eqn.params
        if name in PARAMETERS or name in CALLS:
            try:
                params = _under_known_names(name, params)
            except UNREADABLE as error:
                raise _unsupported_form(name, error, summarize(eqn.source_info)) from error
        if params:
            params = {key: _with_programs(x) if isinstance(x, _NESTED) else x for key, x in params.items()}
        return cls(name, params, eqn.invars, eqn.outvars, eqn)

    @property
    def source_location(self) -> str:
        """File and line in the user's code; "" for functions of JAX itself."""
        return summarize(self.eqn.source_info)

    def evaluate(self, *operands: Any) -> list[Any]:
        """Evaluate the equation with JAX.

        Args:
            *operands: Values of the operands.

        Returns:
            The results.
        """
        out = self.eqn.primitive.bind(*operands, **self.eqn.params)
        return list(out) if self.eqn.primitive.multiple_results else [out]


UNREADABLE = (AssertionError, AttributeError, LookupError, TypeError, ValueError)
"""Errors that indicate a changed form of an equation."""


@contextlib.contextmanager
def readable(name: str) -> Generator[None]:
    """Make a context that raises `UnsupportedPrimitive` for errors in reading an equation.

    Args:
        name: Name of the primitive.

    Yields:
        Nothing.

    Raises:
        UnsupportedPrimitive: If the block raises one of `UNREADABLE`.
    """
    try:
        yield
    except UNREADABLE as error:
        raise _unsupported_form(name, error) from error


def _unsupported_form(name: str, error: Exception, location: str = "") -> UnsupportedPrimitive:
    """Return the error for an equation that cannot be read."""
    reason = f"codegen: '{name}' of JAX {jax.__version__} has another form ({type(error).__name__}: {error})"
    return UnsupportedPrimitive(f"{reason}, at {location}" if location else reason)


def _under_known_names(name: str, params: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters under the names in `PARAMETERS`; raise LookupError if one is missing."""
    if name == "scan" and "ft_in" in params:  # since JAX 0.11 a tree with the branches constants, carry, inputs
        constants, carry, _ = (len(branch) for branch in params["ft_in"].unpack())
        params = params | {"num_consts": constants, "num_carry": carry}
    required = PARAMETERS.get(name, ())
    if name in CALLS and "call_jaxpr" not in params:
        required = ("jaxpr",)
    if missing := [key for key in required if key not in params]:
        raise LookupError(f"no parameter '{missing[0]}'")
    return params


def require_known_parameters(name: str, params: dict[str, Any]) -> None:
    """Check that an equation has no parameter that its rule does not consider.

    Args:
        name: Name of the primitive.
        params: Parameters of a `TracedEquation`.

    Raises:
        UnsupportedPrimitive: If an unknown parameter has another value than None, False or ().
    """
    for key in params.keys() - NEUTRAL - set(PARAMETERS.get(name, ())):
        value = params[key]
        if not (value is None or value is False or (isinstance(value, tuple) and not value)):
            raise UnsupportedPrimitive(
                f"codegen: '{name}' of JAX {jax.__version__} has the unknown parameter '{key}', here {value!r}"
            )


def _with_programs(value: Any) -> Any:
    """Replace jaxprs of JAX in a parameter by programs."""
    if isinstance(value, (ClosedJaxpr, Jaxpr)):
        return Program.from_jaxpr(value)
    if isinstance(value, tuple) and any(isinstance(x, (ClosedJaxpr, Jaxpr)) for x in value):
        parts = map(_with_programs, value)
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return value


def programs_in(params: dict[str, Any]) -> Iterator[Program]:
    """Iterate over the programs in the parameters of an equation.

    Args:
        params: Parameters of a `TracedEquation`.

    Yields:
        The programs.
    """
    for value in params.values():
        for one in value if isinstance(value, (tuple, list)) else (value,):
            if isinstance(one, Program):
                yield one


def called_program(e: TracedEquation) -> Program | None:
    """Return the program that an equation of `CALLS` calls; None for other equations.

    Args:
        e: Equation.

    Returns:
        The program.
    """
    return e.params["jaxpr" if "jaxpr" in e.params else "call_jaxpr"] if e.name in CALLS else None


def side_effects(jaxpr: Any) -> str:
    """Return the side effects of a jaxpr, for a message; "" if it has none."""
    return ", ".join(sorted(map(str, getattr(jaxpr, "effects", ()))))


def as_function(jaxpr: Any) -> Callable[..., list[Any]]:
    """Return the function of JAX that evaluates a jaxpr with its constants."""
    return jaxpr_as_fun(jaxpr)


def evaluate_jaxpr(jaxpr: Any, *args: Any) -> list[Any]:
    """Evaluate `Program.jaxpr` with JAX.

    Args:
        jaxpr: Jaxpr without values of constants.
        *args: Constants and inputs.

    Returns:
        The results.
    """
    constants = len(jaxpr.constvars)
    return eval_jaxpr(jaxpr, args[:constants], *args[constants:])


def new_primitive(name: str) -> Any:
    """Make a primitive of JAX that returns several results; None if `MISSING` is not empty.

    Args:
        name: Name of the primitive.

    Returns:
        The primitive; `define_primitive` defines its rules.
    """
    if MISSING:
        return None
    primitive = Primitive(name)
    primitive.multiple_results = True
    return primitive


def define_primitive(
    primitive: Any,
    implementation: Callable[..., Any],
    abstract: Callable[..., Any],
    jvp: Callable[..., Any],
    batch: Callable[..., Any],
    lower: Callable[..., Any],
    lower_on_cpu: Callable[..., Any] | None = None,
) -> None:
    """Define the rules of a primitive. If JAX does not accept them, `MISSING` states the reason.

    Args:
        primitive: Result of `new_primitive`.
        implementation: Evaluates arrays.
        abstract: Returns the abstract results.
        jvp: Rule of forward differentiation.
        batch: Rule of batching.
        lower: Function of JAX that is equal to the primitive.
        lower_on_cpu: Rule of lowering for the CPU; default: `lower`.
    """
    global MISSING
    if MISSING:
        return
    try:
        primitive.def_impl(implementation)
        primitive.def_abstract_eval(abstract)
        primitive_jvps[primitive] = jvp
        primitive_batchers[primitive] = batch
        register_lowering(primitive, lowering(lower))
        if lower_on_cpu is not None:
            register_lowering(primitive, lower_on_cpu, platform="cpu")
    except (AttributeError, TypeError) as error:
        MISSING = f"JAX {jax.__version__}: {error}"


def lowering(f: Callable[..., Any]) -> Callable[..., Any]:
    """Return the rule of lowering that traces a function of JAX with several results."""
    return lower_fun(f, multiple_results=True)


def dense_tangents(tangents: Sequence[Any]) -> tuple[Any, ...]:
    """Replace symbolic zeros among the tangents of a differentiation rule by arrays."""
    return tuple(map(instantiate_zeros, tangents))


def backends_are_initialized() -> bool:
    """Return whether JAX has used a device in this process; False if this version of JAX does not provide it."""
    bridge = getattr(getattr(jax, "_src", None), "xla_bridge", None)
    return bool(getattr(bridge, "backends_are_initialized", lambda: False)())


def replace_file_cache(folder: Path, make_cache: Callable[[str], Any]) -> None:
    """Use another cache of compiled programs for a folder; other folders and unknown versions are not changed.

    Args:
        folder: Folder of the cache.
        make_cache: Returns a cache with the methods `get` and `put` from the path of the folder.
    """
    module = getattr(getattr(jax, "_src", None), "compilation_cache", None)
    original = getattr(module, "get_file_cache", None)
    if module is None or original is None:
        return

    def get_file_cache(path: str) -> Any:
        return (make_cache(path), path) if Path(path) == folder else original(path)

    module.get_file_cache = get_file_cache
