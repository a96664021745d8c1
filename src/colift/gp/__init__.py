"""Exact batched GPs for control loops: many small posteriors, fixed capacity, no recompilation. Knows no robot.

kernel      how alike a function's values at two points are
hyper       hyperparameters, and the box they are learned in
likelihood  log marginal likelihood and its gradient (host)
training    hyperparameters from data (host)
posterior   condition, mean, variance, predict, append, remove, and what a data set tells
parametric  mean functions linear in shared parameters, identified (host)
data        data policies of a fixed budget, update schedules
store       a GP in a file
bounds      how far the mean may be from the function, and what each bound assumes
recovery    the tightest bound under bounded noise, by a conic program (host)
"""

from colift.gp import bounds, recovery
from colift.gp.data import AtTimes, Data, OnGain, Policy, Uniform, empty, first_come, first_in_first_out, informative
from colift.gp.hyper import Belief, Box, Hyper, hyperparameters
from colift.gp.kernel import Kernel, SquaredExponential
from colift.gp.parametric import Identification, fit_parametric, identify
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
from colift.gp.store import load, save
from colift.gp.training import Fit, fit, fit_shared

__all__ = [
    "GP",
    "AtTimes",
    "Belief",
    "Box",
    "Data",
    "Fit",
    "Hyper",
    "Identification",
    "Kernel",
    "OnGain",
    "Policy",
    "SquaredExponential",
    "Uniform",
    "append",
    "bounds",
    "condition",
    "empty",
    "expansion",
    "first_come",
    "first_in_first_out",
    "fit",
    "fit_parametric",
    "fit_shared",
    "hyperparameters",
    "identify",
    "information_gain",
    "informative",
    "leave_one_out",
    "load",
    "log_likelihood",
    "mean",
    "norm",
    "predict",
    "prior",
    "recovery",
    "remove",
    "save",
    "variance",
]
