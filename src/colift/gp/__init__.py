"""Exact Gaussian process (GP) regression for control loops.

A posterior holds many independent outputs over shared inputs at a fixed capacity, so that new data cause no
recompilation. The package does not depend on robot models.

Modules:
    kernels: Correlation functions of scaled distances.
    hyperparameters: Hyperparameters, their bounds and their prior.
    likelihood: Log marginal likelihood and its gradient (host).
    fitting: Hyperparameters from data (host).
    posterior: Conditioning, prediction, and insertion or removal of single points.
    semiparametric: GPs with a mean function that is linear in shared parameters (host).
    time_variation: Changes of a function with time (host).
    dataset: Selection policies of a fixed budget, and update schedules.
    subset_selection: Selection of a subset of data by information (host).
    serialization: Storage of a posterior in a file.
    error_bounds: Error bounds of the posterior mean, and the assumptions of each bound.
    optimal_recovery: Smallest bound under bounded noise, by a conic program (host).
    ellipsoid: Bounds of many functionals at once under bounded noise (host).

Example:
    >>> fit = gp.fit(X, Y)
    >>> model = gp.condition(X, Y, fit.hyper)
    >>> mean, variance = gp.predict(model, jnp.asarray(points))
"""

from colift.gp import ellipsoid, error_bounds, optimal_recovery
from colift.gp.dataset import (
    Dataset,
    InformationTriggeredUpdate,
    ReservoirSampling,
    ScheduledUpdate,
    SelectionPolicy,
    empty_dataset,
    keep_first,
    max_variance_subset,
    sliding_window,
)
from colift.gp.fitting import FitResult, column_std, concatenate_fits, fit, fit_shared
from colift.gp.hyperparameters import (
    INACTIVE_LENGTHSCALE,
    HyperparameterBounds,
    Hyperparameters,
    HyperPrior,
    make_hyperparameters,
    select_outputs,
)
from colift.gp.kernels import Kernel, SquaredExponential
from colift.gp.posterior import (
    GPPosterior,
    append,
    condition,
    from_expansion,
    information_gain,
    inverse_factors,
    leave_one_out,
    log_likelihood,
    mean,
    predict,
    prior,
    remove,
    rkhs_norm,
    variance,
)
from colift.gp.semiparametric import SemiparametricFit, estimate_parameters, fit_semiparametric
from colift.gp.serialization import load_gp, save_gp
from colift.gp.subset_selection import select_subset
from colift.gp.time_variation import JUMP_SHARE, TimeVariation, function_covariance

__all__ = [
    "INACTIVE_LENGTHSCALE",
    "JUMP_SHARE",
    "Dataset",
    "FitResult",
    "GPPosterior",
    "HyperPrior",
    "HyperparameterBounds",
    "Hyperparameters",
    "InformationTriggeredUpdate",
    "Kernel",
    "ReservoirSampling",
    "ScheduledUpdate",
    "SelectionPolicy",
    "SemiparametricFit",
    "SquaredExponential",
    "TimeVariation",
    "append",
    "column_std",
    "concatenate_fits",
    "condition",
    "ellipsoid",
    "empty_dataset",
    "error_bounds",
    "estimate_parameters",
    "fit",
    "fit_semiparametric",
    "fit_shared",
    "from_expansion",
    "function_covariance",
    "information_gain",
    "inverse_factors",
    "keep_first",
    "leave_one_out",
    "load_gp",
    "log_likelihood",
    "make_hyperparameters",
    "max_variance_subset",
    "mean",
    "optimal_recovery",
    "predict",
    "prior",
    "remove",
    "rkhs_norm",
    "save_gp",
    "select_outputs",
    "select_subset",
    "sliding_window",
    "variance",
]
