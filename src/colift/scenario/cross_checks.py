"""Consistency between the sections of a scenario: names, counts and times.

The checks accept plain data, valid or not, so that their errors are reported together with those within sections. A
check is omitted if its data are missing or of a wrong kind.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

from colift.scenario.contact_checks import contact_errors, contacts
from colift.scenario.errors import ErrorMessage, Location, format_value, unknown_name_message
from colift.scenario.plain_data import MAX_ENTRIES, items, named, names, number, part

LOG_BYTES, MODEL_BYTES = 2e9, 1e9  # a run stores its log three times at its end
MAX_WAVELENGTH = 1e4  # m
MIN_WAYPOINT_INTERVAL = 0.01  # s between two poses

AGENT_ONLY_KINDS = ("rotor_bias", "joint_friction")


def consistency_errors(data: dict[str, Any]) -> list[ErrorMessage]:
    """Return all inconsistencies between the sections of a scenario, as `(location, message)`."""
    return [
        *_agent_types(data),
        *_agents(data),
        *_nominal(data),
        *_disturbances(data),
        *contact_errors(data),
        *_times(data),
        *_rates(data),
        *_ramps(data),
        *_waves(data),
        *_required_memory(data),
        *_limits(data),
        *_poses(data),
        *_delays(data),
        *_payload_sensors(data),
        *_mass_steps(data),
        *_faults(data),
        *_calibration(data),
    ]


def _repeated(items: list[Any], location: Location) -> Iterator[ErrorMessage]:
    known_names: set[Any] = set()
    for i, item in enumerate(items):
        name = part(item, "name")
        if isinstance(name, str) and name in known_names:
            yield (*location, i, "name"), f"{format_value(name)} is used twice"
        elif isinstance(name, str):
            known_names.add(name)


def bodies(kind: Any) -> list[str]:
    """Names of an agent type's bodies, base first."""
    return ["base", *names(items(kind, "joints"))]


