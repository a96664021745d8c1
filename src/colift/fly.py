"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from colift import allocate as al
from colift import balance, control, grasp, innovation, learn, reference, so3
from colift.estimate import Estimate
from colift.lag import Lag, Lagging
from colift.linalg import mul
from colift.lowpass import blend
from colift.measurement import Measurement
from colift.model import (
    Agent,
    AgentForce,
    AgentInput,
    AgentState,
    Clock,
    Inputs,
    PayloadState,
    Residual,
    State,
    Team,
    Wrench,
    with_wrench,
)
from colift.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class Now:
    """What is known on board when a tick is decided."""

    team: Team  # nominal
    clock: Clock
    m: Measurement | None  # None where the law is linearized around a state that nothing measured
    q_hat: Estimate
    d: reference.Setpoint
    W: Wrench  # desired wrench of the last tick, zero before the first
    ticks: Scalar  # 0 in the first tick, 1 after: what is differenced or filtered begins with the second
    ahead: Ahead | None = None  # for a realizer that looks ahead
    news: innovation.News | None = None  # what labels say beyond what is learned, where a pilot listens


@pytree
class Ahead:
    """What the law asks for on the reference, at `control.NODES` times the step around now; times lead."""

    step: Scalar  # s
    load: PayloadState
    to: control.Command
    lam: Float[Array, "times contacts 3"]  # N
    f_hat: Residual


def known(pilot: LeaderFollower, z: State, a_L: Float[Array, "6"], t: Scalar) -> Now:
    """What a pilot would know that believed in the state z, without a measurement: to ask its law about a state."""
    lam = tuple(jnp.zeros_like(group.contact) for group in pilot.team.groups)
    return Now(
        team=pilot.team,
        clock=Clock(t=t, dt=jnp.ones(())),
        m=None,
        q_hat=Estimate(agents=z.agents, payload=z.payload, a_L=a_L, lam=lam),
        d=pilot.path.at(t),
        W=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
        ticks=jnp.zeros(()),
    )


# The doors ------------------------------------------------------------------------------------------------------------


@runtime_checkable
class Pilot(Protocol):
    """All that flies: what a loop asks of it."""

    def begin(self, first: Measurement, clock: Clock) -> tuple[Inputs, Any]:
        """The command that holds the team until the first tick, and the memory before it, from a reading at rest."""
        ...

    def tick(self, memory: Any, m: Measurement, clock: Clock) -> tuple[Inputs, Any, Telemetry]:
        """The command from now on, the next memory, and what was decided."""
        ...


@runtime_checkable
class Estimator(Protocol):
    """States from measurements; ours is `estimate.Estimator`."""

    def begin(self, team: Team, first: Measurement) -> Any:
        """The memory at a reading at rest; team: nominal."""
        ...

    def observe(self, team: Team, memory: Any, m: Measurement, applied: Inputs, clock: Clock) -> tuple[Estimate, Any]:
        """What is believed now, given the command of the last tick; with labels, if it has any."""
        ...


@runtime_checkable
class Predictor(Protocol):
    """`f_hat`, the unknown forces that commands compensate."""

    def begin(self, team: Team) -> Any:
        """The memory before the first tick; team: nominal."""
        ...

    def observe(self, memory: Any, oracle: learn.Oracle, now: Now) -> Any:
        """The memory of this tick, once a tick."""
        ...

    def predict(self, memory: Any, oracle: learn.Oracle, now: Now, to: control.Command) -> Residual:
        """The prediction for a payload that is commanded to accelerate so: now, or where a pilot looks ahead."""
        ...


@runtime_checkable
class Drive(Protocol):
    """Commands under which vehicles give what is asked of them."""

    def begin(self, command: Inputs) -> Any:
        """The memory after a command has acted for ever."""
        ...

    def command(self, team: Team, memory: Any, asked: Inputs, dt: Scalar) -> tuple[Inputs, Any]:
        """The command for what is asked, and the memory one tick of dt, s, later."""
        ...

    def acts(self, memory: Any, sent: Inputs) -> Inputs:
        """What is believed to have acted in the last tick, in which `sent` was commanded."""
        ...


