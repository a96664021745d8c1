"""What one section of a scenario says about another: names that must exist, counts and times that must agree.

Works on plain data, valid or not, so that these mistakes are reported together with those within the sections:
where a part is missing or of the wrong kind, what depends on it is left alone.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any

Place = tuple[int | str, ...]
Mistake = tuple[Place, str]

AGENTS_ONLY = ("rotor_bias", "joint_friction")


def mistakes(data: dict[str, Any]) -> list[Mistake]:
    """Every contradiction between the sections of a scenario, as `(place, sentence)`."""
    return [
        *_agent_types(data),
        *_agents(data),
        *_nominal(data),
        *_disturbances(data),
        *_allocation(data),
        *_times(data),
        *_lengthscales(data),
        *_flanks(data),
    ]


def among(name: Any, known: Iterable[str], what: str) -> str:
    """`is not WHAT (a, b); did you mean a?`"""
    known = list(known)
    close = difflib.get_close_matches(str(name), known, n=1, cutoff=0.5)
    listed = ", ".join(known) if known else "there are none"
    return f"{name!r} is not {what} ({listed})" + (f"; did you mean {close[0]!r}?" if close else "")


def _part(data: Any, *place: int | str) -> Any:
    """What is at a place, or None."""
    for key in place:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _items(data: Any, *place: int | str) -> list[Any]:
    found = _part(data, *place)
    return list(found) if isinstance(found, list | tuple) else []


def _named(data: Any, *place: int | str) -> dict[str, Any]:
    found = _part(data, *place)
    return found if isinstance(found, dict) else {}


def _names(items: list[Any]) -> list[str]:
    return [name for item in items if isinstance(name := _part(item, "name"), str)]


def _repeated(items: list[Any], place: Place) -> Iterator[Mistake]:
    seen: set[Any] = set()
    for i, item in enumerate(items):
        name = _part(item, "name")
        if isinstance(name, str) and name in seen:
            yield (*place, i, "name"), f"{name!r} is used twice"
        elif isinstance(name, str):
            seen.add(name)


def bodies(kind: Any) -> list[str]:
    """Names of an agent type's bodies, base first."""
    return ["base", *_names(_items(kind, "joints"))]


def contacts(data: dict[str, Any]) -> list[str]:
    """`agent/arm` of every contact, in the order of the file."""
    kinds = _named(data, "agent_types")
    return [
        f"{name}/{arm}"
        for agent in _items(data, "agents")
        if isinstance(name := _part(agent, "name"), str)
        for arm in _names(_items(kinds, str(_part(agent, "type")), "arms"))
    ]


def _agent_types(data: dict[str, Any]) -> Iterator[Mistake]:
    for key, kind in _named(data, "agent_types").items():
        place: Place = ("agent_types", key)
        joints, arms = _items(kind, "joints"), _items(kind, "arms")
        yield from _repeated(joints, (*place, "joints"))
        yield from _repeated(arms, (*place, "arms"))
        for i, joint in enumerate(joints):
            parent, above = _part(joint, "parent"), ["base", *_names(joints[:i])]
            if _part(joint, "name") == "base":
                yield (*place, "joints", i, "name"), "'base' names the vehicle itself"
            if isinstance(parent, str) and parent not in above:
                yield (*place, "joints", i, "parent"), among(parent, above, "a body listed above this joint")
        for i, arm in enumerate(arms):
            body = _part(arm, "joint")
            if isinstance(body, str) and body not in bodies(kind):
                yield (*place, "arms", i, "joint"), among(body, bodies(kind), "a body of this agent type")


def _agents(data: dict[str, Any]) -> Iterator[Mistake]:
    agents, kinds = _items(data, "agents"), _named(data, "agent_types")
    yield from _repeated(agents, ("agents",))
    for i, agent in enumerate(agents):
        if _part(agent, "name") in ("payload", "agents"):
            yield ("agents", i, "name"), f"{_part(agent, 'name')!r} has a meaning of its own"
        kind = _part(agent, "type")
        if isinstance(kind, str) and kinds and kind not in kinds:
            yield ("agents", i, "type"), among(kind, kinds, "one of agent_types")
        held, arms = _part(agent, "contacts_m"), _part(kinds, str(kind), "arms")
        if isinstance(held, list | tuple) and isinstance(arms, list | tuple) and len(held) != len(arms):
            yield (
                ("agents", i, "contacts_m"),
                f"must hold one contact for each of the {len(arms)} arms of {kind!r}, got {len(held)}",
            )


def _nominal(data: dict[str, Any]) -> Iterator[Mistake]:
    kinds = _named(data, "agent_types")
    for key, believed in _named(data, "nominal", "agent_types").items():
        if kinds and key not in kinds:
            yield ("nominal", "agent_types", key), among(key, kinds, "one of agent_types")
            continue
        joints = bodies(_part(kinds, key))[1:]
        for joint in _named(believed, "joints"):
            if joint not in joints:
                yield ("nominal", "agent_types", key, "joints", joint), among(joint, joints, "a joint of this type")


