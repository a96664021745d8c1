"""Exact batched GPs for control loops: many small posteriors, fixed capacity, no recompilation. Knows no robot.

kernel      how alike a function's values at two points are
hyper       hyperparameters, and the box they are learned in
likelihood  log marginal likelihood and its gradient (host)
training    hyperparameters from data (host)
posterior   condition, mean, variance, predict, append, remove, and what a data set tells
parametric  GPs beside a mean function linear in parameters that outputs share (host)
data        data policies of a fixed budget, update schedules
thinning    which of too many points to keep (host)
store       a GP in a file
bounds      how far the mean may be from the function, and what each bound assumes
recovery    the tightest bound under bounded noise, by a conic program (host)
ellipsoid   bounds of many functionals at once under bounded noise (host)
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
    gram_matrices,
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
    leave_one_out,
    log_likelihood,
    mean,
    predict,
    prior,
    remove,
    rkhs_norm,
    variance,
)
from colift.gp.semiparametric import SemiparametricFit, fit_semiparametric
from colift.gp.serialization import load_gp, save_gp
from colift.gp.subset_selection import select_subset

__all__ = [
    "INACTIVE_LENGTHSCALE",
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
    "append",
    "column_std",
    "concatenate_fits",
    "condition",
    "ellipsoid",
    "empty_dataset",
    "error_bounds",
    "fit",
    "fit_semiparametric",
    "fit_shared",
    "from_expansion",
    "gram_matrices",
    "information_gain",
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