@runtime_checkable
class Leader(Protocol):
    """How the payload is to accelerate."""

    def begin(self) -> Any:
        """The memory before the first tick."""
        ...

    def lead(self, memory: Any, now: Now) -> tuple[control.Command, Any]:
        """The commanded acceleration of the payload, and its rate."""
        ...


@runtime_checkable
class Allocator(Protocol):
    """Contact forces that give a payload wrench."""

    def allocate(self, now: Now, W: Wrench, W_dot: Wrench) -> Forces:
        """Commanded contact forces, and their rate."""
        ...


@runtime_checkable
class Realizer(Protocol):
    """Commands that put contact forces on the payload."""

    def realize(self, now: Now, to: control.Command, forces: Forces, f_hat: Residual) -> tuple[Inputs, Saturated]:
        """Every agent's command, and which thrusts were limited."""
        ...


Saturated = tuple[Bool[Array, "agents"], ...]


@pytree
class Forces:
    """What an allocator asks of the contacts, world."""

    lam: Float[Array, "contacts 3"]  # N, on the payload
    lam_dot: Float[Array, "contacts 3"]  # N/s
    eta: Float[Array, " eta"]  # N, internal-force input, for the log


# The paper's parts, and those of the rivals ---------------------------------------------------------------------------


@pytree
class Learned:
    """`f_hat`: the frozen oracles at the estimated state, the parametric part at the commanded acceleration."""

    def begin(self, team: Team) -> Any:
        """Nothing is remembered."""
        return ()

    def observe(self, memory: Any, oracle: learn.Oracle, now: Now) -> Any:
        """Nothing is remembered."""
        return memory

    def predict(self, memory: Any, oracle: learn.Oracle, now: Now, to: control.Command) -> Residual:
        """`f_hat_L = mean_L(q_L) + Y(q_L, a, alpha) theta`, `f_hat_j = mean_j(q_j)`."""
        q_hat = now.q_hat
        return learn.prediction(oracle, q_hat.payload, q_hat.agents, to.a - now.team.gravity, to.alpha)


@pytree
class Observed:
    """Another predictor with a wrench observer added: a low-pass of what the last command did not explain.

    `d = m_L (v_dot - a_g) - F_d`, `J w_dot + w x J w - tau_d`: residual and realization error in one.
    """

    predictor: Predictor
    bandwidth: Float[Array, "2"]  # Hz, of the force and of the moment

    def begin(self, team: Team) -> Any:
        """What is observed, and the other's memory."""
        return jnp.zeros(6), self.predictor.begin(team)

    def observe(self, memory: Any, oracle: learn.Oracle, now: Now) -> Any:
        """`d+ = d + b (d_now - d)`."""
        d, of_other = memory
        q, a = now.q_hat.payload, now.q_hat.a_L
        W = balance.payload(now.team.payload, a[:3] - now.team.gravity, a[3:], q.omega)
        left = jnp.concatenate([W.F - now.W.F, W.tau - now.W.tau])
        # before the first tick there was no command to explain anything
        d = d + now.ticks * jnp.repeat(blend(self.bandwidth, now.clock.dt), 3) * (left - d)
        return d, self.predictor.observe(of_other, oracle, now)

    def predict(self, memory: Any, oracle: learn.Oracle, now: Now, to: control.Command) -> Residual:
        """The other's prediction, and what is observed on the payload."""
        d, of_other = memory
        return with_wrench(self.predictor.predict(of_other, oracle, now, to), d)


