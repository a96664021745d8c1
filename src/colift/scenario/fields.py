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
class Said:
    """Words that the schema of a setting carries: its unit, or why its range ends where it does."""

    key: str
    words: str

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(core), self.key: self.words}


def of_unit(unit: str) -> Said:
    """The unit of a setting that carries a letter of the paper rather than a word with a unit."""
    return Said("unit", unit)


def because(why: str) -> Said:
    """Why a range ends where it does."""
    return Said("why", why)


def _thrice(given: Any) -> Any:
    """One number for all three axes."""
    return (given,) * 3 if isinstance(given, int | float) and not isinstance(given, bool) else given


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]

# Bodies ---------------------------------------------------------------------------------------------------------------

_BODY = because("nothing that is carried by air is larger than 100 m")
Mass = Annotated[Number, Field(ge=1e-6, le=1e5), because("from a milligram to a hundred tonnes")]
MassChange = Annotated[Number, Field(ge=-1e5, le=1e5), because("a hundred tonnes")]
InertiaEntry = Annotated[Number, Field(ge=-1e9, le=1e9), because("a hundred tonnes, 100 m out")]
BodyLength = Annotated[Number, Field(ge=-100, le=100), _BODY]
BodyPoint = tuple[BodyLength, BodyLength, BodyLength]
Direction = Annotated[Number, Field(ge=-1e6, le=1e6), because("only the direction counts; squares must not overflow")]
Axis = tuple[Direction, Direction, Direction]
JointAngle = Annotated[Number, Field(ge=-63, le=63), because("ten turns; more is likely degrees")]

# Space and motion -----------------------------------------------------------------------------------------------------

_FAR = because("10 km; put the origin nearer to the team")
_SOUND = because("the speed of sound")
_SPIN = because("32 turns a second")
_TURNS = because("ten turns")
Coordinate = Annotated[Number, Field(ge=-1e4, le=1e4), _FAR]
Position = tuple[Coordinate, Coordinate, Coordinate]
Extent = Annotated[Number, Field(ge=0, le=1e4), _FAR]
Extents = tuple[Extent, Extent, Extent]
Distance = Annotated[Number, Field(ge=1e-3, le=1e4), _FAR]
Width = Annotated[Number, Field(ge=0.01, le=1e4), because("a stream narrower than 1 cm or wider than 10 km is none")]
Speed = Annotated[Number, Field(ge=-340, le=340), _SOUND]
Velocity = tuple[Speed, Speed, Speed]
Spin = Annotated[Number, Field(ge=-200, le=200), _SPIN]
BodyRate = tuple[Spin, Spin, Spin]
Gravity = Annotated[Number, Field(ge=-30, le=30), because("Jupiter has 25 m/s²")]
Gravities = tuple[Gravity, Gravity, Gravity]
Degrees = Annotated[Number, Field(ge=-3600, le=3600), _TURNS]
Angles = tuple[Degrees, Degrees, Degrees]
HalfTurn = Annotated[Number, Field(ge=-180, le=180), because("a rotation vector is half a turn long at most")]
AnyAngle = Annotated[Number, Field(ge=1, le=180), because("half a turn allows every attitude")]
RotationVector = tuple[HalfTurn, HalfTurn, HalfTurn]
Wavenumber = Annotated[
    Number,
    Field(ge=-63, le=63),
    because("a wavelength of 10 cm, the size of the smallest vehicle; see Gust for the rest"),
]
WaveVector = tuple[Wavenumber, Wavenumber, Wavenumber]

# Time -----------------------------------------------------------------------------------------------------------------

Duration = Annotated[Number, Field(ge=0.1, le=1e5), because("from a few ticks to a day")]
Time = Annotated[Number, Field(ge=0, le=1e5), because("a day")]
Span = Annotated[Number, Field(ge=1e-3, le=1e5), because("from a millisecond to a day")]
LookAhead = Annotated[
    Number,
    Field(ge=1e-3, le=0.2),
    because("a quartic through times closer than a tick is rounding, or 0.8 s long is none"),
]
Period = Annotated[Number, Field(ge=0.1, le=1e5), because("no payload swings faster than 10 Hz, no run lasts a day")]
Periods = Annotated[tuple[Period, Period, Period], BeforeValidator(_thrice)]
ControlRate = Annotated[
    Number, Field(ge=20, le=1e4), because("below 20 Hz no attitude loop holds, above 10 kHz no flight computer runs")
]
Rate = Annotated[
    Number, Field(ge=1e-3, le=1e4), because("from once in a quarter of an hour to the highest control rate")
]
Bandwidth = Annotated[
    Number, Field(ge=1e-3, le=1e6), because("a quarter of an hour to react; above the control rate it is at once")
]

