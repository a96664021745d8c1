"""What is learned: features, samples that are recorded in flight, frozen oracles.

On `[t_k, t_{k+1})` the oracle is an immutable value. Data sets keep the raw, filtered inputs; a feature map turns
them into what a GP sees, so another map needs no new data.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType
from typing import Protocol, TypeVar, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.linalg import block_diag, eigvalsh
from threadpoolctl import threadpool_limits

from colift import gp, interrupt, so3
from colift.estimate import Labelled
from colift.measurement import Measurement
from colift.model import (
    AgentForce,
    AgentState,
    Payload,
    PayloadState,
    Residual,
    State,
    Team,
    Wrench,
    agent_force,
    flat_agent,
    flat_payload,
    with_wrench,
)
from colift.pytree import pytree, static

Scalar = Float[Array, ""]
Sampled = tuple[Float[Array, "..."], Float[Array, "..."]]
T = TypeVar("T")


@pytree
class Recorded:
    """What a recorder keeps between ticks."""

    payload: gp.Data
    agents: tuple[gp.Data, ...]  # by group, agents lead
    due: Scalar  # s, when the next sample is taken

    def newest(self) -> float:
        """When the newest sample was taken, s; 0 where there is none."""
        return max(float(data.t.max()) for data in (self.payload, *self.agents))


@pytree
class Recorder:
    """When samples are recorded, and whose: of the estimator's inputs and labels."""

    every: Scalar  # s between samples, no less than the label filter's memory
    start: Scalar  # s, once the filters have settled
    end: Scalar  # s, T_end of Assumption dataset
    payload: Bool[Array, ""]
    agents: Bool[Array, ""]
    policy: gp.Policy = static(default=gp.first_come)  # which of them are kept

    def begin(self, team: Team, oracle: Oracle) -> Recorded:
        """Empty data sets, as large as the oracle's."""
        agents = []
        for size, group in zip(team.sizes, team.groups, strict=True):
            n_r = group.tree.joints
            agents.append(gp.empty(oracle.payload.capacity, 18 + 2 * n_r, 6 + n_r, batch=(size,)))
        return Recorded(payload=gp.empty(oracle.payload.capacity, 24, 6), agents=tuple(agents), due=self.start)

    def record(self, memory: Recorded, m: Measurement, labelled: Labelled | None, t: Scalar) -> Recorded:
        """The data sets after time t, s: with one more sample where one is due."""
        now = (t >= memory.due - 1e-9) & (t <= self.end + 1e-9)
        payload, agents = self.samples(m, labelled)
        fresh = now if labelled is None else now & (labelled.fresh > 0)
        each = jax.vmap(self.policy, in_axes=(0, 0, 0, None, None))
        return Recorded(
            payload=self.policy(memory.payload, *payload, t, fresh & self.payload)[0],
            agents=tuple(
                each(data, *xy, t, fresh & self.agents)[0] for data, xy in zip(memory.agents, agents, strict=True)
            ),
            due=memory.due + jnp.where(now, self.every, 0.0),
        )

    def samples(self, m: Measurement, labelled: Labelled | None) -> tuple[Sampled, tuple[Sampled, ...]]:
        """`(x, y)` of the payload and of every group's agents. Raises ValueError where nothing is labelled."""
        if labelled is None:
            raise ValueError("the estimator gives no labels: this pilot cannot learn")
        return labelled.payload, labelled.agents


@pytree
class FromRig(Recorder):
    """The same, of a calibration rig's true states and nearly true residuals."""

    def samples(self, m: Measurement, labelled: Labelled | None) -> tuple[Sampled, tuple[Sampled, ...]]:
        """`(x, y)` of the payload and of every group's agents. Raises ValueError where there is no rig."""
        if m.rig is None:
            raise ValueError("the world has no calibration rig (`sensor.Rig`) to learn from")
        z, f = m.rig.z, m.rig.f
        payload = flat_payload(z.payload, jnp.zeros(6)), jnp.concatenate([f.payload.F, f.payload.tau])
        agents = tuple(
            (jax.vmap(flat_agent)(q), jnp.concatenate([g.f_x, g.f_w, g.f_r], axis=1))
            for q, g in zip(z.agents, f.agents, strict=True)
        )
        return payload, agents