@pytree
class Corrected:
    """Another predictor as far as labels go along with it, and what they say beyond.

    `m + alpha (f_hat - m) + r + (w lead + s) r'`, s ahead of now: m the mean as late as labels, alpha how much of its
    changes they make as well, r' the rate of the label less alpha m, w how much of such rates came true before. Of an
    agent r' is the part that it may follow without hearing itself (`colift.echo`).
    """

    predictor: Predictor
    lead: Scalar  # s, for the delay of labels
    heeded: tuple[Float[Array, "agents"], ...]  # 0 to 1, by group

    def begin(self, team: Team) -> Any:
        """The other's memory."""
        return self.predictor.begin(team)

    def observe(self, memory: Any, oracle: learn.Oracle, now: Now) -> Any:
        """The other's memory."""
        return self.predictor.observe(memory, oracle, now)

    def predict(self, memory: Any, oracle: learn.Oracle, now: Now, to: control.Command) -> Residual:
        """The sum of both. Raises ValueError where the pilot does not listen."""
        if now.news is None:
            raise ValueError("this predictor needs a pilot that listens: `LeaderFollower.listener`")
        f = self.predictor.predict(memory, oracle, now, to)
        news, s = now.news, now.clock.t - now.news.t

        def corrected(f: Array, m: Array, alpha: Array, r: Array, rate: Array, w: Array) -> Array:
            return m + alpha * (f - m) + r + (w * self.lead + s) * rate

        agents = zip(news.rate.agents, self.heeded, strict=True)
        heeded = tuple(jax.tree.map(functools.partial(jnp.multiply, c[:, None]), of) for of, c in agents)
        rate = dataclasses.replace(news.rate, agents=heeded)
        return jax.tree.map(corrected, f, news.mean, news.trust, news.r, rate, news.ahead)


@pytree
class Known:
    """The residual as a function that is known exactly, which no team has: what a study measures learners by."""

    function: Callable[[State, control.Command, Scalar], Residual]  # of state, acceleration and time, s; a PyTree

    def begin(self, team: Team) -> Any:
        """Nothing is remembered."""
        return ()

    def observe(self, memory: Any, oracle: learn.Oracle, now: Now) -> Any:
        """Nothing is remembered."""
        return memory

    def predict(self, memory: Any, oracle: learn.Oracle, now: Now, to: control.Command) -> Residual:
        """The function at the estimated state and the commanded acceleration."""
        z = State(agents=now.q_hat.agents, payload=now.q_hat.payload)
        return self.function(z, to, now.clock.t)


@pytree
class Geometric:
    """The paper's leader (Eq. payload_force_cmd_learning, payload_torque_cmd_learning), as accelerations."""

    gains: control.Gains

    def begin(self) -> Any:
        """Nothing is remembered."""
        return ()

    def lead(self, memory: Any, now: Now) -> tuple[control.Command, Any]:
        """`control.command`."""
        return control.command(self.gains, now.q_hat.payload, now.q_hat.a_L[:3], now.d), memory


@pytree
class Integral:
    """Another leader with integral action: `a - K_i int e_p`, `alpha - k_i int e_R`, summed over ticks."""

    leader: Leader
    K_i: Scalar  # 1/s^3
    k_i: Scalar  # 1/s^3

    def begin(self) -> Any:
        """`(K_i int e_p, k_i int e_R)`, and the other's memory."""
        return jnp.zeros(6), self.leader.begin()

    def lead(self, memory: Any, now: Now) -> tuple[control.Command, Any]:
        """The other's command less the integrals."""
        past, of_other = memory
        q, d = now.q_hat.payload, now.d
        rate = jnp.concatenate([self.K_i * (q.p - d.p), self.k_i * so3.e_R(q.R, d.R)])
        integral = past + now.clock.dt * rate
        to, of_other = self.leader.lead(of_other, now)
        return dataclasses.replace(to, a=to.a - integral[:3], alpha=to.alpha - integral[3:]), (integral, of_other)


@pytree
class Internal:
    """An internal-force input that is switched on for a while."""

    eta: Float[Array, " eta"]  # N, coordinates in the allocation's kernel
    start: Scalar  # s
    end: Scalar  # s
    ramp: Scalar  # s


@pytree
class Linear:
    """One of the linear allocations, with an internal force."""

    allocation: al.Allocation
    internal: Internal

    def allocate(self, now: Now, W: Wrench, W_dot: Wrench) -> Forces:
        """`lam = inverse W + kernel eta + offset`; of its rate, what the wrench's is."""
        on, R = self.internal, now.q_hat.payload.R
        eta = reference.pulse(now.clock.t, on.start, on.end, on.ramp) * on.eta
        rate = dataclasses.replace(self.allocation, offset=jnp.zeros_like(self.allocation.offset))
        return Forces(
            lam=al.apply(self.allocation, R, W, eta),
            lam_dot=al.apply(rate, R, W_dot, jnp.zeros_like(eta)),
            eta=eta,
        )


