"""Types of the numbers of a scenario, each with its valid range and the reason for it.

A range is not a recommendation. It admits all vehicles and payloads within the scope of the project and refuses slips,
such as a wrong unit, sign or exponent. Limits that depend on other settings are in `cross_checks`.
"""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, GetJsonSchemaHandler, Tag
from pydantic_core import CoreSchema


@dataclasses.dataclass(frozen=True)
class SchemaNote:
    """Entry of the JSON schema of a setting: its unit, or the reason for its range."""

    key: str  # name of the entry
    text: str  # its value

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(core), self.key: self.text}


def unit(unit: str) -> SchemaNote:
    """Return the unit of a setting whose name does not contain it, such as a symbol of the paper."""
    return SchemaNote("unit", unit)


def range_reason(reason: str) -> SchemaNote:
    """Return the reason for a range."""
    return SchemaNote("why", reason)


def _repeat_three_times(given: Any) -> Any:
    """Repeat a single number for all three axes."""
    return (given,) * 3 if isinstance(given, int | float) and not isinstance(given, bool) else given


def _number_or_axes(given: Any) -> str:
    """Return which type a gain has that may be stated by axis."""
    return "axes" if isinstance(given, list | tuple) else "number"


def _twice(given: Any) -> Any:
    """Repeat a single number for force and moment."""
    return (given,) * 2 if isinstance(given, int | float) and not isinstance(given, bool) else given


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]

# Bodies ---------------------------------------------------------------------------------------------------------------

_BODY = range_reason("larger bodies are out of scope")
Mass = Annotated[Number, Field(ge=1e-6, le=1e5), range_reason("from a milligram to 100 t")]
MassChange = Annotated[Number, Field(ge=-1e5, le=1e5), range_reason("100 t")]
InertiaEntry = Annotated[Number, Field(ge=-1e9, le=1e9), range_reason("100 t at a distance of 100 m")]
BodyLength = Annotated[Number, Field(ge=-100, le=100), _BODY]
BodyPoint = tuple[BodyLength, BodyLength, BodyLength]
Direction = Annotated[
    Number, Field(ge=-1e6, le=1e6), range_reason("only the direction is used; squares must not overflow")
]
Axis = tuple[Direction, Direction, Direction]
JointAngle = Annotated[
    Number, Field(ge=-63, le=63), range_reason("ten revolutions; larger values are probably in degrees")
]
JointRate = Annotated[Number, Field(ge=1e-6, le=1e6), range_reason("larger limits mean that there is none")]
JointEffort = Annotated[Number, Field(ge=1e-6, le=1e6), range_reason("the weight of 100 t, or its moment at 1 m")]

# Space and motion -----------------------------------------------------------------------------------------------------

_FAR = range_reason("10 km; move the origin closer to the team")
_SOUND = range_reason("the speed of sound")
_SPIN = range_reason("32 revolutions per second")
_TURNS = range_reason("ten revolutions")
Coordinate = Annotated[Number, Field(ge=-1e4, le=1e4), _FAR]
Position = tuple[Coordinate, Coordinate, Coordinate]
Length = Annotated[Number, Field(ge=0, le=1e4), _FAR]
Extents = tuple[Length, Length, Length]
Distance = Annotated[Number, Field(ge=1e-3, le=1e4), _FAR]
PathDeviation = Annotated[Number, Field(ge=1e-6, le=10), range_reason("from a micrometre to 10 m")]
Width = Annotated[Number, Field(ge=0.01, le=1e4), range_reason("from 1 cm to 10 km")]
Speed = Annotated[Number, Field(ge=-340, le=340), _SOUND]
Velocity = tuple[Speed, Speed, Speed]
AngularRate = Annotated[Number, Field(ge=-200, le=200), _SPIN]
BodyRate = tuple[AngularRate, AngularRate, AngularRate]
Gravity = Annotated[Number, Field(ge=-30, le=30), range_reason("25 m/s² on Jupiter")]
Gravities = tuple[Gravity, Gravity, Gravity]
Degrees = Annotated[Number, Field(ge=-3600, le=3600), _TURNS]
Angles = tuple[Degrees, Degrees, Degrees]
RotationComponent = Annotated[
    Number, Field(ge=-180, le=180), range_reason("a rotation vector has at most half a revolution")
]
AngleLimit = Annotated[Number, Field(ge=1, le=180), range_reason("180 deg permits every attitude")]
RotationVector = tuple[RotationComponent, RotationComponent, RotationComponent]
TiltLimit = Annotated[Number, Field(ge=1, le=85), range_reason("multirotors carry no weight near 90 deg")]
AngularDeviation = Annotated[Number, Field(ge=1e-4, le=30), range_reason("from rounding to a loose fit")]
Wavenumber = Annotated[
    Number,
    Field(ge=-63, le=63),
    range_reason("a wavelength of 10 cm, the size of the smallest vehicle"),
]
WaveVector = tuple[Wavenumber, Wavenumber, Wavenumber]

# Time -----------------------------------------------------------------------------------------------------------------

