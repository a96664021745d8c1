"""Consistency of the settings of contacts: names, limits, and what contacts that bear moments require."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from colift.scenario.errors import ErrorMessage, Location, format_value, unknown_name_message
from colift.scenario.plain_data import items, named, names, number, part


def contacts(data: dict[str, Any]) -> list[str]:
    """`agent/arm` of every contact, in the order of the file."""
    kinds = named(data, "agent_types")
    return [
        f"{name}/{arm}"
        for agent in items(data, "agents")
        if isinstance(name := part(agent, "name"), str)
        for arm in names(items(kinds, str(part(agent, "type")), "arms"))
    ]


def contact_types(data: dict[str, Any]) -> list[Any]:
    """Type of every contact, in the order of `contacts`."""
    kinds = named(data, "agent_types")
    return [
        "point" if (kind := part(arm, "contact")) is None else kind
        for agent in items(data, "agents")
        if isinstance(part(agent, "name"), str)
        for arm in items(kinds, str(part(agent, "type")), "arms")
        if isinstance(part(arm, "name"), str)
    ]


def contact_errors(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Find inconsistent settings of contacts, of their limits and of the allocation.

    Args:
        data: Plain data of a scenario.

    Yields:
        Location and message of each error.
    """
    known = contacts(data)
    leaders = items(data, "allocation", "leader_contacts")
    for i, contact in enumerate(leaders):
        location: Location = ("allocation", "leader_contacts", i)
        if isinstance(contact, str) and contact not in known:
            yield location, unknown_name_message(contact, known, "a contact")
        elif contact in leaders[:i]:
            yield location, f"{format_value(contact)} is named twice"
    yield from _contact_pairs(data, ("allocation", "internal", "squeeze_pairs"), known)
    for section in ("allocation", "physics"):
        yield from _contact_limits(data, (section, "contact"), known)
    yield from _contact_types(data, known)


def _contact_types(data: dict[str, Any], known: list[str]) -> Iterator[ErrorMessage]:
    """Check what contacts that bear moments require: normals, and a plant that has them."""
    normals, types = part(data, "physics", "contact", "normal"), contact_types(data)
    given = normals if isinstance(normals, dict) else {}
    rigid = {name for name, kind in zip(known, types, strict=True) if kind == "rigid"}
    for i, fault in enumerate(items(data, "faults")):
        if part(fault, "kind") == "contact" and part(fault, "who") in rigid and part(fault, "end_s") is not None:
            yield ("faults", i, "end_s"), "is not available for a contact of type rigid, which does not close again"
    soft = [name for name, kind in zip(known, types, strict=True) if kind == "soft_finger"]
    if part(data, "physics", "kind") == "plugin":
        given = dict.fromkeys(soft)  # reported below
    if missing := [name for name in soft if name not in given]:
        yield (
            ("physics", "contact"),
            f"requires `normal` of every contact of type soft_finger; missing: {', '.join(missing)}",
        )
    if part(data, "physics", "contact", "torsional_friction_m") is not None and not soft:
        yield (
            ("physics", "contact", "torsional_friction_m"),
            "requires a contact of type soft_finger (agent_types: arms)",
        )
    if any(kind != "point" for kind in types):
        for location, wrong, required in (
            (
                ("contact_forces", "kind"),
                part(data, "contact_forces", "kind") not in (None, "tip_sensors"),
                "tip_sensors",
            ),
            (("sensors", "payload_imu"), part(data, "sensors", "payload_imu") is False, "true"),
        ):
            if wrong:
                yield location, f"must be {required} with contacts that bear moments (agent_types: arms: contact)"
    plant = part(data, "physics", "kind")
    if plant in ("mujoco", "plugin") and any(kind != "point" for kind in types):
        yield ("physics", "kind"), f"{plant} supports contacts of type point alone; use kind: rigid"


def _contact_pairs(data: dict[str, Any], location: Location, known: list[str]) -> Iterator[ErrorMessage]:
    for i, pair in enumerate(items(data, *location)):
        ends = [pair[k] for k in (0, 1)] if isinstance(pair, list | tuple) and len(pair) > 1 else []
        for k, contact in enumerate(ends):
            if isinstance(contact, str) and contact not in known:
                yield (*location, i, k), unknown_name_message(contact, known, "a contact")
            elif isinstance(contact, str) and k == 1 and contact == ends[0]:
                yield (*location, i, k), "must be another contact than the first of the pair"


def _contact_limits(data: dict[str, Any], location: Location, known: list[str]) -> Iterator[ErrorMessage]:
    limits = part(data, *location)
    normals = part(data, *location, "normal")
    if not isinstance(limits, dict):
        return
    normals = normals if isinstance(normals, dict) else {}
    for name, axis in normals.items():
        if name not in known:
            yield (*location, "normal", name), unknown_name_message(name, known, "a contact")
        elif isinstance(axis, list | tuple) and not any(axis):
            yield (*location, "normal", name), "must not be zero"
    for setting in ("friction", "min_force_N"):
        if limits.get(setting) is not None and (missing := [name for name in known if name not in normals]):
            yield (
                (*location, setting),
                f"requires `contact.normal` of every contact; missing: {', '.join(missing)}",
            )
    least, most = number(data, *location, "min_force_N"), number(data, *location, "max_force_N")
    if least > most:
        yield (*location, "min_force_N"), f"must not exceed max_force_N = {most:g}, got {least:g}"