PAYLOAD_FEATURES = (
    *("p_x", "p_y", "p_z", "v_x", "v_y", "v_z"),
    *(f"R_{i}{j}" for i in "xyz" for j in "xyz"),
    *("omega_x", "omega_y", "omega_z", "|v|", "|omega|"),
)


def agent_feature_names(joints: int) -> tuple[str, ...]:
    """Names of the agent's features, in order."""
    return (
        *(f"R_{i}{j}" for i in "xyz" for j in "xyz"),
        *("x_x", "x_y", "x_z"),
        *(f"r_{k + 1}" for k in range(joints)),
        *("omega_x", "omega_y", "omega_z", "v_x", "v_y", "v_z"),
        *(f"r_dot_{k + 1}" for k in range(joints)),
    )


def payload_features(x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch 20"]:
    """`p, v, vec(R), omega, |v|, |omega|` of a payload sample (docs/errata.md, row 9)."""
    v, omega = x[..., 3:6], x[..., 15:18]
    speeds = [jnp.sqrt((a * a).sum(-1, keepdims=True) + 1e-12) for a in (v, omega)]  # smooth at rest
    return jnp.concatenate([x[..., :18], *speeds], axis=-1)


@runtime_checkable
class Features(Protocol):
    """What GPs see of a sample; a kernel of them is a kernel of the sample."""

    def payload(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch features"]:
        """Of a payload sample `p, v, vec(R), omega, ...`."""
        ...

    def agent(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch features"]:
        """Of an agent's sample `vec(R), x, r, omega, v, r_dot`."""
        ...

    def payload_names(self) -> tuple[str, ...]:
        """Of the payload's, in order; one that begins with `omega`, `|omega|` or `r_dot` is a rate."""
        ...

    def agent_names(self, joints: int) -> tuple[str, ...]:
        """Of an agent's with so many joints."""
        ...


@pytree
class Plain:
    """The paper's features: the payload's sample with its speeds, an agent's sample as it is."""

    def payload(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch 20"]:
        """`payload_features`."""
        return payload_features(x)

    def agent(self, x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch inputs"]:
        """The sample."""
        return x

    def payload_names(self) -> tuple[str, ...]:
        """`PAYLOAD_FEATURES`."""
        return PAYLOAD_FEATURES

    def agent_names(self, joints: int) -> tuple[str, ...]:
        """`agent_feature_names`."""
        return agent_feature_names(joints)


class Known(Protocol):
    """What an oracle says beside its GPs, linear in parameters that were identified."""

    def on_payload(self, x: Float[Array, "inputs"]) -> Float[Array, "6"]:
        """Force, N (world), and moment, N m (payload frame), at a payload sample."""
        ...

    def on_agents(self, group: int, x: Float[Array, "agents inputs"]) -> Float[Array, "agents outputs"]:
        """`f_x`, N, `f_w` and `f_r`, N m, of the agents of a group at their samples."""
        ...


@pytree
class Linear:
    """Weights of `basis`, of every output."""

    payload: Float[Array, "functions 6"]
    agents: tuple[Float[Array, "_agents _functions _outputs"], ...]  # by group

    def on_payload(self, x: Float[Array, "inputs"]) -> Float[Array, "6"]:
        """`phi W`."""
        return payload_basis(x) @ self.payload

    def on_agents(self, group: int, x: Float[Array, "agents inputs"]) -> Float[Array, "agents outputs"]:
        """`phi W`."""
        weights = self.agents[group]
        return (agent_basis(x, weights.shape[2] - 6)[:, :, None] * weights).sum(1)


@pytree
class Air:
    """Drag of bodies, and what rotors lack of thrust: `-c v`, with the payload's lever b, and `k R e_3` of agents."""

    payload: Float[Array, "4"]  # c, N s/m, and c b, N s
    agents: tuple[Float[Array, "_agents 2"], ...]  # c, N s/m, and k, N

    def on_payload(self, x: Float[Array, "inputs"]) -> Float[Array, "6"]:
        """`-c v` and `b x R^T (-c v)`."""
        v, R = x[3:6], x[6:15].reshape(3, 3)
        return jnp.concatenate([-self.payload[0] * v, -so3.cross(self.payload[1:], R.T @ v)])

    def on_agents(self, group: int, x: Float[Array, "agents inputs"]) -> Float[Array, "agents outputs"]:
        """`-c v + k R e_3`; no moments."""
        n_r, (c, k) = (x.shape[1] - 18) // 2, self.agents[group].T
        v, up = x[:, 15 + n_r : 18 + n_r], x[:, jnp.array([2, 5, 8])]
        return jnp.concatenate([k[:, None] * up - c[:, None] * v, jnp.zeros((len(x), 3 + n_r))], axis=1)


def no_air(sizes: Sequence[int]) -> Air:
    """Before anything is known of groups of so many agents."""
    return Air(payload=jnp.zeros(4), agents=tuple(jnp.zeros((size, 2)) for size in sizes))


def basis(p: Float[Array, "*batch 3"], v: Float[Array, "*batch 3"], rest: Float[Array, "*batch rest"]) -> Array:
    """`1, p, p p^T, v, |v| v, rest`: wind and springs to second order in space, drag, and a body's own coordinates."""
    one = jnp.ones_like(p[..., :1])
    pairs = [p[..., i : i + 1] * p[..., i:] for i in range(3)]
    speed = jnp.sqrt((v * v).sum(-1, keepdims=True) + 1e-12)  # smooth at rest
    return jnp.concatenate([one, p, *pairs, v, speed * v, rest], axis=-1)


def payload_basis(x: Float[Array, "*batch inputs"]) -> Float[Array, "*batch functions"]:
    """`basis` of a payload sample, with `vec(R), omega`."""
    return basis(x[..., :3], x[..., 3:6], x[..., 6:18])


def agent_basis(x: Float[Array, "*batch inputs"], joints: int) -> Float[Array, "*batch functions"]:
    """`basis` of an agent's sample, with `vec(R), r, omega, r_dot`."""
    v = 15 + joints
    rest = [x[..., :9], x[..., 12:v], x[..., v + 3 :]]
    return basis(x[..., 9:12], x[..., v : v + 3], jnp.concatenate(rest, axis=-1))


def regress(oracle: Oracle, recorded: Recorded, ridge: tuple[float, float]) -> Oracle:
    """The oracle with the weights that minimize `|Y - phi W|^2 + ridge |W|^2`, output by output (host).

    What recursive least squares come to when they are frozen now. ridge: of forces, and of moments and joints.
    """

    def weights(phi: Array, data: gp.Data) -> np.ndarray:
        A, Y = np.asarray(phi)[: int(data.n)], np.asarray(data.Y)[: int(data.n)]
        each = ((ridge[0], Y[:, :3]), (ridge[1], Y[:, 3:]))
        return np.hstack([np.linalg.solve(A.T @ A + c * np.eye(A.shape[1]), A.T @ y) for c, y in each])

    groups = []
    for data in recorded.agents:
        phi = agent_basis(data.X, data.Y.shape[2] - 6)
        each = [weights(phi[j], jax.tree.map(lambda x, j=j: x[j], data)) for j in range(len(data.n))]
        groups.append(jnp.asarray(np.stack(each)))
    linear = Linear(
        payload=jnp.asarray(weights(payload_basis(recorded.payload.X), recorded.payload)), agents=tuple(groups)
    )
    return dataclasses.replace(oracle, known=linear, k=oracle.k + 1)


@pytree
class Oracle:
    """The frozen predictors of one interval; those that have no data predict zero with their prior's deviation."""

    features: Features = Plain()
    payload: gp.GP
    agents: tuple[gp.GP, ...]  # by group, agents lead
    theta: Float[Array, "10"]  # nominal less true rigid-body parameters of the payload, or zero: see `regressor`
    known: Linear | Air | None = None  # beside the GPs, see `Known`
    k: Int[Array, ""] = dataclasses.field(default_factory=lambda: jnp.zeros((), int))  # of the update t_k, 0 before any


def regressor(q: PayloadState, a: Float[Array, "3"], alpha: Float[Array, "3"]) -> Float[Array, "6 10"]:
    """`Y` with `Y theta` the inertial wrench of a rigid body, theta = (m, m c, J_xx, J_yy, J_zz, J_xy, J_xz, J_yz).

    `F = m a + R (alpha x + w x (w x)) m c`, `tau = m c x R^T a + J alpha + w x J w`, `a` the acceleration of the
    payload's frame less gravity (world), `J` about its origin. Linear in theta; used for the remark on mean functions.
    """
    w = q.omega
    turn = so3.hat(alpha) + so3.hat(w) @ so3.hat(w)
    zero = jnp.zeros((3, 1))
    force = jnp.concatenate([a[:, None], q.R @ turn, jnp.zeros((3, 6))], axis=1)
    moment = jnp.concatenate([zero, -so3.hat(q.R.T @ a), _symmetric(alpha) + so3.hat(w) @ _symmetric(w)], axis=1)
    return jnp.concatenate([force, moment])


def _symmetric(v: Float[Array, "3"]) -> Float[Array, "3 6"]:
    """`S` with `S j = J v` for `j = (J_xx, J_yy, J_zz, J_xy, J_xz, J_yz)`."""
    x, y, z = v[0], v[1], v[2]
    o = jnp.zeros_like(x)
    return jnp.stack([x, o, o, y, z, o, o, y, o, x, o, z, o, o, z, o, x, y]).reshape(3, 6)


def mean(oracle: Oracle, load: PayloadState, agents: tuple[AgentState, ...]) -> Residual:
    """The oracle's `f_hat` without its parametric part, in a state of the team."""
    return Residual(
        payload=payload_mean(oracle, flat_payload(load, jnp.zeros(6))),
        agents=agents_mean(oracle, tuple(jax.vmap(flat_agent)(q) for q in agents)),
    )


def prediction(
    oracle: Oracle,
    load: PayloadState,
    agents: tuple[AgentState, ...],
    a: Float[Array, "3"],
    alpha: Float[Array, "3"],
) -> Residual:
    """`f_hat`: the means, and `Y theta` of a payload that accelerates by a less gravity, m/s^2, and alpha, rad/s^2."""
    return with_wrench(mean(oracle, load, agents), regressor(load, a, alpha) @ oracle.theta)


@pytree
class Function:
    """An oracle's mean as a function of the state: an unknown whose norm in its RKHS is known."""

    oracle: Oracle

    def __call__(self, z: State) -> Residual:
        """`mean(z)`."""
        return mean(self.oracle, z.payload, z.agents)


def payload_mean(oracle: Oracle, x: Float[Array, "inputs"]) -> Wrench:
    """The GP's share of `f_hat_L` at a payload sample."""
    f = gp.mean(oracle.payload, oracle.features.payload(x))
    if oracle.known is not None:
        f = f + oracle.known.on_payload(x)
    return Wrench(F=f[:3], tau=f[3:])


def agents_mean(oracle: Oracle, x: tuple[Float[Array, "agents inputs"], ...]) -> tuple[AgentForce, ...]:
    """`f_hat_j` of every agent."""
    out = []
    for i, (group, inputs) in enumerate(zip(oracle.agents, x, strict=True)):
        f = jax.vmap(gp.mean)(group, oracle.features.agent(inputs))
        if oracle.known is not None:
            f = f + oracle.known.on_agents(i, inputs)
        out.append(agent_force(f))
    return tuple(out)


def inertial(X: np.ndarray) -> np.ndarray:
    """`Y(x)`, (samples, 6, 10), at payload samples (host)."""
    q = jax.vmap(state_of)(jnp.asarray(X))
    return np.asarray(jax.vmap(regressor)(q, jnp.asarray(X[:, 18:21]), jnp.asarray(X[:, 21:24])))


def identify(Phi: np.ndarray, Y: np.ndarray, K: np.ndarray, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameters from labels, by least squares with a prior deviation on each parameter (host).

    Minimizes `sum_i e_i^T K_i^-1 e_i + |theta / prior|^2`, e the errors `Y - Phi theta` and K_i the covariance of
    output i's, `(outputs, samples, samples)`; a direction that the motion does not excite keeps its prior. Returns
    theta and, per parameter, how much of the prior's deviation remains (1: not excited).
    """
    A = (Phi * prior).swapaxes(0, 1)
    T = np.linalg.solve(K, A)
    H = np.einsum("inp,inq->pq", A, T) + np.eye(len(prior))
    return prior * np.linalg.solve(H, np.einsum("inp,ni->p", T, Y)), np.sqrt(np.diag(np.linalg.inv(H)))


def possible(theta: np.ndarray, believed: Payload) -> np.ndarray:
    """`theta` as far as it leaves a body, `M - M(theta) >= M / 10` (host).

    M is the `(6, 6)` inertia of the payload as believed, `M(theta) = [[m I, -hat(m c)], [hat(m c), J]]`. What is told
    least goes first: J is scaled down, then `m c` with it, then all. Where less than nothing is left a command pushes
    the wrong way, whatever the gains.
    """
    M = block_diag(float(believed.mass) * np.eye(3), believed.inertia)
    for first in (4, 1, 0):
        stays, goes = np.where(np.arange(10) < first, theta, 0.0), np.where(np.arange(10) < first, 0.0, theta)
        room = 0.9 * M - _spatial(stays)
        if eigvalsh(room)[0] > 0:
            break
    return stays + goes / max(1.0, eigvalsh(_spatial(goes), room)[-1])


def _spatial(theta: np.ndarray) -> np.ndarray:
    h, (xx, yy, zz, xy, xz, yz) = np.asarray(so3.hat(jnp.asarray(theta[1:4]))), theta[4:]
    return np.block([[theta[0] * np.eye(3), -h], [h, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])]])


def state_of(x: Float[Array, "24"]) -> PayloadState:
    """Of a payload sample."""
    return PayloadState(p=x[:3], v=x[3:6], R=x[6:15].reshape(3, 3), omega=x[15:18])


@dataclasses.dataclass(frozen=True)
class Training:
    """How hyperparameters are fitted at an update; where there is no `Training`, those of the prior stay."""

    payload: gp.Belief
    agents: tuple[gp.Belief, ...]  # by group
    restarts: int
    max_iterations: int

    def of(self, body: Body) -> gp.Belief:
        """What is believed of a body's hyperparameters before any data."""
        return self.payload if isinstance(body, str) else self.agents[body[0]]


Body = tuple[int, int] | str
"""The payload, as "payload", or (group, agent)."""

Samples = tuple[np.ndarray, np.ndarray, np.ndarray]

Fits = Mapping[Body, gp.Fit]
"""The last fit of each body that has one."""


@dataclasses.dataclass(frozen=True)
class Change:
    """The world of a body has changed: since when, and what was known of it until then."""

    since: float  # s
    model: gp.GP
    theta: Float[Array, "10"]  # of the oracle


Changes = Mapping[Body, Change]
"""The last change of each body that has seen one."""


def raw(recorded: Recorded) -> dict[Body, Samples]:
    """`(X, Y, t)` of every body in the order of time, as recorded: inputs and labels."""
    found: dict[Body, gp.Data] = {"payload": recorded.payload}
    for i, data in enumerate(recorded.agents):
        found |= {(i, j): jax.tree.map(lambda x, j=j: x[j], data) for j in range(len(data.n))}
    out = {}
    for body, data in found.items():
        t = np.asarray(data.t)[: int(data.n)]
        order = np.argsort(t, kind="stable")
        out[body] = np.asarray(data.X)[order], np.asarray(data.Y)[order], t[order]
    return out


def kept(
    oracle: Oracle, before: Recorded, recorded: Recorded, after: float, now: float, span: float, changes: Changes
) -> Recorded:
    """The data sets with what was recorded since `after`, s; of too many samples those that tell most (host).

    As `gp.thinned` has it, with noise that counts as `1 + age / span` times what it is, so that of two samples that
    tell the same the newer one stays. Where a body's world has changed those before it go first.
    """
    held, new = raw(before), raw(recorded)

    def of(body: Body) -> Samples:
        model, fresh = of_body(oracle, body), new[body][2] > after + 1e-9
        x, Y, t = (np.concatenate([old, more[fresh]]) for old, more in zip(held[body], new[body], strict=True))
        since = changes[body].since if body in changes else -np.inf
        Z = features(oracle.features, body, x)
        stays = gp.thinned(Z, model.hyper, model.capacity, 1 + (now - t) / span, first=t < since)
        return x[stays], Y[stays], t[stays]

    return _recorded(before, side_by_side(of, held))


def since(recorded: Recorded, start: Mapping[Body, float]) -> Recorded:
    """The data sets without what bodies recorded before a time of their own, s (host)."""
    left = {}
    for body, of in raw(recorded).items():
        late = of[2] >= start.get(body, -np.inf)
        left[body] = of[0][late], of[1][late], of[2][late]
    return _recorded(recorded, left)


def _recorded(like: Recorded, samples: Mapping[Body, Samples]) -> Recorded:
    """Data sets of these samples."""

    def data(like: gp.Data, of: Samples) -> gp.Data:
        n = len(of[2])
        X, Y, t = (jnp.asarray(np.pad(x, ((0, like.t.shape[-1] - n), *[(0, 0)] * (x.ndim - 1)))) for x in of)
        return dataclasses.replace(like, X=X, Y=Y, t=t, n=jnp.asarray(n))

    groups = []
    for i, group in enumerate(like.agents):
        each = [data(jax.tree.map(lambda x, j=j: x[j], group), samples[i, j]) for j in range(len(group.n))]
        groups.append(jax.tree.map(lambda *x: jnp.stack(x), *each))
    return dataclasses.replace(like, payload=data(like.payload, samples["payload"]), agents=tuple(groups))


def samples(oracle: Oracle, recorded: Recorded, changes: Changes = MappingProxyType({})) -> dict[Body, Samples]:
    """`(X, Y, t)` of every body in the order of time, X features, Y what the GPs are to explain: labels less `beside`.

    Of a body whose world has changed, those since then.
    """
    payload, agents = _beside(oracle.theta, oracle.known, recorded)
    left = dataclasses.replace(
        recorded,
        payload=dataclasses.replace(recorded.payload, Y=recorded.payload.Y - payload),
        agents=tuple(
            data if y is None else dataclasses.replace(data, Y=data.Y - y)
            for data, y in zip(recorded.agents, agents, strict=True)
        ),
    )
    out = {}
    for body, (x, Y, t) in raw(left).items():
        keep = t >= (changes[body].since if body in changes else -np.inf)
        out[body] = features(oracle.features, body, x[keep]), Y[keep], t[keep]
    return out


def features(seen: Features, body: Body, x: np.ndarray) -> np.ndarray:
    """What GPs of a body see of its samples (host)."""
    return np.asarray(seen.payload(jnp.asarray(x)) if isinstance(body, str) else seen.agent(jnp.asarray(x)))


@jax.jit
def _beside(
    theta: Float[Array, "10"], known: Linear | Air | None, recorded: Recorded
) -> tuple[Float[Array, "rows 6"], tuple[Float[Array, "_agents _rows _outputs"] | None, ...]]:
    """What an oracle says beside its GPs at all samples: `Y theta`, and what is known."""
    payload = jax.vmap(_inertial, (0, None))(recorded.payload.X, theta)
    if known is None:
        return payload, (None,) * len(recorded.agents)
    payload = payload + jax.vmap(known.on_payload)(recorded.payload.X)
    of = lambda i, X: jax.vmap(lambda x: known.on_agents(i, x), 1, 1)(X)  # noqa: E731
    return payload, tuple(of(i, data.X) for i, data in enumerate(recorded.agents))


def _inertial(x: Float[Array, "24"], theta: Float[Array, "10"]) -> Float[Array, "6"]:
    """`Y theta` at a payload sample."""
    return regressor(state_of(x), x[18:21], x[21:24]) @ theta


def shifted(change: Change, X: np.ndarray, Y: np.ndarray) -> gp.GP:
    """The model before a change, moved by what samples since say beyond it on average, `f + mean(y - f(x))` (host)."""
    old = change.model
    more = jnp.asarray((Y - told(old, X)[0]).mean(0))
    moved = jnp.where((jnp.arange(old.capacity) < old.n)[:, None], old.Y + jnp.tile(more, (old.capacity, 1)), old.Y)
    return dataclasses.replace(old, Y=moved, hyper=dataclasses.replace(old.hyper, offset=old.hyper.offset + more))


def amended(old: gp.GP, X: np.ndarray, Y: np.ndarray) -> gp.GP:
    """A model of samples since a change, and of those before it that tell most, as the budget has room (host).

    old: as `shifted`. Where the team has not been again the map keeps its shape.
    """
    n = int(old.n)
    Z, both = (np.concatenate([np.asarray(before)[:n], new]) for before, new in ((old.X, X), (old.Y, Y)))
    stays = gp.thinned(Z, old.hyper, old.capacity, np.ones(len(Z)), first=np.arange(len(Z)) < n)
    return gp.condition(Z[stays], both[stays], old.hyper, old.capacity)


def told(model: gp.GP, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A model's means and variances at up to as many places as its capacity: one shape, one program."""
    n = len(X)
    padded = np.concatenate([X, np.repeat(X[:1], model.capacity - n, 0)])
    mean, variance = gp.predict(model, jnp.asarray(padded))
    return np.asarray(mean)[:n], np.asarray(variance)[:n]


def teach(oracle: Oracle, recorded: Recorded, training: Training | None, last: Fits) -> tuple[Oracle, Fits]:
    """The oracle frozen on the data so far: fit from the last hyperparameters, then condition (host).

    A body without data keeps its predictor. The constant part of each output's prior mean is the mean of its labels
    (the remark on mean functions); the rest is the GP's. Bodies are fitted side by side. Without `training` the
    hyperparameters and the prior mean stay as they are, as error bounds ask for.
    """
    found = {body: (X, Y) for body, (X, Y, _) in samples(oracle, recorded).items() if len(X) > 1}

    def study(body: Body) -> tuple[gp.Fit | None, gp.GP]:
        (X, Y), frozen = found[body], of_body(oracle, body)
        if training is None:
            return None, gp.condition(X, Y, frozen.hyper, frozen.capacity)
        before = last.get(body)
        fit = gp.fit(
            X,
            Y,
            belief=training.of(body),
            start=before.hyper if before else None,
            restarts=0 if before else training.restarts,
            max_iterations=training.max_iterations,
        )
        return fit, gp.condition(X, Y, fit.hyper, frozen.capacity)

    learned = side_by_side(study, found)
    fits = {**last, **{body: fit for body, (fit, _) in learned.items() if fit is not None}}
    return with_bodies(oracle, {body: model for body, (_, model) in learned.items()}), fits


def left_out(model: gp.GP, newest: int) -> float:
    """Mean of `(y - f)^2` over its predicted variance of a model's newest samples, each left out; 1 if it fits (host).

    Rasmussen and Williams 2006, Eqs. 5.11 and 5.12.
    """
    off, variance = (np.asarray(x) for x in gp.leave_one_out(model))
    n = int(model.n)
    return float((off**2 / variance)[:, max(0, n - newest) : n].mean())


def side_by_side(study: Callable[[Body], T], bodies: Collection[Body]) -> dict[Body, T]:
    """What a study of each body gives; with one BLAS thread each: at these sizes more only wait for each other."""

    def one(body: Body) -> T:
        interrupt.check()
        return study(body)

    with threadpool_limits(1), ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(bodies, pool.map(one, bodies), strict=True))


def renew(
    oracle: Oracle, recorded: Recorded, changes: Changes = MappingProxyType({}), waiting: Collection[Body] = ()
) -> Oracle:
    """The oracle on the data so far with the hyperparameters and prior means that it has (host).

    A body whose world has changed learns from what is `amended`; while it is in `waiting` its model from before the
    change flies on, `shifted`. A body without data keeps its predictor.
    """
    models = {}
    for body, (X, Y, _) in samples(oracle, recorded, changes).items():
        frozen = of_body(oracle, body)
        if body in changes and len(X):
            moved = shifted(changes[body], X, Y)
            models[body] = moved if body in waiting else amended(moved, X, Y)
        elif body not in changes and len(X) > 1:
            models[body] = gp.condition(X, Y, frozen.hyper, frozen.capacity)
    return with_bodies(oracle, models)


def changed(oracle: Oracle, body: Body, since: float) -> Change:
    """A change of a body's world: what the oracle knows of it is what was known until then."""
    return Change(since=since, model=of_body(oracle, body), theta=oracle.theta)


def of_body(oracle: Oracle, body: Body) -> gp.GP:
    """A body's model."""
    return oracle.payload if isinstance(body, str) else _one(oracle.agents[body[0]], body[1])


def with_bodies(oracle: Oracle, models: Mapping[Body, gp.GP]) -> Oracle:
    """The oracle with some bodies' models in place of what they had."""
    if not models:
        return oracle
    groups = []
    for i, group in enumerate(oracle.agents):
        each = [models[i, j] if (i, j) in models else _one(group, j) for j in range(len(group.n))]
        groups.append(jax.tree.map(lambda *x: jnp.stack(x), *each))
    payload = models.get("payload", oracle.payload)
    return dataclasses.replace(oracle, payload=payload, agents=tuple(groups), k=oracle.k + 1)


def _one(group: gp.GP, j: int) -> gp.GP:
    return jax.tree.map(lambda x: x[j], group)


@jax.jit
def payload_deviation(oracle: Oracle, x: Float[Array, "time inputs"]) -> Float[Array, "time 6"]:
    """Posterior deviation of each payload output along a path of samples, N and N m."""
    return jnp.sqrt(jax.vmap(gp.variance, in_axes=(None, 0))(oracle.payload, oracle.features.payload(x)))


@jax.jit
def agent_deviation(group: gp.GP, x: Float[Array, "time agents features"]) -> Float[Array, "time agents outputs"]:
    """Posterior deviation of each agent output of a group along a path of features."""
    each = jax.vmap(gp.variance)
    return jnp.sqrt(jax.vmap(each, in_axes=(None, 0))(group, x))
