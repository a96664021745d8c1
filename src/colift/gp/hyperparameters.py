"""Hyperparameters of a kernel with white noise, their bounds and their prior."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from colift.gp.kernels import DEFAULT_KERNEL, Kernel
from colift.gp.likelihood import conditioning_error_message, min_noise_ratio
from colift.math.pytree import pytree

INACTIVE_LENGTHSCALE = 1e50
"""Length-scale of an input on which an output does not depend."""


@pytree
class Hyperparameters:
    """Hyperparameters of independent outputs over shared inputs, in the units of the data.

    Output i has the model `y = constant_mean_i + f_i(x) + noise` with
    `cov(f_i(x), f_i(z)) = signal_variance_i kernel(sum_d ((x_d - z_d) / lengthscales_id)^2)`.

    Attributes:
        kernel: Correlation function of the squared scaled distance.
        signal_variance: Variance of each f_i [unit of y squared].
        lengthscales: Length-scale of each input [unit of x].
        noise_variance: Variance of the white noise [unit of y squared].
        constant_mean: Constant prior mean [unit of y].
    """

    kernel: Kernel = DEFAULT_KERNEL
    signal_variance: Float[Array, "*batch outputs"]
    lengthscales: Float[Array, "*batch outputs dimensions"]
    noise_variance: Float[Array, "*batch outputs"]
    constant_mean: Float[Array, "*batch outputs"]


@dataclasses.dataclass(frozen=True)
class HyperparameterBounds:
    """Bounds (lower, upper) on the hyperparameters of standardized data, whose columns have unit deviation."""

    signal_variance: tuple[float, float] = (1e-3, 1e2)  # relative to the variance of the output
    lengthscale: tuple[float, float] = (0.1, 30.0)  # in standard deviations of the input
    noise_variance: tuple[float, float] = (1e-6, 1.0)
    """The lower bound limits the noise to at least 1e-3 of the output's standard deviation."""

    def __post_init__(self) -> None:
        """Check that all bounds are positive and ordered."""
        for field in dataclasses.fields(self):
            lower, upper = getattr(self, field.name)
            if not 0 < lower <= upper < np.inf:
                raise ValueError(f"{field.name} = ({lower}, {upper}): must satisfy 0 < lower <= upper < inf")


DEFAULT_BOUNDS = HyperparameterBounds()


@dataclasses.dataclass(frozen=True)
class HyperPrior:
    """Log-normal prior of hyperparameters, in the units of the data.

    `log l ~ N(log l_median, log(scale_factor)^2)` for every length-scale, and likewise for every signal and noise
    deviation (a variance has twice the logarithm). Length-scales lie within `[min_lengthscale, max_lengthscale]`. The
    constant mean of the median is not used.
    """

    median: Hyperparameters  # median of each hyperparameter
    scale_factor: float = 3.0
    """About two of three values lie within this factor of the median."""
    min_lengthscale: float = 0.1
    """Lower bound of all length-scales, in the unit of their input."""
    max_lengthscale: float = 30.0
    """Upper bound of all length-scales, in the unit of their input."""

    def __post_init__(self) -> None:
        """Check the median, the scale factor and the order of the bounds."""
        validate(self.median)
        if not 1 < self.scale_factor < np.inf:
            raise ValueError(f"scale_factor = {self.scale_factor}: must exceed 1 and be finite")
        if not 0 < self.min_lengthscale <= self.max_lengthscale < np.inf:
            raise ValueError(
                f"min_lengthscale = {self.min_lengthscale}, max_lengthscale = {self.max_lengthscale}: "
                "must satisfy 0 < min_lengthscale <= max_lengthscale < inf"
            )


