"""Gymnasium environments of the transport task (extra `gym`): one simulation, or a vector of simulations.

The action is a wrench that is added to the desired wrench of the payload controller. The observation contains
estimates, reference and forces of the control context, each divided by a bound and clipped to [-1, 1]. A part of the
controller computes the observation, so that it cannot contain true states. The reward uses the true errors.

Example:
    >>> import gymnasium  # doctest: +SKIP
    >>> env = gymnasium.make(
    ...     "colift.integrations.gymnasium_env:colift/Transport-v0", scenario="paper"
    ... )  # doctest: +SKIP
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from colift import scenario
from colift.closed_loop import simulator, termination
from colift.math import linalg, so3
from colift.math.pytree import pytree
from colift.models import grasp
from colift.onboard import interfaces
from colift.onboard.control import tracking
from colift.runtime import extras
from colift.scenario import experiment

try:
    import gymnasium
    from gymnasium.utils import seeding
    from gymnasium.vector import AutoresetMode
    from gymnasium.vector.utils import batch_space
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"Gymnasium is not installed: {extras.install_command('gym')}", name="gymnasium"
    ) from error

BOUNDS = {  # of the observed quantities, in this order
    "e_p": 1.0,  # m, estimated position minus reference position
    "e_v": 2.0,  # m/s
    "e_R": 1.0,  # 1, estimated
    "e_omega": 3.0,  # rad/s
    "a": 5.0,  # m/s^2, estimated payload acceleration minus reference acceleration
    "v_d": 3.0,  # m/s, of the reference
    "a_d": 5.0,  # m/s^2
    "W": 2.0,  # 1, desired force of the last control period over the payload's weight, world
    "b": 1.0,  # 1, thrust direction of each agent, world
    "lam": 2.0,  # 1, estimated contact forces over the payload's weight, world
}
HALF_REWARD_E_P, HALF_REWARD_E_R = 0.05, 0.05  # m and 1, norms of e_p and e_R at which the reward is 0.5


@pytree
class ResidualWrenchController:
    """Payload controller that adds a residual wrench to another payload controller.

    Implements `interfaces.PayloadController`. Its state is the observation and the state of the other controller.

    Attributes:
        base: Other payload controller.
        wrench: Residual wrench: force [N], world frame; moment [N m], payload frame.
        initial_observation: Observation before the first control period, zero.
    """

    base: interfaces.PayloadController
    wrench: Float[Array, "6"]
    initial_observation: Float[Array, " observation"]

    def init(self) -> Any:
        """Return the initial observation and the initial state of the other controller."""
        return self.initial_observation, self.base.init()

    def compute(self, state: Any, context: interfaces.ControlContext) -> tuple[tracking.AccelerationCommand, Any]:
        """Add `F / m_L` to a and `J_L^-1 tau` to alpha, so that the desired wrench increases by `(F, tau)`."""
        acceleration_cmd, base_state = self.base.compute(state[1], context)
        payload = context.team.payload
        alpha = acceleration_cmd.alpha + linalg.solve(payload.inertia, self.wrench[3:, None])[:, 0]
        acceleration_cmd = dataclasses.replace(
            acceleration_cmd, a=acceleration_cmd.a + self.wrench[:3] / payload.mass, alpha=alpha
        )
        return acceleration_cmd, (observation(context), base_state)


def observation(context: interfaces.ControlContext) -> Float[Array, " observation"]:
    """Compute the observation from the control context.

    Args:
        context: Data that are available on board.

    Returns:
        The quantities of `BOUNDS` divided by their bounds and clipped to [-1, 1]; 0 for values that are not finite.
    """
    q, d, payload = context.estimate.payload, context.setpoint, context.team.payload
    weight = payload.mass * jnp.sqrt((context.team.gravity * context.team.gravity).sum())
    parts = {
        "e_p": q.p - d.p,
        "e_v": q.v - d.v,
        "e_R": so3.e_R(q.R, d.R),
        "e_omega": so3.e_omega(q.R, q.omega, d.R, d.omega),
        "a": context.estimate.a_L[:3] - d.a,
        "v_d": d.v,
        "a_d": d.a,
        "W": context.last_wrench.F / weight,
        "b": jnp.concatenate([agent.R[:, :, 2].reshape(-1) for agent in context.estimate.agents]),
        "lam": grasp.stack_contacts(context.estimate.lam).reshape(-1) / weight,
    }
    scaled = jnp.concatenate([parts[name] / bound for name, bound in BOUNDS.items()])
    return jnp.where(jnp.isfinite(scaled), jnp.clip(scaled, -1.0, 1.0), 0.0)


def reward(e_p: Float[Array, "ticks 3"], e_R: Float[Array, "ticks 3"]) -> Float[Array, "ticks"]:
    """Compute the reward `1 / (1 + |e_p|^2 / p0^2 + |e_R|^2 / R0^2)` with `p0 = 0.05 m` and `R0 = 0.05`.

    Args:
        e_p: True position error, world frame [m].
        e_R: True attitude error [1].

    Returns:
        The reward of each tick; 0 if an error is not finite.
    """
    cost = (e_p * e_p).sum(1) / HALF_REWARD_E_P**2 + (e_R * e_R).sum(1) / HALF_REWARD_E_R**2
    return jnp.where(jnp.isfinite(cost), 1 / (1 + cost), 0.0)


@dataclasses.dataclass(frozen=True)
class TransportTask:
    """Task of single and vector environments.

    Attributes:
        setup: World and controller; the payload controller is a `ResidualWrenchController`.
        initial_states: State of the loop at the start of an episode.
        action_scale: Wrench of an action of ones: three forces [N] and three moments [N m].
        frame_skip: Control periods of a step.
        max_episode_steps: Number of steps after which an episode is truncated.
    """

    setup: simulator.LoopConfig
    initial_states: simulator.LoopState
    action_scale: np.ndarray
    frame_skip: int
    max_episode_steps: int


def make_task(
    name: str, case: str, overrides: Sequence[str], step_s: float, force_N: float, moment_Nm: float
) -> TransportTask:
    """Make the task of an environment from a scenario.

    A scenario that is not valid raises the exceptions of `scenario.load_scenario` and `experiment.make_experiment`.

    Args:
        name: Name or path of the scenario.
        case: Case without model updates.
        overrides: Settings that replace those of the scenario, in the form `path=value`.
        step_s: Duration of a step [s], a multiple of the control period.
        force_N: Force of an action of 1 [N].
        moment_Nm: Moment of an action of 1 [N m].

    Returns:
        The task.

    Raises:
        ValueError: If the case updates its models, or if one of the last three arguments is out of range.
    """
    flight_experiment = experiment.make_experiment(scenario.load_scenario(name, overrides), case).calibrated()
    if flight_experiment.update_times:
        raise ValueError(
            f"case {case!r} updates its models during a flight; use a case without updates, for example C1"
        )
    ticks = round(step_s / flight_experiment.dt)
    if not (ticks >= 1 and abs(ticks * flight_experiment.dt - step_s) <= 1e-9):
        raise ValueError(f"step_s = {step_s:g}: must be a multiple of the control period, {flight_experiment.dt:g} s")
    for setting, value in (("force_N", force_N), ("moment_Nm", moment_Nm)):
        if not 0 <= value < np.inf:
            raise ValueError(f"{setting} = {value:g}: must be finite and not negative")
    team = flight_experiment.world.team
    initial_observation = jnp.zeros(3 * (len(BOUNDS) - 2 + sum(team.sizes) + team.contacts))
    payload_controller = ResidualWrenchController(
        base=flight_experiment.controller.payload_controller,
        wrench=jnp.zeros(6),
        initial_observation=initial_observation,
    )
    setup = dataclasses.replace(
        flight_experiment.loop_config,
        controller=dataclasses.replace(flight_experiment.controller, payload_controller=payload_controller),
    )
    return TransportTask(
        setup=setup,
        initial_states=simulator.reset(setup, flight_experiment.initial_state),
        action_scale=np.array([force_N] * 3 + [moment_Nm] * 3),
        frame_skip=ticks,
        max_episode_steps=round(flight_experiment.duration / flight_experiment.dt) // ticks,
    )


@pytree
class StepResult:
    """Result of one step of the environment.

    Attributes:
        loop: State of the loop after the step.
        observation: Observation after the step.
        reward: Mean reward over the step.
        e_p: RMS of the true position error over the step [m].
    """

    loop: simulator.LoopState
    observation: Float[Array, "*flights observation"]
    reward: Float[Array, "*flights"]
    e_p: Float[Array, "*flights"]


def _payload_controller(setup: simulator.LoopConfig) -> ResidualWrenchController:
    """Return the payload controller of an environment."""
    payload_controller = setup.controller.payload_controller
    assert isinstance(payload_controller, ResidualWrenchController)  # ensured by `make_task`
    return payload_controller


@functools.partial(jax.jit, static_argnums=0)
def step(
    ticks: int, setup: simulator.LoopConfig, loop: simulator.LoopState, wrench: Float[Array, "6"], seed: Int[Array, "2"]
) -> StepResult:
    """Simulate one step of one flight.

    Args:
        ticks: Control periods of the step.
        setup: World and controller.
        loop: State of the loop before the step.
        wrench: Residual wrench: force [N], world frame; moment [N m], payload frame.
        seed: Seed of the noise of the episode, and number of steps since its start.

    Returns:
        State, observation and reward after the step.
    """
    payload_controller = dataclasses.replace(_payload_controller(setup), wrench=wrench)
    setup = dataclasses.replace(
        setup, controller=dataclasses.replace(setup.controller, payload_controller=payload_controller)
    )
    noise = setup.world.sample_noise(jax.random.fold_in(jax.random.key(seed[0]), seed[1]), ticks)
    next_loop, rows = simulator.rollout(setup, loop, noise, jnp.asarray(ticks))
    simulated = next_loop.tick - loop.tick  # fewer than `ticks` if the flight ends within the step
    rewards, squared_errors = (
        jnp.where(jnp.arange(ticks) < simulated, x, 0.0)
        for x in (reward(rows.e_p, rows.e_R), (rows.e_p * rows.e_p).sum(1))
    )
    e_p = jnp.sqrt(squared_errors.sum() / jnp.maximum(simulated, 1).astype(squared_errors.dtype))
    return StepResult(
        loop=next_loop,
        observation=next_loop.controller.control_law.payload_controller[0],
        reward=rewards.mean(),
        e_p=e_p,
    )


@functools.partial(jax.jit, static_argnums=0)
def vector_step(
    ticks: int,
    setup: simulator.LoopConfig,
    loops: simulator.LoopState,
    wrenches: Float[Array, "flights 6"],
    seeds: Int[Array, "flights 2"],
    initial_states: simulator.LoopState,
    reset: Bool[Array, "flights"],
) -> StepResult:
    """Simulate one step of several flights.

    Args:
        ticks: Control periods of the step.
        setup: World and controller.
        loops: States of the loops before the step.
        wrenches: Residual wrenches: forces [N], world frame; moments [N m], payload frame.
        seeds: For each flight the seed of the noise of the episode, and the number of steps since its start.
        initial_states: State of the loop at the start of an episode.
        reset: True for flights that restart at the initial state; their wrench is zero.

    Returns:
        States, observations and rewards after the step.
    """

    def restart(new: Array, past: Array) -> Array:
        return jnp.where(reset.reshape(-1, *[1] * (past.ndim - 1)), new[None], past)

    def step_one(loop: simulator.LoopState, wrench: Float[Array, "6"], seed: Int[Array, "2"]) -> StepResult:
        return step(ticks, setup, loop, wrench, seed)

    return jax.vmap(step_one)(
        jax.tree.map(restart, initial_states, loops), jnp.where(reset[:, None], 0.0, wrenches), seeds
    )


class TransportEnv(gymnasium.Env):
    """Gymnasium environment of one simulation.

    Action: force (world frame) over `force_N` and moment (payload frame) over `moment_Nm`, each in [-1, 1].
    Observation: the quantities of `BOUNDS` in [-1, 1], agents and contacts in team order. Reward: mean of `reward` over
    the step; 0 after the end of the flight. An episode is terminated at a termination limit of the scenario. It is
    truncated after the duration of the scenario. `info["cause"]` is the `termination.TerminationCause`. `info["e_p_m"]`
    is the RMS of the true position error over the step [m]. A reset simulates one step without action to obtain an
    observation.

    Attributes:
        task: Simulation, action scale and length of an episode.
        action_space: Space of the actions.
        observation_space: Space of the observations.

    Example:
        >>> env = TransportEnv("paper", step_s=0.02)  # doctest: +SKIP
        >>> observation, info = env.reset(seed=0)  # doctest: +SKIP
        >>> action = env.action_space.sample()  # doctest: +SKIP
        >>> observation, reward, terminated, truncated, info = env.step(action)  # doctest: +SKIP
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012, as Gymnasium declares it

    def __init__(
        self,
        scenario: str = "paper",
        case: str = "C1",
        overrides: Sequence[str] = (),
        step_s: float = 0.02,
        force_N: float = 2.0,
        moment_Nm: float = 0.2,
    ) -> None:
        """Make the environment; `make_task` lists the exceptions.

        Args:
            scenario: Name or path of the scenario.
            case: Case without model updates.
            overrides: Settings that replace those of the scenario, in the form `path=value`.
            step_s: Duration of a step [s], a multiple of the control period.
            force_N: Force of an action of 1 [N].
            moment_Nm: Moment of an action of 1 [N m].
        """
        self.task = make_task(scenario, case, overrides, step_s, force_N, moment_Nm)
        self.action_space, self.observation_space = _spaces(self.task)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Start an episode with new noise and simulate one step without action.

        Args:
            seed: Seed of the random number generator.
            options: Not used.

        Returns:
            Observation and info.
        """
        super().reset(seed=seed, options=options)
        self._noise_seed, self._steps, self._loop = _draw_seed(self.np_random), 0, self.task.initial_states
        observed, _, _, _, info = self.step(np.zeros(6, np.float32))
        return observed, info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Simulate one step.

        Args:
            action: Force and moment over their scales, clipped to [-1, 1].

        Returns:
            Observation, reward, terminated, truncated, info.
        """
        wrench, seed = _wrench(self.task, action), jnp.array([self._noise_seed, self._steps])
        result = step(self.task.frame_skip, self.task.setup, self._loop, wrench, seed)
        self._loop, self._steps = result.loop, self._steps + 1
        cause = termination.TerminationCause(int(result.loop.termination))
        terminated = cause != termination.TerminationCause.NONE
        time_over = self._steps >= self.task.max_episode_steps
        info = {"cause": cause, "e_p_m": float(result.e_p)}
        observed = np.asarray(result.observation, np.float32)
        return observed, float(result.reward), terminated, time_over and not terminated, info