def _disturbances(data: dict[str, Any]) -> Iterator[Mistake]:
    sources, agents = _items(data, "disturbances"), _items(data, "agents")
    yield from _repeated(sources, ("disturbances",))
    for i, source in enumerate(sources):
        place: Place = ("disturbances", i)
        on, body, kind = _part(source, "acts_on"), _part(source, "body"), _part(source, "kind")
        if not isinstance(on, str):
            continue
        known = ["payload", "agents", *_names(agents)]
        if on not in known:
            yield (*place, "acts_on"), among(on, known, "the payload, all agents or one of them")
        elif on == "payload" and kind in AGENTS_ONLY:
            yield (*place, "acts_on"), f"{kind} acts on agents, not on the payload"
        elif on == "payload":
            if body not in (None, "base"):
                yield (*place, "body"), "must be left out: the payload is one body"
        elif isinstance(body, str):
            for agent in agents:
                here = bodies(_part(data, "agent_types", str(_part(agent, "type"))))
                if on in ("agents", _part(agent, "name")) and body not in here:
                    yield (*place, "body"), among(body, here, f"a body of agent {_part(agent, 'name')!r}")
    yield from _frictions(sources, _names(agents))


def _frictions(sources: list[Any], agents: list[str]) -> Iterator[Mistake]:
    rubbed: dict[str, str] = {}
    for i, source in enumerate(sources):
        if _part(source, "kind") != "joint_friction":
            continue
        for agent in agents:
            if _part(source, "acts_on") in ("agents", agent):
                if agent in rubbed:
                    yield ("disturbances", i, "acts_on"), f"agent {agent!r} has joint friction from {rubbed[agent]!r}"
                    break
                rubbed[agent] = str(_part(source, "name"))


def _allocation(data: dict[str, Any]) -> Iterator[Mistake]:
    known = contacts(data)
    leaders = _items(data, "allocation", "leader_contacts")
    for i, contact in enumerate(leaders):
        place: Place = ("allocation", "leader_contacts", i)
        if isinstance(contact, str) and contact not in known:
            yield place, among(contact, known, "a contact")
        elif contact in leaders[:i]:
            yield place, f"{contact!r} is named twice"
    offset = _part(data, "allocation", "lam_f0_N")
    followers = len(known) - len(leaders)
    if isinstance(offset, list | tuple) and len(offset) != followers:
        yield (
            ("allocation", "lam_f0_N"),
            f"must hold one force for each of the {followers} follower contacts, got {len(offset)}",
        )
    for i, pair in enumerate(_items(data, "allocation", "internal", "pairs")):
        ends = [pair[k] for k in (0, 1)] if isinstance(pair, list | tuple) and len(pair) > 1 else []
        for k, contact in enumerate(ends):
            if isinstance(contact, str) and contact not in known:
                yield ("allocation", "internal", "pairs", i, k), among(contact, known, "a contact")
            elif isinstance(contact, str) and k == 1 and contact == ends[0]:
                yield ("allocation", "internal", "pairs", i, k), "must be another contact than the first of the pair"


def _times(data: dict[str, Any]) -> Iterator[Mistake]:
    duration = _number(data, "duration_s")
    start, end = _number(data, "learning", "start_s"), _number(data, "learning", "end_s")
    if end > duration:
        yield ("learning", "end_s"), f"must not exceed duration_s = {duration:g}, got {end:g}"
    if start >= end:
        yield ("learning", "start_s"), f"must be less than end_s = {end:g}, got {start:g}"
    times = _items(data, "learning", "update_times_s")
    for i, t in enumerate(times):
        if not isinstance(t, int | float):
            continue
        if t > end:
            yield ("learning", "update_times_s", i), f"must not exceed end_s = {end:g}, got {t:g}"
        if t <= start:
            yield ("learning", "update_times_s", i), f"must exceed start_s = {start:g}, or there are no data, got {t:g}"
        if i and isinstance(times[i - 1], int | float) and t <= times[i - 1]:
            yield ("learning", "update_times_s", i), f"must exceed the one before, {times[i - 1]:g}, got {t:g}"


def _lengthscales(data: dict[str, Any]) -> Iterator[Mistake]:
    low, high = (_number(data, "learning", "lengthscale_bounds", k) for k in (0, 1))
    if low >= high:
        yield ("learning", "lengthscale_bounds", 1), f"must exceed the least, {low:g}, got {high:g}"
    for body, name in product(("payload", "agents"), ("lengthscale", "rate_lengthscale")):
        given = _number(data, "learning", body, name)
        if given < low or given > high:
            yield ("learning", body, name), f"must lie within lengthscale_bounds = [{low:g}, {high:g}], got {given:g}"


def _flanks(data: dict[str, Any]) -> Iterator[Mistake]:
    begin, over = _number(data, "allocation", "internal", "start_s"), _number(data, "allocation", "internal", "end_s")
    if 2 * _number(data, "allocation", "internal", "ramp_s") > over - begin:
        yield ("allocation", "internal", "ramp_s"), f"two flanks must fit between start_s and end_s, {over - begin:g} s"


def _number(data: Any, *place: int | str) -> float:
    """The number at a place; NaN, which compares as false with everything, where there is none."""
    found = _part(data, *place)
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else float("nan")
