"""Hyperparameters of a kernel with white noise, and the box in which they are learned."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from colift.gp.kernels import DEFAULT_KERNEL, Kernel
from colift.gp.likelihood import conditioning_error_message, gram_matrix, min_noise_ratio
from colift.math.pytree import pytree

INACTIVE_LENGTHSCALE = 1e50
"""Length-scale of an input that an output does not look at."""


@pytree
class Hyperparameters:
    """Hyperparameters of independent outputs over shared inputs, in the units of the data.

    Output i has `y = offset_i + f_i(x) + noise`, with
    `cov(f_i(x), f_i(z)) = signal_variance_i kernel(sum_d ((x_d - z_d) / lengthscales_id)^2)`.
    """

    kernel: Kernel = DEFAULT_KERNEL
    signal_variance: Float[Array, "*batch outputs"]  # (unit of y)^2
    lengthscales: Float[Array, "*batch outputs dimensions"]  # unit of x
    noise_variance: Float[Array, "*batch outputs"]  # (unit of y)^2
    constant_mean: Float[Array, "*batch outputs"]  # unit of y, constant prior mean


@dataclasses.dataclass(frozen=True)
class HyperparameterBounds:
    """Bounds (lower, upper) on the hyperparameters of standardized data: every input and output has unit deviation."""

    signal_variance: tuple[float, float] = (1e-3, 1e2)
    lengthscale: tuple[float, float] = (0.1, 30.0)
    noise_variance: tuple[float, float] = (1e-6, 1.0)
    """The lower bound is the floor on noise: 1e-3 of the output's standard deviation."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            lower, upper = getattr(self, field.name)
            if not 0 < lower <= upper < np.inf:
                raise ValueError(f"{field.name} = ({lower}, {upper}): must satisfy 0 < lower <= upper < inf")


DEFAULT_BOUNDS = HyperparameterBounds()


@dataclasses.dataclass(frozen=True)
class HyperPrior:
    """What is believed of hyperparameters before any data, in the units of the data.

    `log l ~ N(log l_median, log(factor)^2)` for every length-scale, and so for every signal and noise deviation (a
    variance has twice the logarithm). No length-scale lies outside `[least, greatest]`. The median's offset is unused.
    """

    median: Hyperparameters
    scale_factor: float = 3.0
    """Two of three lie within this factor of the median, up or down."""
    min_lengthscale: float = 0.1
    """Of any length-scale, in the unit of its input."""
    max_lengthscale: float = 30.0
    """As `least`."""

    def __post_init__(self) -> None:
        validate(self.median)
        if not 1 < self.scale_factor < np.inf:
            raise ValueError(f"factor = {self.scale_factor}: must exceed 1 and be finite")
        if not 0 < self.min_lengthscale <= self.max_lengthscale < np.inf:
            raise ValueError(
                f"least = {self.min_lengthscale}, greatest = {self.max_lengthscale}: must satisfy 0 < least <= greatest < inf"
            )


def make_hyperparameters(
    signal_variance: ArrayLike | float,
    lengthscales: ArrayLike,
    noise_variance: ArrayLike | float,
    constant_mean: ArrayLike | float = 0.0,
    kernel: Kernel = DEFAULT_KERNEL,
) -> Hyperparameters:
    """Stated hyperparameters, scalars or one for each output, broadcast to `(outputs,)` and `(outputs, dimensions)`.

    lengthscales: `(dimensions,)` or `(outputs, dimensions)`.
    Raises ValueError where shapes disagree, or a variance or length-scale is not positive and finite.
    """
    ls = np.atleast_2d(np.asarray(lengthscales, dtype=float))
    given = {"signal_variance": signal_variance, "noise_variance": noise_variance, "constant_mean": constant_mean}
    given = {name: np.asarray(value, dtype=float) for name, value in given.items()}
    outputs = max(len(ls), *(value.size for value in given.values()))
    for name, value in given.items():
        if value.ndim > 1 or value.size not in (1, outputs):
            raise ValueError(f"{name} has shape {value.shape}: must be a scalar or ({outputs},), one for each output")
    if ls.ndim != 2 or len(ls) not in (1, outputs):
        raise ValueError(f"lengthscales has shape {ls.shape}: must be (dimensions,) or ({outputs}, dimensions)")
    full = {name: jnp.asarray(np.broadcast_to(value, (outputs,))) for name, value in given.items()}
    stated = Hyperparameters(
        kernel=kernel, lengthscales=jnp.asarray(np.broadcast_to(ls, (outputs, ls.shape[1]))), **full
    )
    validate(stated)
    return stated


# Within these no finite input or output of at most 1e100 in size makes a NaN.
RANGE = {
    "signal_variance": (1e-200, 1e200),
    "lengthscales": (1e-100, 1e100),
    "noise_variance": (1e-220, 1e200),
    "constant_mean": (-1e100, 1e100),
}


def validate(hyper: Hyperparameters, points: int = 1) -> None:
    """Raise ValueError where a variance or length-scale is not positive and finite, or an offset not finite.

    So do numbers beyond `RANGE`, and noise too small for that many points in float64, see `least_noise`.
    """
    for name, (lower, upper) in RANGE.items():
        value = np.asarray(getattr(hyper, name))
        if not ((value >= lower) & (value <= upper)).all():
            raise ValueError(f"{name} = {value.tolist()}: must be finite, within [{lower:g}, {upper:g}]")
    with jax.ensure_compile_time_eval():  # a prior may be made where something is traced
        at_zero = float(hyper.kernel(jnp.zeros(())))
    if not abs(at_zero - 1) <= 1e-12:
        raise ValueError(f"the kernel {type(hyper.kernel).__name__} is {at_zero:.6g} at distance zero: must be 1")
    s, v = np.asarray(hyper.signal_variance), np.asarray(hyper.noise_variance)
    small = np.flatnonzero(v < min_noise_ratio(points) * s)
    if small.size:
        raise ValueError(f"output {small[0]}: " + conditioning_error_message(points, s[small[0]], v[small[0]]))


def gram_matrices(X: np.ndarray, hyper: Hyperparameters) -> np.ndarray:
    """`(outputs, N, N)`, the covariance of labels of each output at the points X `(N, dimensions)`: its `gram`."""
    each = zip(*map(np.asarray, (hyper.signal_variance, hyper.lengthscales, hyper.noise_variance)), strict=True)
    return np.stack([gram_matrix(X, *of, hyper.kernel) for of in each])


def select_outputs(hyper: Hyperparameters, outputs: slice) -> Hyperparameters:
    """Hyperparameters of some outputs."""
    part = {name: getattr(hyper, name)[outputs] for name in FIELDS}
    return Hyperparameters(kernel=hyper.kernel, **part)


def concatenate(first: Hyperparameters, then: Hyperparameters) -> Hyperparameters:
    """Of the outputs of both, in this order; they have one kernel."""
    both = {name: jnp.concatenate([getattr(first, name), getattr(then, name)]) for name in FIELDS}
    return Hyperparameters(kernel=first.kernel, **both)


FIELDS = ("signal_variance", "lengthscales", "noise_variance", "constant_mean")