def _agent_types(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    for key, kind in named(data, "agent_types").items():
        location: Location = ("agent_types", key)
        joints, arms = items(kind, "joints"), items(kind, "arms")
        yield from _repeated(joints, (*location, "joints"))
        yield from _repeated(arms, (*location, "arms"))
        for i, joint in enumerate(joints):
            parent, above = part(joint, "parent"), ["base", *names(joints[:i])]
            if part(joint, "name") == "base":
                yield (*location, "joints", i, "name"), "'base' names the vehicle itself"
            if isinstance(parent, str) and parent not in above:
                yield (
                    (*location, "joints", i, "parent"),
                    unknown_name_message(parent, above, "a body listed above this joint"),
                )
        for i, arm in enumerate(arms):
            body = part(arm, "joint")
            if isinstance(body, str) and body not in bodies(kind):
                yield (
                    (*location, "arms", i, "joint"),
                    unknown_name_message(body, bodies(kind), "a body of this agent type"),
                )


def _agents(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    agents, kinds = items(data, "agents"), named(data, "agent_types")
    yield from _repeated(agents, ("agents",))
    for i, agent in enumerate(agents):
        if part(agent, "name") in ("payload", "agents"):
            yield ("agents", i, "name"), f"{part(agent, 'name')!r} is a reserved name: must be another name"
        kind = part(agent, "type")
        if isinstance(kind, str) and kinds and kind not in kinds:
            yield ("agents", i, "type"), unknown_name_message(kind, kinds, "one of agent_types")
        held, arms = part(agent, "contact_positions_m"), part(kinds, str(kind), "arms")
        if isinstance(held, list | tuple) and isinstance(arms, list | tuple) and len(held) != len(arms):
            yield (
                ("agents", i, "contact_positions_m"),
                f"must hold one contact for each of the {len(arms)} arms of {format_value(kind)}, got {len(held)}",
            )


def _nominal(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    kinds = named(data, "agent_types")
    for key, nominal in named(data, "nominal", "agent_types").items():
        if kinds and key not in kinds:
            yield ("nominal", "agent_types", key), unknown_name_message(key, kinds, "one of agent_types")
            continue
        joints = bodies(part(kinds, key))[1:]
        for joint in named(nominal, "joints"):
            if joint not in joints:
                yield (
                    ("nominal", "agent_types", key, "joints", joint),
                    unknown_name_message(joint, joints, "a joint of this type"),
                )


def _disturbances(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    sources, agents = items(data, "disturbances"), items(data, "agents")
    yield from _repeated(sources, ("disturbances",))
    for i, source in enumerate(sources):
        location: Location = ("disturbances", i)
        on, body, kind = part(source, "acts_on"), part(source, "body"), part(source, "kind")
        if not isinstance(on, str):
            continue
        known = ["payload", "agents", *names(agents)]
        if on not in known:
            yield (*location, "acts_on"), unknown_name_message(on, known, "the payload, all agents or one of them")
        elif on == "payload" and kind in AGENT_ONLY_KINDS:
            yield (*location, "acts_on"), f"{kind} acts on agents, not on the payload"
        elif on == "payload":
            if body not in (None, "base"):
                yield (*location, "body"), "must be omitted: the payload is one body"
        elif isinstance(body, str):
            for agent in agents:
                body_names = bodies(part(data, "agent_types", str(part(agent, "type"))))
                if on in ("agents", part(agent, "name")) and body not in body_names:
                    yield (
                        (*location, "body"),
                        unknown_name_message(body, body_names, f"a body of agent {format_value(part(agent, 'name'))}"),
                    )
    yield from _frictions(sources, names(agents))


def _frictions(sources: list[Any], agents: list[str]) -> Iterator[ErrorMessage]:
    friction_sources: dict[str, str] = {}
    for i, source in enumerate(sources):
        if part(source, "kind") != "joint_friction":
            continue
        for agent in agents:
            if part(source, "acts_on") in ("agents", agent):
                if agent in friction_sources:
                    yield (
                        ("disturbances", i, "acts_on"),
                        f"agent {format_value(agent)} has joint friction from {format_value(friction_sources[agent])}",
                    )
                    break
                friction_sources[agent] = str(part(source, "name"))


UPDATE_TIMES_PATH = ("learning", "update_times_s")  # location in the data


def _times(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    duration = number(data, "duration_s")
    start, end = number(data, "learning", "start_s"), number(data, "learning", "end_s")
    if end > duration:
        yield ("learning", "end_s"), f"must not exceed duration_s = {duration:g}, got {end:g}"
    if start >= end:
        yield ("learning", "start_s"), f"must be less than end_s = {end:g}, got {start:g}"
    sample = number(data, "learning", "sample_Hz")
    times = [number(data, "learning", "update_times_s", i) for i in range(len(items(data, *UPDATE_TIMES_PATH)))]
    for i, (before, t) in enumerate(itertools.pairwise([start, *times])):
        if t > end:
            yield (*UPDATE_TIMES_PATH, i), f"must not exceed end_s = {end:g}, got {t:g}"
        if t <= before:
            first = f"start_s = {start:g}, or there are no data"
            yield (*UPDATE_TIMES_PATH, i), f"must exceed {f'the one before, {before:g}' if i else first}, got {t:g}"
        elif (t - before) * sample < 1 - 1e-9:
            since = "the one before" if i else "start_s"
            yield (
                (*UPDATE_TIMES_PATH, i),
                f"must be a period of sample_Hz = {sample:g} after {since}, {before:g}, got {t:g}",
            )


def _rates(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Nothing is recorded between ticks, and no filter of the second order turns faster than every other tick."""
    control = number(data, "control_Hz")
    sample = number(data, "learning", "sample_Hz")
    if sample > control:
        yield ("learning", "sample_Hz"), f"must not exceed control_Hz = {control:g}, got {sample:g}"
    for location in (("learning", "label_filter_Hz"), ("control", "joint_filter_Hz")):
        corner = number(data, *location)
        if corner > control / 2:
            yield location, f"must not exceed half of control_Hz, {control / 2:g}, got {corner:g}"
    duration, ramp = number(data, "duration_s"), number(data, "reference", "ramp_time_s")
    if named(data, "random_residual") and part(data, "reference", "kind") == "plugin":
        yield (
            ("random_residual",),
            "must be omitted with a user-defined reference: its centers lie along a built-in one",
        )
    if named(data, "random_residual") and ramp >= duration:
        yield (
            ("reference", "ramp_time_s"),
            f"must be less than duration_s = {duration:g}: the centers of `random_residual` lie "
            f"after the ramp, got {ramp:g}",
        )


def _ramps(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    start, over = number(data, "allocation", "internal", "start_s"), number(data, "allocation", "internal", "end_s")
    if 2 * number(data, "allocation", "internal", "ramp_time_s") > over - start:
        yield (
            ("allocation", "internal", "ramp_time_s"),
            f"two ramps must fit between start_s and end_s, {over - start:g} s",
        )


def _waves(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Check that wavelengths exceed the size of the payload, and are shorter than `MAX_WAVELENGTH`."""
    size = _size(data)
    for i, source in enumerate(items(data, "disturbances")):
        for k in range(len(items(source, "gusts"))):
            wave = [number(source, "gusts", k, "wave_vector_radpm", axis) for axis in range(3)]
            k_abs = math.hypot(*wave)  # NaN where it is not a vector
            location: Location = ("disturbances", i, "gusts", k, "wave_vector_radpm")
            if k_abs * MAX_WAVELENGTH < 2 * math.pi:
                yield (
                    location,
                    f"has a wavelength above {MAX_WAVELENGTH / 1e3:g} km, which is a mean wind: use mean_wind_mps",
                )
            elif part(source, "acts_on") == "payload" and k_abs * size > 2 * math.pi:
                length = f"{2 * math.pi / k_abs:.3g} m"
                yield (
                    location,
                    f"has a wavelength of {length}, less than the {size:.3g} m between the payload's contacts",
                )


def _size(data: dict[str, Any]) -> float:
    """Compute the largest distance between two contacts [m]; 0 without contacts."""
    locations = [
        ("agents", i, "contact_positions_m", k)
        for i, agent in enumerate(items(data, "agents"))
        for k in range(len(items(agent, "contact_positions_m")))
    ]
    held = [[number(data, *location, axis) for axis in range(3)] for location in locations[:MAX_ENTRIES]]
    return max((math.dist(a, b) for a, b in itertools.combinations(held, 2) if math.isfinite(sum(a + b))), default=0.0)


def _required_memory(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Check the memory of the log (duration times rate) and of the models (square of their samples)."""
    duration, rate = number(data, "duration_s"), number(data, "control_Hz")
    log = 8 * duration * rate * log_size(data)
    if log > LOG_BYTES:
        most = f"{LOG_BYTES / 1e9:g} GB are allowed, {LOG_BYTES / log * duration:.4g} s"
        yield ("duration_s",), f"the log of this team at {rate:g} Hz would take {log / 1e9:.3g} GB; {most}"
    outputs = model_outputs(data)
    models = 8 * outputs * number(data, "learning", "max_samples") ** 2
    if models > MODEL_BYTES:
        most = f"{MODEL_BYTES / 1e9:g} GB are allowed, {math.isqrt(int(MODEL_BYTES / 8 / outputs))} points"
        words = f"the {outputs} outputs of the models would take {models / 1e9:.3g} GB; {most}"
        yield ("learning", "max_samples"), words


def log_size(data: dict[str, Any]) -> int:
    """Return an upper bound of the number of values per tick in the log."""
    return 120 + 54 * len(items(data, "agents")) + 6 * _joints(data) + 20 * len(contacts(data))


def model_outputs(data: dict[str, Any]) -> int:
    """Count the outputs of all models: six for the payload and for each agent, one for each joint."""
    return 6 * (1 + len(items(data, "agents"))) + _joints(data)


def _joints(data: dict[str, Any]) -> int:
    kinds = named(data, "agent_types")
    return sum(len(items(kinds, str(part(agent, "type")), "joints")) for agent in items(data, "agents"))


def _poses(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Check that the times of poses ascend with the smallest interval."""
    times = [number(data, "reference", "poses", i, "time_s") for i in range(len(items(data, "reference", "poses")))]
    for i, (previous, current) in enumerate(itertools.pairwise(times), start=1):
        if current < previous + MIN_WAYPOINT_INTERVAL:
            yield (
                ("reference", "poses", i, "time_s"),
                f"must be {MIN_WAYPOINT_INTERVAL:g} s or more after the pose before, {previous:g}, got {current:g}",
            )


def _delays(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Check that delays are multiples of the control period, and that sensor rates do not exceed the control rate."""
    rate = number(data, "control_Hz")
    readings = [("sensors", "models", i) for i in range(len(items(data, "sensors", "models")))]
    links = [("faults", i) for i in range(len(items(data, "faults")))]
    for location in (("actuators",), ("nominal", "actuators"), *readings, *links):
        delay, sample_rate = number(data, *location, "delay_s"), number(data, *location, "rate_Hz")
        ticks = delay * rate
        if ticks > MAX_ENTRIES:
            yield (*location, "delay_s"), f"must be at most {MAX_ENTRIES} ticks of {1 / rate:g} s, got {delay:g}"
        elif abs(ticks - round(ticks if math.isfinite(ticks) else 0)) > 1e-6:
            near = [f"{k / rate:g}" for k in (math.floor(ticks), math.ceil(ticks))]
            yield (*location, "delay_s"), f"must be whole ticks of {1 / rate:g} s: {' or '.join(near)}, got {delay:g}"
        if sample_rate > rate:
            yield (*location, "rate_Hz"), f"must not exceed control_Hz = {rate:g}, got {sample_rate:g}"


def _payload_sensors(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Check that nothing requires a gyroscope or accelerometer that the payload does not have."""
    if part(data, "sensors", "payload_imu") is not False:
        return
    if part(data, "contact_forces", "kind") == "least_squares":
        yield (
            ("contact_forces", "kind"),
            "least_squares requires gyroscope and accelerometer of the payload: with sensors.payload_imu: false "
            "its motion is estimated from the same contact forces; use momentum_observer",
        )
    readings: list[tuple[Location, str]] = [
        (("sensors", "models", i, "channels"), str(name))
        for i, model in enumerate(items(data, "sensors", "models"))
        for name in items(model, "channels")
    ]
    readings += [
        (("faults", i, "reading"), f"{part(fault, 'who')}.{part(fault, 'reading')}")
        for i, fault in enumerate(items(data, "faults"))
    ]
    for location, name in readings:
        if name in ("payload.omega", "payload.a"):
            yield location, f"{name} does not exist: the payload has no such sensor (sensors.payload_imu: false)"


def _mass_steps(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Check that the mass stays positive after a mass step, and that the physics supports the step."""
    added, mass = number(data, "payload_mass_step", "mass_kg"), number(data, "payload", "mass_kg")
    if mass + added <= 0:
        yield ("payload_mass_step", "mass_kg"), f"must leave some of payload.mass_kg = {mass:g}, got {added:g}"
    if not math.isnan(added) and part(data, "physics", "kind") == "mujoco":
        yield ("payload_mass_step",), "physics mujoco does not support it; use kind: rigid"


def _calibration(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Check that a calibration flight records samples for its models and for their errors."""
    duration, start = number(data, "contact_forces", "calibration_s"), number(data, "learning", "start_s")
    if 0 < duration < start + 2:
        yield (
            ("contact_forces", "calibration_s"),
            f"must be 0, or at least 2 s after learning.start_s: {start + 2:g}, got {duration:g}",
        )


PAYLOAD_READINGS, AGENT_READINGS = ("p", "R", "v", "omega", "a"), ("x", "R", "v", "omega", "a", "r", "lam")


def _rotors(data: dict[str, Any]) -> int:
    """Return the number of rotors of every vehicle; 0 for actuators without rotors, or with a number out of range."""
    count = part(data, "actuators", "rotors", "num_rotors")
    return count if isinstance(count, int) and count <= MAX_ENTRIES else 0


def _faults(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Check the names and times of faults, and that the physics supports contacts that open."""
    agents, duration, released = names(items(data, "agents")), number(data, "duration_s"), set[str]()
    for i, fault in enumerate(items(data, "faults")):
        location: Location = ("faults", i)
        kind, who = part(fault, "kind"), part(fault, "who")
        known, expected = {
            "thrust": (agents, "an agent"),
            "link": (agents, "an agent"),
            "rotor": ([f"{agent}/{k}" for agent in agents for k in range(_rotors(data))], "a rotor of an agent"),
            "sensor": (["payload", *agents], "the payload or an agent"),
            "contact": (contacts(data), "a contact"),
        }.get(str(kind), ([], ""))
        start, end = number(fault, "start_s"), number(fault, "end_s")
        if isinstance(who, str) and known and who not in known:
            yield (*location, "who"), unknown_name_message(who, known, expected)
        elif kind == "sensor":
            readings, reading = PAYLOAD_READINGS if who == "payload" else AGENT_READINGS, part(fault, "reading")
            if isinstance(reading, str) and reading not in readings:
                yield (*location, "reading"), unknown_name_message(reading, readings, f"a reading of {who}")
        elif kind == "contact" and who in released:
            yield (*location, "who"), f"{format_value(who)} is named twice"
        elif kind == "rotor" and not _rotors(data):
            yield (*location, "kind"), "requires actuators.rotors"
        if kind == "contact":
            released.add(str(who))
            if part(data, "physics", "kind") == "mujoco":
                yield (*location, "kind"), "physics mujoco does not support it; use kind: rigid"
        if start >= duration:
            yield (*location, "start_s"), f"must be less than duration_s = {duration:g}, got {start:g}"
        if end <= start:
            yield (*location, "end_s"), f"must exceed start_s = {start:g}, got {end:g}"


def _limits(data: dict[str, Any]) -> Iterator[ErrorMessage]:
    """Check that the initial errors are within the termination limits."""
    for start, limit, unit in (
        ("position_error_m", "max_position_error_m", "m"),
        ("attitude_error_deg", "max_attitude_error_deg", "deg"),
    ):
        size = math.hypot(*(number(data, "initial_state", start, i) for i in range(3)))
        if size > (most := number(data, "termination", limit)):
            yield (
                ("initial_state", start),
                f"is {size:.4g} {unit} from the reference, beyond termination.{limit} = {most:g}",
            )
