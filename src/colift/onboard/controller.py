"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import mul
from colift.math.pytree import pytree
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import AgentInput, AgentState, Clock, Inputs, PayloadState, Residual, State, Wrench
from colift.onboard.control import preview, tracking
from colift.onboard.control.actuator_compensation import Direct
from colift.onboard.estimation.state_estimator import Estimate
from colift.onboard.interfaces import (
    Ahead,
    Allocator,
    Drive,
    Estimator,
    Forces,
    Leader,
    Now,
    Predictor,
    Realizer,
    Telemetry,
)
from colift.onboard.learning import residual_correction, residual_model
from colift.onboard.learning.recorder import Recorded, Recorder
from colift.trajectories import base

Scalar = Float[Array, ""]


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


# The paper's pilot ----------------------------------------------------------------------------------------------------


@pytree
class Memory:
    """What the flying software keeps between ticks."""

    estimator: Any
    recorder: Recorded
    predictor: Any
    leader: Any
    sent: Inputs  # commands of the last tick, after the thrust limit
    drive: Any
    listener: Any
    W: Wrench  # desired wrench of the last tick
    ticks: Scalar  # 0 before the first tick, 1 after


@pytree
class Asked:
    """What the law asks of the team."""

    to: tracking.Command
    f_hat: Residual
    W: Wrench
    forces: Forces


@pytree
class LeaderFollower:
    """The paper's pilot: its parts, what they take along, and what has been learned so far."""

    team: Team  # nominal
    path: base.Reference
    estimator: Estimator
    recorder: Recorder
    oracle: residual_model.Oracle
    predictor: Predictor
    leader: Leader
    allocator: Allocator
    realizer: Realizer
    drive: Drive = Direct()
    listener: residual_correction.Listener | None = None
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
            news=None if self.listener is None else residual_correction.no_news(self.team, clock.t),
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
        W = tracking.wrench(load, self.team.gravity, now.q_hat.payload, to, f_hat.payload)
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

        load, asked = jax.vmap(at)(step * jnp.asarray(preview.NODES))
        return Ahead(step=step, load=load, to=asked.to, lam=asked.forces.lam, f_hat=asked.f_hat)
