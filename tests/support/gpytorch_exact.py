"""GPyTorch in exact mode: Cholesky factorization at every size, float64, one batch of outputs over shared inputs."""

import contextlib
import warnings

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import gpytorch
    import torch


@contextlib.contextmanager
def exact():
    """Context without conjugate gradients above 800 points and without fast approximations."""
    s = gpytorch.settings
    with (
        warnings.catch_warnings(),
        s.max_cholesky_size(1_000_000),
        s.fast_computations(False, False, False),
        s.fast_pred_var(False),
        s.skip_posterior_variances(False),
    ):
        warnings.simplefilter("ignore")
        yield


class Model(gpytorch.models.ExactGP):
    """Independent outputs as a batch, each with constant mean, scaled RBF-ARD kernel and noise."""

    def __init__(self, X, Y):
        outputs = torch.Size([Y.shape[1]])
        x = torch.as_tensor(np.array(X)).expand(*outputs, *X.shape)
        free = gpytorch.constraints.GreaterThan(1e-15)
        likelihood = gpytorch.likelihoods.GaussianLikelihood(batch_shape=outputs, noise_constraint=free).double()
        super().__init__(x, torch.as_tensor(np.array(Y).T.copy()), likelihood)
        self.mean_module = gpytorch.means.ConstantMean(batch_shape=outputs)
        self.covar_module = gpytorch.kernels.ScaleKernel(
            gpytorch.kernels.RBFKernel(ard_num_dims=X.shape[1], batch_shape=outputs), batch_shape=outputs
        )
        self.double()

    def forward(self, x):
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    def set(self, hyper):
        """Set the hyperparameters."""
        values = [
            np.array(a) for a in (hyper.signal_variance, hyper.lengthscales, hyper.noise_variance, hyper.constant_mean)
        ]
        s, ls, v, offset = (torch.as_tensor(a) for a in values)
        self.covar_module.outputscale = s
        self.covar_module.base_kernel.lengthscale = ls[:, None, :]
        self.likelihood.noise = v[:, None]
        self.mean_module.initialize(constant=offset)
        return self

    def log_likelihood(self):
        """Return the log likelihood `(outputs,)` in nats, with its graph."""
        self.train()
        return self.likelihood(self(*self.train_inputs)).log_prob(self.train_targets)

    def log_likelihood_and_gradient(self):
        """Return the log likelihood and its gradient with respect to log (signal, length-scales, noise)."""
        self.zero_grad()
        value = self.log_likelihood()
        value.sum().backward()
        raw = (
            self.covar_module.raw_outputscale,
            self.covar_module.base_kernel.raw_lengthscale,
            self.likelihood.noise_covar.raw_noise,
        )
        values = (self.covar_module.outputscale, self.covar_module.base_kernel.lengthscale, self.likelihood.noise)
        # Their value is softplus(raw) plus a bound, so d/dlog value = value / sigmoid(raw) d/draw.
        parts = [(p.grad * v / torch.sigmoid(p)).reshape(len(value), -1) for p, v in zip(raw, values, strict=True)]
        return value.detach().numpy(), torch.cat(parts, 1).detach().numpy()

    def query(self, x):
        """Return mean and variance at x `(queries, dimensions)`, each `(queries, outputs)`."""
        self.eval()
        x = torch.as_tensor(np.array(x))
        with torch.no_grad():
            posterior = self(x.expand(self.train_inputs[0].shape[0], *x.shape))
            return posterior.mean.numpy().T, posterior.variance.numpy().T

    def appended(self, x, y):
        """Return the model with one more point by GPyTorch's online update."""
        outputs = self.train_inputs[0].shape[0]
        x = torch.as_tensor(np.array(x)).expand(outputs, 1, len(x))
        return self.get_fantasy_model(x, torch.as_tensor(np.array(y))[:, None])
