"""Online learning of residual forces: data recording, residual models, model updates and prediction.

The estimator provides labels: filtered measurements of the forces that the nominal model does not explain. Residual
models are fitted to labels, and their prediction is compensated by the controller.

Modules:
    features: input features of the Gaussian processes.
    recorder: selection and storage of training samples.
    residual_model: predictors that are constant between two updates.
    mean_functions: mean functions that are linear in their parameters.
    identification, ridge_regression: estimation of these parameters by least squares.
    semiparametric: joint estimation of mean functions and Gaussian processes.
    model_update: fitting and conditioning of residual models on recorded samples.
    online_learner: schedule of updates, change detection and refits during a simulated flight.
    residual_correction: residual correctors, which estimate the error of the model from labels.
    residual_predictors: parts of the controller that predict the residual.
    prediction_uncertainty: predictive standard deviations and error bounds along a trajectory.
    confidence_bounds: error bounds of residual models.

See Also:
    docs/learning: equations and tuning guide.
"""