def make_hyperparameters(
    signal_variance: ArrayLike | float,
    lengthscales: ArrayLike,
    noise_variance: ArrayLike | float,
    constant_mean: ArrayLike | float = 0.0,
    kernel: Kernel = DEFAULT_KERNEL,
) -> Hyperparameters:
    """Create hyperparameters from scalars or one value for each output.

    Args:
        signal_variance: Scalar or `(outputs,)` [unit of y squared].
        lengthscales: `(dimensions,)` or `(outputs, dimensions)` [unit of x].
        noise_variance: Scalar or `(outputs,)` [unit of y squared].
        constant_mean: Scalar or `(outputs,)` [unit of y].
        kernel: Correlation function.

    Returns:
        Validated hyperparameters.

    Raises:
        ValueError: If shapes disagree, or a variance or length-scale is not positive and finite.
    """
    ls = np.atleast_2d(np.asarray(lengthscales, dtype=float))
    values = {"signal_variance": signal_variance, "noise_variance": noise_variance, "constant_mean": constant_mean}
    values = {name: np.asarray(value, dtype=float) for name, value in values.items()}
    outputs = max(len(ls), *(value.size for value in values.values()))
    for name, value in values.items():
        if value.ndim > 1 or value.size not in (1, outputs):
            raise ValueError(f"{name} has shape {value.shape}: must be a scalar or ({outputs},), one for each output")
    if ls.ndim != 2 or len(ls) not in (1, outputs):
        raise ValueError(f"lengthscales has shape {ls.shape}: must be (dimensions,) or ({outputs}, dimensions)")
    broadcast = {name: jax.device_put(np.broadcast_to(value, (outputs,))) for name, value in values.items()}
    hyper = Hyperparameters(
        kernel=kernel, lengthscales=jax.device_put(np.broadcast_to(ls, (outputs, ls.shape[1]))), **broadcast
    )
    validate(hyper)
    return hyper


# Within this range, inputs and outputs up to 1e100 in magnitude cause no NaN.
RANGE = {
    "signal_variance": (1e-200, 1e200),
    "lengthscales": (1e-100, 1e100),
    "noise_variance": (1e-220, 1e200),
    "constant_mean": (-1e100, 1e100),
}


def validate(hyper: Hyperparameters, points: int = 1) -> None:
    """Check that hyperparameters lie within `RANGE` and that the Gram matrix stays positive definite in float64.

    Args:
        hyper: Hyperparameters.
        points: Number of points for which the noise variance must suffice; see `likelihood.min_noise_ratio`.

    Raises:
        ValueError: If a value is out of range, the kernel is not 1 at zero, or the noise variance is too small.
    """
    for name, (lower, upper) in RANGE.items():
        value = np.asarray(getattr(hyper, name))
        if not ((value >= lower) & (value <= upper)).all():
            raise ValueError(f"{name} = {value.tolist()}: must be finite, within [{lower:g}, {upper:g}]")
    with jax.ensure_compile_time_eval():  # the function may be called while tracing
        at_zero = float(hyper.kernel(jnp.zeros(())))
    if not abs(at_zero - 1) <= 1e-12:
        raise ValueError(
            f"the kernel {type(hyper.kernel).__name__} has the value {at_zero:.6g} at distance zero: must be 1"
        )
    s, v = np.asarray(hyper.signal_variance), np.asarray(hyper.noise_variance)
    small = np.flatnonzero(v < min_noise_ratio(points) * s)
    if small.size:
        raise ValueError(f"output {small[0]}: " + conditioning_error_message(points, s[small[0]], v[small[0]]))


def select_outputs(hyper: Hyperparameters, outputs: slice) -> Hyperparameters:
    """Select the hyperparameters of some outputs.

    Args:
        hyper: Hyperparameters.
        outputs: Selected outputs.

    Returns:
        Hyperparameters of these outputs.
    """
    part = {name: getattr(hyper, name)[outputs] for name in FIELDS}
    return Hyperparameters(kernel=hyper.kernel, **part)


def concatenate(first: Hyperparameters, second: Hyperparameters) -> Hyperparameters:
    """Concatenate the hyperparameters of two groups of outputs with one kernel.

    Args:
        first: Hyperparameters of the first outputs; their kernel is used.
        second: Hyperparameters of the outputs that follow.

    Returns:
        Hyperparameters of all outputs.
    """
    both = {name: jnp.concatenate([getattr(first, name), getattr(second, name)]) for name in FIELDS}
    return Hyperparameters(kernel=first.kernel, **both)


FIELDS = ("signal_variance", "lengthscales", "noise_variance", "constant_mean")  # fields with numbers
