"""Base class of all sections, and the types that several sections use.

A section is an immutable model. Units are in the names; vectors are in the world frame unless stated otherwise. The
docstrings and defaults of the settings are the source of the reference page (docs/scenarios.md).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializeAsAny,
    WithJsonSchema,
    model_validator,
)

from colift.scenario import fields, plugins
from colift.scenario.errors import format_value
from colift.scenario.validation import raise_scenario_errors


def _inertia(settings: Any) -> Any:
    """Convert an inertia to three rows from 3 principal moments, 6 entries (xx, yy, zz, xy, xz, yz) or 3 rows."""
    if not isinstance(settings, Sequence) or isinstance(settings, str):
        return settings
    if len(settings) == 6:
        xx, yy, zz, xy, xz, yz = settings
        return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    if len(settings) == 3 and not any(isinstance(row, Sequence) for row in settings):
        return tuple(tuple(value if i == k else 0.0 for k in range(3)) for i, value in enumerate(settings))
    return settings


def _physical(rows: Rows) -> Rows:
    """Require a symmetric, positive definite inertia that satisfies the triangle inequality."""
    J = np.array(rows)
    if not np.allclose(J, J.T, rtol=1e-12, atol=0):
        raise ValueError("must be symmetric")
    a, b, c = np.linalg.eigvalsh(J)
    if a <= 0:
        raise ValueError(f"must be positive definite; its principal moments are {a:.4g}, {b:.4g}, {c:.4g}")
    if c > (a + b) * (1 + 1e-9):
        raise ValueError(
            f"breaks the triangle inequality: the largest of its principal moments {a:.4g}, {b:.4g}, {c:.4g} "
            "exceeds the sum of the others, which is impossible for a rigid body"
        )
    return rows


def _module_and_name(part: str) -> str:
    if not re.fullmatch(PART, part):
        raise ValueError(f"must be `module:Name`, got {format_value(part)}")
    return part


def _even(count: int) -> int:
    if count % 2:
        raise ValueError(f"must be even, because directions of rotation alternate, got {count}")
    return count


def _nonzero(axis: fields.Axis) -> fields.Axis:
    if not any(abs(x) >= 1e-6 for x in axis):
        raise ValueError(f"must not be zero: one entry must be 1e-6 or more, got {list(axis)}")
    return axis


def _ascending(limits: tuple[float, float] | None) -> tuple[float, float] | None:
    if limits is not None and limits[0] > limits[1]:
        raise ValueError(f"must ascend: the smallest position first, got {list(limits)}")
    return limits


NAME = r"^[A-Za-z_][A-Za-z0-9_-]*$"  # pattern of a name
PART = r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*:[A-Za-z_][A-Za-z0-9_]*"  # pattern of `module:Name`
Name = Annotated[str, Field(strict=True, pattern=NAME, max_length=100)]
Row = tuple[fields.InertiaEntry, fields.InertiaEntry, fields.InertiaEntry]  # row of an inertia
Rows = tuple[Row, Row, Row]
Inertia = Annotated[Rows, BeforeValidator(_inertia), AfterValidator(_physical)]
Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


S = TypeVar("S", bound="Section")


class Section(BaseModel):
    """Section of a scenario: an immutable model that rejects unknown settings."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    def __init__(self, **settings: Any) -> None:
        """Validate the settings.

        Args:
            **settings: Settings by name.
        """
        with raise_scenario_errors(type(self)):
            super().__init__(**settings)

    # pydantic then builds the sections inside by itself, and finds all errors in one pass
    __init__.__pydantic_base_init__ = True  # ty: ignore[missing-attribute]

    @classmethod
    def model_validate(cls: type[S], obj: Any, **options: Any) -> S:
        """Validate data; as `pydantic.BaseModel`, but invalid settings raise ScenarioError with one line per error."""
        with raise_scenario_errors(cls):
            return super().model_validate(obj, **options)

    @classmethod
    def model_validate_json(cls: type[S], json_data: str | bytes | bytearray, **options: Any) -> S:
        """Validate JSON; as `pydantic.BaseModel`, but invalid settings raise ScenarioError with one line per error."""
        with raise_scenario_errors(cls):
            return super().model_validate_json(json_data, **options)

    def model_copy(self: S, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> S:
        """Copy with other settings; as `pydantic.BaseModel`, but the updates are validated."""
        return type(self).model_validate({**dict(self), **update}) if update else super().model_copy(deep=deep)


class PluginReference(Section):
    """User-defined part. Loading the scenario imports its module, which executes it (docs/change_a_part.md)."""

    class_path: Annotated[str, Field(strict=True, max_length=200), AfterValidator(_module_and_name)]
    """`module:Name` of a subclass of `colift.scenario.Section` with a method `build`, in a module beside the file."""
    settings: Annotated[SerializeAsAny[Section], WithJsonSchema({"type": "object"}), Field(default_factory=Section)]
    """Settings of the plugin, which its class defines."""

    @model_validator(mode="before")
    @classmethod
    def _with_settings(cls, settings: Any) -> Any:
        """Validate the settings by the class of the plugin."""
        named = settings.get("class_path") if isinstance(settings, Mapping) else None
        if not isinstance(named, str) or not re.fullmatch(PART, named):
            return settings  # the fields report the mistake
        return {**settings, "settings": plugins.plugin_settings(named, settings.get("settings", {}), Section)}


class Plugin(PluginReference):
    """User-defined part, selected by `kind: plugin`. Loading the scenario imports its module, which executes it."""

    kind: Literal["plugin"]
    """Selects a plugin."""