class TransportVecEnv(gymnasium.vector.VectorEnv):
    """Gymnasium vector environment: several simulations of `TransportEnv`, vectorized by `jax.vmap`.

    A flight that has ended restarts in the next step; this step has no action and a reward of 0. `info["cause"]` is an
    array of `termination.TerminationCause` values, `info["e_p_m"]` is an array of RMS errors [m].

    Attributes:
        task: Simulation, action scale and length of an episode.
        num_envs: Number of simulations.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str = "paper",
        case: str = "C1",
        overrides: Sequence[str] = (),
        step_s: float = 0.02,
        force_N: float = 2.0,
        moment_Nm: float = 0.2,
    ) -> None:
        """Make the environment; `make_task` lists the exceptions.

        Args:
            num_envs: Number of simulations.
            scenario: Name or path of the scenario.
            case: Case without model updates.
            overrides: Settings that replace those of the scenario, in the form `path=value`.
            step_s: Duration of a step [s], a multiple of the control period.
            force_N: Force of an action of 1 [N].
            moment_Nm: Moment of an action of 1 [N m].
        """
        self.task, self.num_envs = make_task(scenario, case, overrides, step_s, force_N, moment_Nm), num_envs
        spaces = _spaces(self.task)
        self.single_action_space, self.single_observation_space = spaces
        self.action_space, self.observation_space = (batch_space(space, num_envs) for space in spaces)
        self._generators: list[np.random.Generator] = []

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode of each simulation and simulate one step without action.

        Args:
            seed: Seed of each simulation, or of the first one; then the seeds of the others are the next integers.
            options: Not used.

        Returns:
            Observations and info.

        Raises:
            ValueError: If the number of seeds differs from the number of simulations.
        """
        consecutive = range(seed, seed + self.num_envs) if isinstance(seed, int) else [None] * self.num_envs
        seeds = seed if isinstance(seed, Sequence) else consecutive
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: {len(seeds)} seeds for {self.num_envs} simulations")
        previous = self._generators or [None] * self.num_envs
        self._generators = [
            old if old is not None and each is None else seeding.np_random(each)[0]
            for old, each in zip(previous, seeds, strict=True)
        ]
        n = self.num_envs
        self._loops = jax.tree.map(lambda x: jnp.repeat(x[None], n, axis=0), self.task.initial_states)
        self._noise_seed, self._steps, self._ended = np.zeros(n, int), np.zeros(n, int), np.ones(n, bool)
        observed, _, _, _, info = self.step(np.zeros((n, 6), np.float32))
        return observed, info

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Simulate one step of each flight; flights that have ended restart.

        Args:
            actions: Forces and moments over their scales, clipped to [-1, 1].

        Returns:
            Observations, rewards, terminated, truncated, info.
        """
        reset = self._ended
        for i in np.flatnonzero(reset):
            self._noise_seed[i], self._steps[i] = _draw_seed(self._generators[i]), 0
        seeds = jnp.asarray(np.stack([self._noise_seed, self._steps], axis=1))
        wrenches, initial_states = _wrench(self.task, actions), self.task.initial_states
        result = vector_step(
            self.task.frame_skip, self.task.setup, self._loops, wrenches, seeds, initial_states, jnp.asarray(reset)
        )
        self._loops, self._steps = result.loop, self._steps + 1
        cause = np.asarray(result.loop.termination)
        terminated = cause > 0
        truncated = (self._steps >= self.task.max_episode_steps) & ~terminated
        self._ended = terminated | truncated
        rewards = np.where(reset, 0.0, np.asarray(result.reward))
        info = {"cause": cause, "e_p_m": np.asarray(result.e_p)}
        return np.asarray(result.observation, np.float32), rewards, terminated, truncated, info


def _spaces(task: TransportTask) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Return the spaces of actions and observations."""
    shape = _payload_controller(task.setup).initial_observation.shape
    return gymnasium.spaces.Box(-1.0, 1.0, (6,), np.float32), gymnasium.spaces.Box(-1.0, 1.0, shape, np.float32)


def _wrench(task: TransportTask, action: np.ndarray) -> Float[Array, "*flights 6"]:
    """Return the residual wrench of an action."""
    return jnp.asarray(np.clip(np.asarray(action, float), -1.0, 1.0) * task.action_scale)


def _draw_seed(generator: np.random.Generator) -> int:
    """Draw the seed of the noise of an episode."""
    return int(generator.integers(2**63 - 1))


gymnasium.register(
    "colift/Transport-v0",
    entry_point="colift.integrations.gymnasium_env:TransportEnv",
    vector_entry_point="colift.integrations.gymnasium_env:TransportVecEnv",
)
