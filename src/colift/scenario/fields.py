"""The numbers of a scenario: each with the range in which it can be meant, and why no further.

A range is no advice. It is wide enough for every vehicle and load that this project is for, and refuses slips: another
unit, a sign, a digit too many. Where what can be meant depends on other settings, `references` says so.
"""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler
from pydantic_core import CoreSchema


@dataclasses.dataclass(frozen=True)
class SchemaNote:
    """Words that the schema of a setting carries: its unit, or why its range ends where it does."""

    key: str
    words: str

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(core), self.key: self.words}


def unit(unit: str) -> SchemaNote:
    """The unit of a setting that carries a letter of the paper rather than a word with a unit."""
    return SchemaNote("unit", unit)


def range_reason(why: str) -> SchemaNote:
    """Why a range ends where it does."""
    return SchemaNote("why", why)


def _thrice(given: Any) -> Any:
    """One number for all three axes."""
    return (given,) * 3 if isinstance(given, int | float) and not isinstance(given, bool) else given


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]

# Bodies ---------------------------------------------------------------------------------------------------------------

_BODY = range_reason("nothing that is carried by air is larger than 100 m")
Mass = Annotated[Number, Field(ge=1e-6, le=1e5), range_reason("from a milligram to a hundred tonnes")]
MassChange = Annotated[Number, Field(ge=-1e5, le=1e5), range_reason("a hundred tonnes")]
InertiaEntry = Annotated[Number, Field(ge=-1e9, le=1e9), range_reason("a hundred tonnes, 100 m out")]
BodyLength = Annotated[Number, Field(ge=-100, le=100), _BODY]
BodyPoint = tuple[BodyLength, BodyLength, BodyLength]
Direction = Annotated[
    Number, Field(ge=-1e6, le=1e6), range_reason("only the direction counts; squares must not overflow")
]
Axis = tuple[Direction, Direction, Direction]
JointAngle = Annotated[Number, Field(ge=-63, le=63), range_reason("ten turns; more is likely degrees")]

# Space and motion -----------------------------------------------------------------------------------------------------

_FAR = range_reason("10 km; put the origin nearer to the team")
_SOUND = range_reason("the speed of sound")
_SPIN = range_reason("32 turns a second")
_TURNS = range_reason("ten turns")
Coordinate = Annotated[Number, Field(ge=-1e4, le=1e4), _FAR]
Position = tuple[Coordinate, Coordinate, Coordinate]
Length = Annotated[Number, Field(ge=0, le=1e4), _FAR]
Extents = tuple[Length, Length, Length]
Distance = Annotated[Number, Field(ge=1e-3, le=1e4), _FAR]
Width = Annotated[
    Number, Field(ge=0.01, le=1e4), range_reason("a stream narrower than 1 cm or wider than 10 km is none")
]
Speed = Annotated[Number, Field(ge=-340, le=340), _SOUND]
Velocity = tuple[Speed, Speed, Speed]
AngularRate = Annotated[Number, Field(ge=-200, le=200), _SPIN]
BodyRate = tuple[AngularRate, AngularRate, AngularRate]
Gravity = Annotated[Number, Field(ge=-30, le=30), range_reason("Jupiter has 25 m/s²")]
Gravities = tuple[Gravity, Gravity, Gravity]
Degrees = Annotated[Number, Field(ge=-3600, le=3600), _TURNS]
Angles = tuple[Degrees, Degrees, Degrees]
HalfTurn = Annotated[Number, Field(ge=-180, le=180), range_reason("a rotation vector is half a turn long at most")]
AnyAngle = Annotated[Number, Field(ge=1, le=180), range_reason("half a turn allows every attitude")]
RotationVector = tuple[HalfTurn, HalfTurn, HalfTurn]
Wavenumber = Annotated[
    Number,
    Field(ge=-63, le=63),
    range_reason("a wavelength of 10 cm, the size of the smallest vehicle; see Gust for the rest"),
]
WaveVector = tuple[Wavenumber, Wavenumber, Wavenumber]

# Time -----------------------------------------------------------------------------------------------------------------

Duration = Annotated[Number, Field(ge=0.1, le=1e5), range_reason("from a few ticks to a day")]
Time = Annotated[Number, Field(ge=0, le=1e5), range_reason("a day")]
Span = Annotated[Number, Field(ge=1e-3, le=1e5), range_reason("from a millisecond to a day")]
LookAhead = Annotated[
    Number,
    Field(ge=1e-3, le=0.2),
    range_reason("a quartic through times closer than a tick is rounding, or 0.8 s long is none"),
]
Period = Annotated[
    Number, Field(ge=0.1, le=1e5), range_reason("no payload swings faster than 10 Hz, no run lasts a day")
]
Periods = Annotated[tuple[Period, Period, Period], BeforeValidator(_thrice)]
ControlRate = Annotated[
    Number,
    Field(ge=20, le=1e4),
    range_reason("below 20 Hz no attitude loop holds, above 10 kHz no flight computer runs"),
]
Rate = Annotated[
    Number, Field(ge=1e-3, le=1e4), range_reason("from once in a quarter of an hour to the highest control rate")
]
Bandwidth = Annotated[
    Number, Field(ge=1e-3, le=1e6), range_reason("a quarter of an hour to react; above the control rate it is at once")
]