@pytree
class Aligned:
    """The paper's realization: thrust along a commanded direction, tips on the payload, torques by inverse dynamics."""

    gains: control.Gains
    heading: tuple[Float[Array, "agents"], ...]  # rad
    rest: tuple[Float[Array, "agents n_r"], ...]

    def realize(self, now: Now, to: control.Command, forces: Forces, f_hat: Residual) -> tuple[Inputs, Saturated]:
        """`control.realize` of every agent, thrust limited to what its rotors give."""
        team, inputs, saturated = now.team, [], []
        realize = jax.vmap(control.realize, in_axes=(0, None, None, 0, None, None, 0, 0, 0))
        shares = tuple(
            control.Share(lam=lam, lam_dot=lam_dot, heading=heading, rest=rest)
            for lam, lam_dot, heading, rest in zip(
                grasp.split(team, forces.lam), grasp.split(team, forces.lam_dot), self.heading, self.rest, strict=True
            )
        )
        turns = self.turns(now, to, shares, f_hat)
        for group, q, share, f, turn in zip(team.groups, now.q_hat.agents, shares, f_hat.agents, turns, strict=True):
            asked = realize(group, self.gains, team.gravity, q, now.q_hat.payload, to, share, f, turn)
            u = jnp.clip(asked.u, 0.0, group.thrust_max)
            inputs.append(AgentInput(u=u, tau=asked.tau, tau_r=asked.tau_r))
            saturated.append(u != asked.u)
        return tuple(inputs), tuple(saturated)

    def turns(
        self, now: Now, to: control.Command, shares: tuple[control.Share, ...], f_hat: Residual
    ) -> tuple[control.Turn, ...]:
        """`control.aligned`, by group."""
        turn = jax.vmap(control.aligned, in_axes=(0, None, None, 0, 0))
        each = zip(now.team.groups, shares, f_hat.agents, strict=True)
        return tuple(turn(group, now.team.gravity, to, share, f) for group, share, f in each)


@pytree
class Anticipating(Aligned):
    """The same with the attitude's rates from the reference ahead, for a pilot with a `look_ahead`."""

    def turns(
        self, now: Now, to: control.Command, shares: tuple[control.Share, ...], f_hat: Residual
    ) -> tuple[control.Turn, ...]:
        """`control.anticipated`, by group. Raises ValueError where the pilot does not look ahead."""
        if now.ahead is None:
            raise ValueError("this realizer needs a pilot that looks ahead: `LeaderFollower.look_ahead`")
        far, team, out = now.ahead, now.team, []
        lam = jax.vmap(lambda x: grasp.split(team, x))(far.lam)
        for group, q, share, f, lam_far, f_far in zip(
            team.groups, now.q_hat.agents, shares, f_hat.agents, lam, far.f_hat.agents, strict=True
        ):
            out.append(
                jax.vmap(self._turn, in_axes=(None, None, 0, 0, 0, 0, 1, 1))(
                    now, to, group, q, share, f, lam_far, f_far.f_x
                )
            )
        return tuple(out)

    def _turn(
        self,
        now: Now,
        to: control.Command,
        agent: Agent,
        q: AgentState,
        share: control.Share,
        f_hat: AgentForce,
        lam: Float[Array, "times arms 3"],
        f_x: Float[Array, "times 3"],
    ) -> control.Turn:
        far, gravity = now.ahead, now.team.gravity
        assert far is not None
        f = agent.mass.sum() * (far.to.a - gravity[None]) + lam.sum(1) - f_x
        ahead = control.Ahead(step=far.step, load=far.load, to=far.to, f=f)
        return control.anticipated(agent, gravity, q, to, share, f_hat, ahead)