BandwidthOrNone = Annotated[Number, Field(ge=0, le=1e4), because("above the control rate it is at once")]

# Forces ---------------------------------------------------------------------------------------------------------------

_HEAVY = because("a hundred tonnes weigh 1e6 N")
_LEVER = because("a hundred tonnes on a lever of 1 m")
Newton = Annotated[Number, Field(ge=-1e6, le=1e6), _HEAVY]
Force = tuple[Newton, Newton, Newton]
Thrust = Annotated[Number, Field(ge=1e-5, le=1e6), because("what lifts a milligram to a hundred tonnes")]
NewtonMetre = Annotated[Number, Field(ge=-1e6, le=1e6), _LEVER]
Moment = tuple[NewtonMetre, NewtonMetre, NewtonMetre]
Torque = Annotated[Number, Field(ge=1e-9, le=1e6), _LEVER]
Lever = Annotated[Number, Field(ge=1e-6, le=100), _BODY]
RotorCount = Annotated[Count, Field(ge=4, le=64), because("below four no vehicle turns about every axis alone")]
DryFriction = Annotated[Number, Field(ge=0, le=1e6), _LEVER]
Drag = Annotated[Number, Field(ge=0, le=1e4), because("1 m/s gives the weight of a tonne")]
Stiffness = Annotated[Number, Field(ge=1e-6, le=1e6), because("stiffer than a steel rope of 10 m; a tether is slack")]
SlowSpeed = Annotated[Number, Field(ge=1e-6, le=200), because("below it friction is a step that no tick resolves")]

# Noise, gains, learning -----------------------------------------------------------------------------------------------

_USELESS = because("a sensor that says less than nothing about the flight")
Noise = Annotated[Number, Field(ge=0, le=1e3), _USELESS]
AngularNoise = Annotated[Number, Field(ge=0, le=90), because("a right angle: an attitude is not measured any more")]
Gain = Annotated[Number, Field(ge=1e-6, le=1e8), because("beyond it no control rate that is allowed is stable")]
GainOrNone = Annotated[Number, Field(ge=0, le=1e8), because("beyond it no control rate that is allowed is stable")]
Gains = Annotated[tuple[Gain, Gain, Gain], BeforeValidator(_thrice)]
Haste = Annotated[
    Number,
    Field(ge=1, le=10),
    because("below 1 vehicles are slowed down; beyond 10 noise is all that they are driven by"),
]
Deviation = Annotated[Number, Field(ge=1e-9, le=1e6), because("from a thousandth of an insect's weight to 100 tonnes")]
Lengthscale = Annotated[
    Number, Field(ge=1e-3, le=1e6), because("shorter, no two samples have anything in common; longer, all are one")
]
Factor = Annotated[Number, Field(ge=1.01, le=100), because("at 1 nothing is learned; a factor of 100 says nothing")]
Norm = Annotated[Number, Field(ge=1e-6, le=1e6), because("signal deviations; beyond it the prior says nothing")]
Ratio = Annotated[Number, Field(ge=0, le=100), because("a hundred times what it is a share of")]
Share = Annotated[Number, Field(ge=0, le=0.99), because("a share of what there is")]
Coherence = Annotated[
    Number, Field(ge=0.01, le=1), because("no more than all comes true; where nothing is asked, noise is trusted")
]
Confidence = Annotated[Number, Field(gt=0, lt=1), because("a probability")]
Capacity = Annotated[
    Count, Field(ge=2, le=20_000), because("a fit takes two; the posterior's matrices grow with the square")
]
Centers = Annotated[Count, Field(ge=1, le=20_000), because("kernels' matrices grow with the square")]
Substeps = Annotated[Count, Field(ge=1, le=1000), because("a step cannot be less than one; more than a thousand crawl")]
Restarts = Annotated[Count, Field(ge=0, le=100), because("each is a whole fit, at every update")]
Iterations = Annotated[Count, Field(ge=1, le=10_000), because("a fit ends or is lost long before")]
Seed = Annotated[Count, Field(ge=0, le=2**63 - 1), because("what the random generator takes: 63 bits")]