BandwidthOrNone = Annotated[Number, Field(ge=0, le=1e4), range_reason("above the control rate it is at once")]

# Forces ---------------------------------------------------------------------------------------------------------------

_HEAVY = range_reason("a hundred tonnes weigh 1e6 N")
_LEVER = range_reason("a hundred tonnes on a lever of 1 m")
Newton = Annotated[Number, Field(ge=-1e6, le=1e6), _HEAVY]
Force = tuple[Newton, Newton, Newton]
Thrust = Annotated[Number, Field(ge=1e-5, le=1e6), range_reason("what lifts a milligram to a hundred tonnes")]
NewtonMetre = Annotated[Number, Field(ge=-1e6, le=1e6), _LEVER]
Moment = tuple[NewtonMetre, NewtonMetre, NewtonMetre]
Torque = Annotated[Number, Field(ge=1e-9, le=1e6), _LEVER]
LeverArm = Annotated[Number, Field(ge=1e-6, le=100), _BODY]
RotorCount = Annotated[Count, Field(ge=4, le=64), range_reason("below four no vehicle turns about every axis alone")]
DryFriction = Annotated[Number, Field(ge=0, le=1e6), _LEVER]
Drag = Annotated[Number, Field(ge=0, le=1e4), range_reason("1 m/s gives the weight of a tonne")]
Stiffness = Annotated[
    Number, Field(ge=1e-6, le=1e6), range_reason("stiffer than a steel rope of 10 m; a tether is slack")
]
SlowSpeed = Annotated[Number, Field(ge=1e-6, le=200), range_reason("below it friction is a step that no tick resolves")]

# Noise, gains, learning -----------------------------------------------------------------------------------------------

_USELESS = range_reason("a sensor that says less than nothing about the flight")
Noise = Annotated[Number, Field(ge=0, le=1e3), _USELESS]
AngularNoise = Annotated[
    Number, Field(ge=0, le=90), range_reason("a right angle: an attitude is not measured any more")
]
Gain = Annotated[Number, Field(ge=1e-6, le=1e8), range_reason("beyond it no control rate that is allowed is stable")]
GainOrNone = Annotated[Number, Field(ge=0, le=1e8), range_reason("beyond it no control rate that is allowed is stable")]
Gains = Annotated[tuple[Gain, Gain, Gain], BeforeValidator(_thrice)]
BandwidthRatio = Annotated[
    Number,
    Field(ge=1, le=10),
    range_reason("below 1 vehicles are slowed down; beyond 10 noise is all that they are driven by"),
]
Deviation = Annotated[
    Number, Field(ge=1e-9, le=1e6), range_reason("from a thousandth of an insect's weight to 100 tonnes")
]
Lengthscale = Annotated[
    Number, Field(ge=1e-3, le=1e6), range_reason("shorter, no two samples have anything in common; longer, all are one")
]
Factor = Annotated[
    Number, Field(ge=1.01, le=100), range_reason("at 1 nothing is learned; a factor of 100 says nothing")
]
Norm = Annotated[Number, Field(ge=1e-6, le=1e6), range_reason("signal deviations; beyond it the prior says nothing")]
Ratio = Annotated[Number, Field(ge=0, le=100), range_reason("a hundred times what it is a share of")]
Fraction = Annotated[Number, Field(ge=0, le=0.99), range_reason("a share of what there is")]
Coherence = Annotated[
    Number, Field(ge=0.01, le=1), range_reason("no more than all comes true; where nothing is asked, noise is trusted")
]
Confidence = Annotated[Number, Field(gt=0, lt=1), range_reason("a probability")]
Capacity = Annotated[
    Count, Field(ge=2, le=20_000), range_reason("a fit takes two; the posterior's matrices grow with the square")
]
Centers = Annotated[Count, Field(ge=1, le=20_000), range_reason("kernels' matrices grow with the square")]
Substeps = Annotated[
    Count, Field(ge=1, le=1000), range_reason("a step cannot be less than one; more than a thousand crawl")
]
Restarts = Annotated[Count, Field(ge=0, le=100), range_reason("each is a whole fit, at every update")]
Iterations = Annotated[Count, Field(ge=1, le=10_000), range_reason("a fit ends or is lost long before")]
Seed = Annotated[Count, Field(ge=0, le=2**63 - 1), range_reason("what the random generator takes: 63 bits")]