@pytree
class Direct:
    """Commands are what is asked, and act at once."""

    def begin(self, command: Inputs) -> Any:
        """Nothing is remembered."""
        return ()

    def command(self, team: Team, memory: Any, asked: Inputs, dt: Scalar) -> tuple[Inputs, Any]:
        """What is asked."""
        return asked, memory

    def acts(self, memory: Any, sent: Inputs) -> Inputs:
        """The last command."""
        return sent


@pytree
class Hastened:
    """Vehicles with a lag that is known, driven so that they follow `haste` times as fast."""

    lag: Lag
    haste: Scalar

    def begin(self, command: Inputs) -> Lagging:
        """The lag's memory."""
        return self.lag.begin(command)

    def command(self, team: Team, memory: Lagging, asked: Inputs, dt: Scalar) -> tuple[Inputs, Lagging]:
        """`lag.hastened`, thrust within what rotors give."""
        commands = self.lag.hastened(memory, asked, self.haste, dt)
        commands = tuple(
            dataclasses.replace(one, u=jnp.clip(one.u, 0.0, group.thrust_max))
            for one, group in zip(commands, team.groups, strict=True)
        )
        return commands, self.lag.follow(memory, commands, dt)

    def acts(self, memory: Lagging, sent: Inputs) -> Inputs:
        """What the lag has made of the commands so far."""
        return memory.acts


# The paper's pilot ----------------------------------------------------------------------------------------------------


@pytree
class Memory:
    """What the flying software keeps between ticks."""

    estimator: Any
    recorder: learn.Recorded
    predictor: Any
    leader: Any
    sent: Inputs  # commands of the last tick, after the thrust limit
    drive: Any
    listener: Any
    W: Wrench  # desired wrench of the last tick
    ticks: Scalar  # 0 before the first tick, 1 after


@pytree
class Telemetry:
    """What one tick decided, for the log."""

    q_hat: Estimate
    d: reference.Setpoint
    W_d: Wrench
    lam_cmd: Float[Array, "contacts 3"]
    f_hat: Residual
    eta: Float[Array, " eta"]
    saturated: Saturated
    news: innovation.News | None = None


@pytree
class Asked:
    """What the law asks of the team."""

    to: control.Command
    f_hat: Residual
    W: Wrench
    forces: Forces


