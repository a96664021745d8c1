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
from colift.gp.dataset import AtTimes, Data, OnGain, Policy, Uniform, empty, first_come, first_in_first_out, informative
from colift.gp.fitting import Fit, both, fit, fit_shared, spread
from colift.gp.hyperparameters import UNSEEN, Belief, Box, Hyper, grams, hyperparameters, of_outputs
from colift.gp.kernels import Kernel, SquaredExponential
from colift.gp.posterior import (
    GP,
    append,
    condition,
    expansion,
    information_gain,
    leave_one_out,
    log_likelihood,
    mean,
    norm,
    predict,
    prior,
    remove,
    variance,
)
from colift.gp.semiparametric import Parametric, fit_parametric
from colift.gp.serialization import load, save
from colift.gp.subset_selection import thinned

__all__ = [
    "GP",
    "UNSEEN",
    "AtTimes",
    "Belief",
    "Box",
    "Data",
    "Fit",
    "Hyper",
    "Kernel",
    "OnGain",
    "Parametric",
    "Policy",
    "SquaredExponential",
    "Uniform",
    "append",
    "both",
    "bounds",
    "condition",
    "ellipsoid",
    "empty",
    "expansion",
    "first_come",
    "first_in_first_out",
    "fit",
    "fit_parametric",
    "fit_shared",
    "grams",
    "hyperparameters",
    "information_gain",
    "informative",
    "leave_one_out",
    "load",
    "log_likelihood",
    "mean",
    "norm",
    "of_outputs",
    "predict",
    "prior",
    "recovery",
    "remove",
    "save",
    "spread",
    "thinned",
    "variance",
]