Duration = Annotated[Number, Field(ge=0.1, le=1e5), range_reason("from a few control periods to a day")]
Time = Annotated[Number, Field(ge=0, le=1e5), range_reason("one day")]
Instant = Annotated[Number, Field(ge=-1e5, le=1e5), range_reason("one day")]
TimeOffset = Annotated[Number, Field(ge=-1e11, le=1e11), range_reason("the time since 1970 is 2e9 s")]
TimeScale = Annotated[Number, Field(ge=0.01, le=100), range_reason("a hundred times slower or faster")]
Span = Annotated[Number, Field(ge=1e-3, le=1e5), range_reason("from a millisecond to a day")]
PreviewStep = Annotated[
    Number,
    Field(ge=1e-3, le=0.2),
    range_reason("shorter steps cause rounding errors; longer ones make the interpolation inaccurate"),
]
Period = Annotated[Number, Field(ge=0.1, le=1e5), range_reason("at most 10 Hz; at least once a day")]
Periods = Annotated[tuple[Period, Period, Period], BeforeValidator(_repeat_three_times)]
ControlRate = Annotated[
    Number,
    Field(ge=20, le=1e4),
    range_reason("attitude loops require 20 Hz; flight computers reach 10 kHz"),
]
Rate = Annotated[Number, Field(ge=1e-3, le=1e4), range_reason("from once in 17 minutes to the highest control rate")]
Rates = Annotated[tuple[Rate, Rate], BeforeValidator(_twice)]
Bandwidth = Annotated[
    Number, Field(ge=1e-3, le=1e6), range_reason("from a time constant of minutes to values far above the control rate")
]

BandwidthOrNone = Annotated[Number, Field(ge=0, le=1e4), range_reason("the highest control rate")]

# Forces ---------------------------------------------------------------------------------------------------------------

_HEAVY = range_reason("the weight of 100 t is 1e6 N")
_LEVER = range_reason("the weight of 100 t with a lever of 1 m")
ForceComponent = Annotated[Number, Field(ge=-1e6, le=1e6), _HEAVY]
Force = tuple[ForceComponent, ForceComponent, ForceComponent]
ForceLimit = Annotated[Number, Field(ge=0, le=1e6), _HEAVY]
FrictionCoefficient = Annotated[Number, Field(ge=0.01, le=10), range_reason("from ice to rubber with adhesion")]
Thrust = Annotated[Number, Field(ge=1e-5, le=1e6), range_reason("the weight of a milligram to that of 100 t")]
MomentComponent = Annotated[Number, Field(ge=-1e6, le=1e6), _LEVER]
Moment = tuple[MomentComponent, MomentComponent, MomentComponent]
LeverArm = Annotated[Number, Field(ge=1e-6, le=100), _BODY]
RotorCount = Annotated[
    Count, Field(ge=4, le=64), range_reason("fewer than four rotors cannot control three axes and the thrust")
]
DryFriction = Annotated[Number, Field(ge=0, le=1e6), _LEVER]
Drag = Annotated[Number, Field(ge=0, le=1e4), range_reason("the weight of one tonne at 1 m/s")]
Stiffness = Annotated[Number, Field(ge=1e-6, le=1e6), range_reason("the stiffness of a steel rope of 10 m")]
SmoothingSpeed = Annotated[
    Number,
    Field(ge=1e-6, le=200),
    range_reason("smaller values make friction a step that the integration does not resolve"),
]

# Noise, gains, learning -----------------------------------------------------------------------------------------------

_USELESS = range_reason("larger noise makes a reading useless")
Noise = Annotated[Number, Field(ge=0, le=1e3), _USELESS]
AngularNoise = Annotated[Number, Field(ge=0, le=90), range_reason("larger noise makes a reading useless")]
Gain = Annotated[Number, Field(ge=1e-6, le=1e8), range_reason("unstable at every permitted control rate")]
GainOrNone = Annotated[Number, Field(ge=0, le=1e8), range_reason("unstable at every permitted control rate")]
Gains = Annotated[tuple[Gain, Gain, Gain], BeforeValidator(_repeat_three_times)]
AxisGains = Annotated[
    Annotated[Gain, Tag("number")] | Annotated[tuple[Gain, Gain, Gain], Tag("axes")], Discriminator(_number_or_axes)
]
Deviation = Annotated[Number, Field(ge=1e-9, le=1e6), range_reason("from 1e-9 N to the weight of 100 t")]
Deviations = Annotated[tuple[Deviation, Deviation], BeforeValidator(_twice)]
Lengthscale = Annotated[
    Number, Field(ge=0.1, le=30), range_reason("bounds of the length-scales in the fit (`gp.HyperPrior`)")
]
Norm = Annotated[Number, Field(ge=1e-6, le=1e6), range_reason("larger norms make a bound uninformative")]
Ratio = Annotated[Number, Field(ge=0, le=100), range_reason("100 times the reference quantity")]
Fraction = Annotated[Number, Field(ge=0, le=0.99), range_reason("a share of less than 1")]
Confidence = Annotated[Number, Field(gt=0, lt=1), range_reason("a probability")]
Capacity = Annotated[
    Count, Field(ge=2, le=20_000), range_reason("a fit requires two samples; matrices grow with the square")
]
Substeps = Annotated[Count, Field(ge=1, le=1000), range_reason("more steps make the simulation very slow")]
Seed = Annotated[Count, Field(ge=0, le=2**63 - 1), range_reason("63 bits, the range of the random number generator")]