@pytree
class LeaderFollower:
    """The paper's pilot: its parts, what they take along, and what has been learned so far."""

    team: Team  # nominal
    path: reference.Reference
    estimator: Estimator
    recorder: learn.Recorder
    oracle: learn.Oracle
    predictor: Predictor
    leader: Leader
    allocator: Allocator
    realizer: Realizer
    drive: Drive = Direct()
    listener: innovation.Listener | None = None
    look_ahead: Scalar | None = None  # s between the times around now at which the law is evaluated on the reference

    def begin(self, first: Measurement, clock: Clock) -> tuple[Inputs, Memory]:
        """The command at rest, and the memory before the first tick: empty data sets, that command last applied."""
        none = tuple(
            AgentInput(u=jnp.zeros(size), tau=jnp.zeros((size, 3)), tau_r=jnp.zeros((size, group.tree.joints)))
            for size, group in zip(self.team.sizes, self.team.groups, strict=True)
        )
        memory = Memory(
            estimator=self.estimator.begin(self.team, first),
            recorder=self.recorder.begin(self.team, self.oracle),
            predictor=self.predictor.begin(self.team),
            leader=self.leader.begin(),
            sent=none,
            drive=self.drive.begin(none),
            listener=None if self.listener is None else self.listener.begin(self.team),
            W=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
            ticks=jnp.zeros(()),
        )
        q_hat, _ = self.estimator.observe(self.team, memory.estimator, first, none, clock)
        now = Now(
            team=self.team,
            clock=clock,
            m=first,
            q_hat=q_hat,
            d=self.path.at(clock.t),
            W=memory.W,
            ticks=memory.ticks,
            news=None if self.listener is None else innovation.no_news(self.team, clock.t),
        )
        hover, _, _ = self.decide(memory.leader, memory.predictor, now)
        return hover, dataclasses.replace(memory, sent=hover, drive=self.drive.begin(hover))

    def tick(self, memory: Memory, m: Measurement, clock: Clock) -> tuple[Inputs, Memory, Telemetry]:
        """One control tick: the commands, the next memory, and what was decided."""
        applied = self.drive.acts(memory.drive, memory.sent)
        q_hat, seen = self.estimator.observe(self.team, memory.estimator, m, applied, clock)
        d = self.path.at(clock.t)
        now = Now(team=self.team, clock=clock, m=m, q_hat=q_hat, d=d, W=memory.W, ticks=memory.ticks)
        heard = memory.listener
        if self.listener is not None:
            heard, news = self.listener.listen(heard, self.team, self.oracle, q_hat, clock)
            now = dataclasses.replace(now, news=news)
        predictor = self.predictor.observe(memory.predictor, self.oracle, now)
        asked, leader, decided = self.decide(memory.leader, predictor, now)
        command, drive = self.drive.command(self.team, memory.drive, asked, clock.dt)
        memory = Memory(
            estimator=seen,
            recorder=self.recorder.record(memory.recorder, m, q_hat.labelled, clock.t),
            listener=heard,
            predictor=predictor,
            leader=leader,
            sent=command,
            drive=drive,
            W=decided.W_d,
            ticks=jnp.ones(()),
        )
        return command, memory, decided

    def decide(self, leader: Any, predictor: Any, now: Now) -> tuple[Inputs, Any, Telemetry]:
        """The control law at what is known now: what it asks of the vehicles, and the leader's next memory."""
        asked, then_leader = self._asked(leader, predictor, now)
        if self.look_ahead is not None:
            now = dataclasses.replace(now, ahead=self._ahead(leader, predictor, now, self.look_ahead))
        inputs, saturated = self.realizer.realize(now, asked.to, asked.forces, asked.f_hat)
        decided = Telemetry(
            q_hat=now.q_hat,
            d=now.d,
            W_d=asked.W,
            lam_cmd=asked.forces.lam,
            f_hat=asked.f_hat,
            eta=asked.forces.eta,
            saturated=saturated,
            news=now.news,
        )
        return inputs, then_leader, decided

    def _asked(self, leader: Any, predictor: Any, now: Now) -> tuple[Asked, Any]:
        to, leader = self.leader.lead(leader, now)
        f_hat = self.predictor.predict(predictor, self.oracle, now, to)
        load = self.team.payload
        W = control.wrench(load, self.team.gravity, now.q_hat.payload, to, f_hat.payload)
        forces = self.allocator.allocate(now, W, Wrench(F=load.mass * to.jerk, tau=jnp.zeros(3)))
        return Asked(to=to, f_hat=f_hat, W=W, forces=forces), leader

    def _ahead(self, leader: Any, predictor: Any, now: Now, step: Scalar) -> Ahead:
        """The law on the reference around now: the payload on it, agents carried along as they turn now."""

        def at(s: Scalar) -> tuple[PayloadState, Asked]:
            clock = dataclasses.replace(now.clock, t=now.clock.t + s)
            d = self.path.at(clock.t)
            load = PayloadState(R=d.R, p=d.p, v=d.v, omega=d.omega)

            def carried(q: AgentState) -> AgentState:
                R, x = mul(q.R, so3.exp(s * q.omega)), q.x + d.p - now.d.p
                return dataclasses.replace(q, R=R, x=x, v=d.v, r_dot=jnp.zeros_like(q.r_dot))

            agents, a_L = tuple(jax.vmap(carried)(q) for q in now.q_hat.agents), jnp.concatenate([d.a, d.omega_dot])
            q_hat = dataclasses.replace(now.q_hat, payload=load, agents=agents, a_L=a_L)
            then = dataclasses.replace(now, clock=clock, d=d, q_hat=q_hat)
            return load, self._asked(leader, predictor, then)[0]

        load, asked = jax.vmap(at)(step * jnp.asarray(control.NODES))
        return Ahead(step=step, load=load, to=asked.to, lam=asked.forces.lam, f_hat=asked.f_hat)
