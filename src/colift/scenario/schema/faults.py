"""Settings of faults during a flight.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from colift.scenario import fields
from colift.scenario.schema.shared import Start, Transmitted

SensorFailure = Literal["stuck", "off", "garbage", "wrong", "slow", "delayed", "intermittent"]
"""Failure of a reading."""


class _Fault(Start):
    """Settings that all faults have."""

    who: Annotated[str, Field(min_length=1, max_length=200)]
    """Part that fails: an agent, or as stated below."""

    @property
    def last_time(self) -> float:
        """Time at which the fault ends [s]; inf if it lasts until the end of the flight."""
        return math.inf


class _TemporaryFault(_Fault):
    """A fault that may end."""

    end_s: fields.Span | None = None
    """End time; default: it lasts until the end of the flight."""

    @property
    def last_time(self) -> float:
        """Time at which the fault ends [s]; inf if it lasts until the end of the flight."""
        return math.inf if self.end_s is None else self.end_s

    @property
    def period(self) -> str:
        """Text of the time in which the fault acts."""
        return f"from {self.start_s:g} s" + ("" if self.end_s is None else f" to {self.end_s:g} s")


class _DegradedFault(_TemporaryFault):
    """A fault after which a part has another effect."""

    to: fields.Fraction
    """Remaining share of thrust and body torque."""


class ThrustFault(_DegradedFault):
    """Loss of effectiveness of all rotors of an agent: a share of thrust and body torque remains.

    Losses of one agent at the same time multiply.
    """

    kind: Literal["thrust"]
    """Selects this fault."""

    def describe(self) -> str:
        """Describe the fault in a few words."""
        return f"rotors of {self.who} at {self.to:.3g} of their effectiveness {self.period}"


class RotorFault(_DegradedFault):
    """Fault of one rotor, stated as `agent/number`; requires `rotors` of the actuators.

    Rotors are numbered from 0 counterclockwise, seen from above. Rotor 0 is half a spacing from the first body axis.
    """

    kind: Literal["rotor"]
    """Selects this fault."""
    to: fields.Fraction | None = None  # ty: ignore[incompatible-attribute-override]
    """Remaining share of the rotor's force, 0: off; default: the rotor is stuck at its force before `start_s`."""

    def describe(self) -> str:
        """Describe the fault in a few words."""
        state = "stuck" if self.to is None else f"at {self.to:.3g} of its force"
        return f"rotor {self.who} {state} {self.period}"


class SensorFault(Transmitted, _DegradedFault):
    """Failure of one reading of an agent or of the payload, by the names of PX4.

    The age of a reading is reported for `off`, `slow` and `intermittent`. Failures of all agents that are always
    reported are [sensor models](#intermittent).
    """

    kind: Literal["sensor"]
    """Selects this fault."""
    reading: Annotated[str, Field(min_length=1, max_length=20)]
    """Name of the reading, as after the dot in the `channels` of sensor models."""
    to: SensorFailure = "stuck"  # ty: ignore[incompatible-attribute-override]
    """Failure. `stuck`, `off`: the last value; `garbage`: white noise of 100 times the standard deviation of `sensors`;
    `wrong`: an offset of this size on every component; `slow`: samples at `rate_Hz`; `delayed`: late by `delay_s`;
    `intermittent`: samples are lost with `dropout_probability`."""
    rate_Hz: fields.Rate = 5.0
    """Rate of samples of a `slow` reading, at most the control rate."""
    delay_s: fields.Span = 0.1
    """Delay of a `delayed` reading, a multiple of the control period."""
    dropout_probability: fields.Fraction = 0.9
    """Probability that a sample of an `intermittent` reading is lost in a control period."""

    def describe(self) -> str:
        """Describe the fault in a few words."""
        state = {
            "slow": f"slow, {self.rate_Hz:g} Hz",
            "delayed": f"delayed by {self.delay_s:g} s",
            "intermittent": f"intermittent, {self.dropout_probability:.3g} lost",
        }.get(self.to, self.to)
        return f"reading {self.reading} of {self.who} {state} {self.period}"


class LinkFault(Transmitted, _TemporaryFault):
    """Link from the leader to an agent with its own rate, a delay and losses.

    The agent holds the last command that it received. After 0.4 s the commanded acceleration decreases to zero with a
    time constant of 0.2 s. The contact forces keep weight, residuals and internal forces.
    """

    kind: Literal["link"]
    """Selects this fault."""

    def describe(self) -> str:
        """Describe the fault in a few words."""
        lost = f", {self.dropout_probability:.3g} lost" if self.dropout_probability else ""
        late = f", {self.delay_s:g} s late" if self.delay_s else ""
        return f"commands to {self.who} at {self.rate_Hz:g} Hz{late}{lost} {self.period}"


class ContactFault(_TemporaryFault):
    """A contact, stated as `agent/arm`, opens; no force acts there while it is open.

    With a start time of 0 it is open from the start, and its gripper reports this to the controller.
    From `end_s` on it closes as soon as its tip is within 10 mm of its contact point, by a perfectly inelastic impact.
    """

    kind: Literal["contact"]
    """Selects this fault."""

    def describe(self) -> str:
        """Describe the fault in a few words."""
        closing = "" if self.end_s is None else f", may close from {self.end_s:g} s"
        return f"contact {self.who} open from {self.start_s:g} s{closing}"


Fault = Annotated[ThrustFault | RotorFault | SensorFault | LinkFault | ContactFault, Field(discriminator="kind")]
