"""Specification of a campaign: scenario, cases, varied settings and samples, read from a YAML file."""

from __future__ import annotations

import dataclasses
import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, JsonValue, TypeAdapter, ValidationError

from colift.analysis.study_metrics import STUDY_METRICS
from colift.runtime import bounded_read
from colift.scenario import SUFFIXES, Scenario, ScenarioError, Section, fields, loading, validation, yaml_tree
from colift.scenario.cases import ALL_CASES, PAPER_CASES, case_id
from colift.scenario.errors import format_value, suggestion
from colift.scenario.schema_docs import Schema

MAX_FLIGHTS = 1_000_000
"""Largest number of flights of a campaign."""
METRICS = tuple(metric.key for metric in STUDY_METRICS)
"""Metrics that tables, comparisons and stopping rules use."""
STOPPING_SAMPLES = 32
"""Number of samples after which, and after each multiple of which, the stopping rule is evaluated."""
OWN_SETTINGS = {"seed": "seeds", "duration_s": "duration_s"}
"""Settings of the scenario that have their own key in a specification."""


def _listed(given: Any) -> Any:
    """Return the long form of a list of values; refuse a value that is neither a list nor a distribution."""
    if isinstance(given, list):
        return {"kind": "grid", "values": given}
    if not isinstance(given, Section) and not (isinstance(given, dict) and "kind" in given):
        kinds = "`kind` grid, uniform, log_uniform or normal"
        raise ValueError(f"must be a list of values, or a section with {kinds}, got {format_value(given)}")
    return given


class Grid(Section):
    """Listed values; several grids are combined with each other. A plain list has the same meaning."""

    kind: Literal["grid"]
    """Selects this kind."""
    values: Annotated[tuple[JsonValue, ...], Field(min_length=1, max_length=1000)]
    """Values of the setting."""


class Uniform(Section):
    """Uniform distribution."""

    kind: Literal["uniform"]
    """Selects this kind."""
    low: fields.Number
    """Smallest value."""
    high: fields.Number
    """Largest value."""


class LogUniform(Section):
    """Distribution of a positive number whose logarithm is uniformly distributed."""

    kind: Literal["log_uniform"]
    """Selects this kind."""
    low: Annotated[fields.Number, Field(gt=0)]
    """Smallest value."""
    high: Annotated[fields.Number, Field(gt=0)]
    """Largest value."""


class Normal(Section):
    """Normal distribution."""

    kind: Literal["normal"]
    """Selects this kind."""
    mean: fields.Number
    """Mean."""
    std: Annotated[fields.Number, Field(gt=0)]
    """Standard deviation."""


Distribution = Uniform | LogUniform | Normal
Variation = Annotated[
    Annotated[Grid | Uniform | LogUniform | Normal, Field(discriminator="kind")], BeforeValidator(_listed)
]


class StoppingRule(Section):
    """Condition at which a campaign ends before all samples are simulated."""

    metric: str
    """Metric whose mean is estimated."""
    half_width: Annotated[fields.Number, Field(gt=0)]
    """Half-width of the confidence interval of the mean, in the unit of the metric; every case must reach it."""
    confidence: Annotated[fields.Number, Field(gt=0, lt=1)] = 0.95
    """Confidence of the interval."""


class Campaign(Section):
    """Specification of a campaign."""

    scenario: str
    """Shipped scenario, or path of a YAML file relative to the specification."""
    cases: Annotated[tuple[str, ...], Field(min_length=1, max_length=len(ALL_CASES))] = tuple(PAPER_CASES)
    """Cases; each is simulated with every sample."""
    overrides: Annotated[dict[str, JsonValue], Field(default_factory=dict)]
    """Settings of the scenario that are equal in all flights, by path."""
    vary: Annotated[dict[str, Variation], Field(default_factory=dict)]
    """Varied settings by path."""
    samples: Annotated[fields.Count, Field(ge=1, le=MAX_FLIGHTS)] = 1
    """Number of samples of the distributions, for each combination of the grids."""
    sampling: Literal["sobol", "random", "saltelli"] = "sobol"
    """Quasi-random, random, or the design of Sobol indices, which has `samples` times (d + 2) samples."""
    sampling_seed: fields.Seed = 0
    """Seed of the sampled settings."""
    seeds: Annotated[tuple[fields.Seed, ...], Field(min_length=1, max_length=10_000)] | None = None
    """Seeds with which every sample is simulated; by default each sample has one seed, counted from the scenario's."""
    duration_s: fields.Duration | None = None
    """Duration of the flights; by default that of the scenario."""
    keep: Literal["summary", "signals"] = "summary"
    """`summary` stores one row of metrics per flight; `signals` also stores its log."""
    until: StoppingRule | None = None
    """Rule that ends the campaign early."""


@dataclasses.dataclass(frozen=True)
class LoadedCampaign:
    """Specification with its scenario.

    Attributes:
        name: Name of the specification file without its suffix.
        spec: Specification.
        scenario: Scenario with the overrides.
        file: Path of the scenario file, beside which user-defined parts are searched.
    """

    name: str
    spec: Campaign
    scenario: Scenario
    file: str

    @property
    def settings_json(self) -> str:
        """Settings of the scenario as JSON, from which a worker builds each flight."""
        return json.dumps(_plain(self.scenario), sort_keys=True)


def load_campaign(path: str | Path) -> LoadedCampaign:
    """Load a specification and check every setting path and value against the scenario.

    Args:
        path: YAML file.

    Returns:
        The specification with its scenario.

    Raises:
        ScenarioError: If the file cannot be read or contains errors; one line per error, with file and line.
    """
    path = Path(path)
    try:
        tree = yaml_tree.read(bounded_read.read_text(path, yaml_tree.MAX_BYTES), str(path))
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ScenarioError:
        raise
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    if "schema" in tree.data and "scenario" not in tree.data:
        raise ScenarioError(
            f"{tree.at(('schema',))} this file is a scenario: a specification is another file, with the line "
            f"`scenario: {path.name}`"
        )
    spec = _validated(tree)
    errors = list(_errors(spec, tree))
    if errors:
        raise ScenarioError("\n".join(errors))
    file = spec.scenario
    if Path(file).suffix in SUFFIXES:
        file = str(path.parent / Path(file).expanduser())
    try:
        scenario = loading.load_scenario(file)
    except ScenarioError as error:
        raise ScenarioError(f"{tree.at(('scenario',))} scenario: {error}") from None
    scenario = _overridden(spec, tree, scenario, file)
    plain = _plain(scenario)
    vary = {path: _with_floats(variation, _value_at(plain, path)) for path, variation in spec.vary.items()}
    return LoadedCampaign(path.stem, spec.model_copy(update={"vary": vary}), scenario, file)


def with_settings(scenario: str, file: str, settings: Sequence[tuple[str, JsonValue]]) -> Scenario:
    """Return a scenario with other settings.

    Args:
        scenario: Settings as JSON, as in `LoadedCampaign.settings_json`.
        file: Path of the scenario file.
        settings: Paths and values.

    Returns:
        The validated settings.

    Raises:
        ScenarioError: If a path does not exist or a value is not valid.
    """
    tree = yaml_tree.Tree(file, json.loads(scenario), {}, [])
    for path, value in settings:
        tree = yaml_tree.with_value(tree, path, value)
    return loading.resolve(tree)


def _plain(scenario: Scenario) -> dict[str, Any]:
    """Return the settings of a scenario as plain data."""
    return scenario.model_dump(mode="json", exclude_none=True)


def _validated(tree: yaml_tree.Tree) -> Campaign:
    """Return the specification that a tree contains."""
    schema = validation.schema_of(Campaign)
    messages = list(tree.errors)
    try:
        spec = TypeAdapter(Campaign).validate_python(tree.data)
    except ValidationError as error:
        messages += validation.validation_messages(error, Campaign, tree.data)
    else:
        if not messages:
            return spec
    messages.sort(key=lambda message: tree.line(message[0]))
    lines = [f"{tree.at(location)} {_label(location, schema)}: {text}" for location, text in messages]
    raise ScenarioError("\n".join(dict.fromkeys(lines[: validation.MAX_MESSAGES])))


def _label(location: tuple[int | str, ...], schema: Schema) -> str:
    """Format a location; the path of a varied setting is one key."""
    if location[:1] in (("vary",), ("overrides",)) and len(location) > 1:
        return " ".join([f"{location[0]} {location[1]}", *map(str, location[2:])])
    return validation.location_label(location, schema) if location else "campaign"


def _errors(spec: Campaign, tree: yaml_tree.Tree) -> Iterator[str]:
    """Find errors that do not depend on the scenario."""
    for k, case in enumerate(spec.cases):
        try:
            case_id(case)
        except KeyError:
            allowed = ", ".join(ALL_CASES)
            hint = suggestion(case, ALL_CASES)
            yield f"{tree.at(('cases', k))} cases: must be one of {allowed}, got {format_value(case)}{hint}"
    yield from (f"{tree.at(('cases',))} cases: {text} occurs twice" for text in _repeated(spec.cases))
    for section in ("overrides", "vary"):
        for path in getattr(spec, section):
            if path in OWN_SETTINGS:
                yield f"{tree.at((section, path))} {section} {path}: has its own key `{OWN_SETTINGS[path]}`"
    for path, variation in spec.vary.items():
        at = f"{tree.at(('vary', path))} vary {path}"
        if isinstance(variation, Uniform | LogUniform) and variation.low >= variation.high:
            yield f"{at}: high must exceed low, got {variation.low:g} and {variation.high:g}"
        if isinstance(variation, Grid):
            yield from (f"{at}: {text} occurs twice" for text in _repeated(variation.values))
    yield from (f"{tree.at(('seeds',))} seeds: {text} occurs twice" for text in _repeated(spec.seeds or ()))
    yield from _size_errors(spec, tree)
    drawn = [variation for variation in spec.vary.values() if not isinstance(variation, Grid)]
    if spec.sampling == "saltelli":
        at = f"{tree.at(('sampling',))} sampling:"
        if len(drawn) < len(spec.vary) or not drawn or (spec.seeds is not None and len(spec.seeds) > 1):
            yield f"{at} saltelli requires distributions in `vary`, no grid, and at most one seed"
        if spec.samples & (spec.samples - 1):
            yield f"{at} saltelli requires a power of 2 for `samples`, got {spec.samples}"
    if spec.until is not None and spec.until.metric not in METRICS:
        allowed = ", ".join(METRICS)
        given = spec.until.metric
        hint = suggestion(given, METRICS)
        yield f"{tree.at(('until', 'metric'))} until.metric: must be one of {allowed}, got {format_value(given)}{hint}"


def _repeated(values: Sequence[JsonValue]) -> list[str]:
    """Return the values that occur more than once, as text; 4 and 4.0 are equal."""
    texts = [json.dumps(_with_whole_numbers(value), sort_keys=True) for value in values]
    return [text for text, number in Counter(texts).items() if number > 1]


def _with_whole_numbers(value: JsonValue) -> JsonValue:
    """Return a value with integers in place of whole floating-point numbers, also inside of lists and sections."""
    if isinstance(value, list):
        return [_with_whole_numbers(each) for each in value]
    if isinstance(value, dict):
        return {key: _with_whole_numbers(each) for key, each in value.items()}
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _size_errors(spec: Campaign, tree: yaml_tree.Tree) -> Iterator[str]:
    """Find errors of the number of flights."""
    grids = [len(variation.values) for variation in spec.vary.values() if isinstance(variation, Grid)]
    d = len(spec.vary) - len(grids)
    draws = spec.samples * (d + 2 if spec.sampling == "saltelli" else 1)
    samples = draws * math.prod(grids) * len(spec.seeds or (0,))
    at = f"{tree.at(('samples',))} samples"
    if spec.seeds is not None and not d and spec.samples > 1:
        yield f"{at}: must be 1, because samples with equal `seeds` and no distribution are equal, got {spec.samples}"
    if (flights := samples * len(spec.cases)) > MAX_FLIGHTS:
        yield f"{at}: draws, grids, seeds and cases must be at most {MAX_FLIGHTS} flights, got {format_value(flights)}"
    if spec.until is not None and samples < STOPPING_SAMPLES:
        yield f"{tree.at(('until',))} until: requires at least {STOPPING_SAMPLES} samples, got {samples}"


def _overridden(spec: Campaign, tree: yaml_tree.Tree, scenario: Scenario, file: str) -> Scenario:
    """Return the scenario with the overrides, after a check of all overrides and of the varied settings."""
    errors: list[str] = []
    base, overrides = json.dumps(_plain(scenario)), list(spec.overrides.items())
    try:  # together, because some are valid only with others, in whatever order
        scenario = with_settings(base, file, overrides) if overrides else scenario
    except ScenarioError:
        errors += _override_errors(overrides, tree, base, file)
    else:
        base = json.dumps(_plain(scenario))
        for path, variation in spec.vary.items():
            at = f"{tree.at(('vary', path))} vary"
            found = [
                line for value in _extremes(variation) for line in _setting_errors(base, file, [(path, value)], at)
            ]
            errors += dict.fromkeys(found)
        errors += _late_faults(spec, tree, base, file)
    errors = errors or list(_overlaps(spec, tree, yaml_tree.Tree(file, json.loads(base), {}, [])))
    if errors:
        raise ScenarioError("\n".join(errors[: validation.MAX_MESSAGES]))
    return scenario


def _override_errors(
    overrides: list[tuple[str, JsonValue]], tree: yaml_tree.Tree, base: str, file: str
) -> Iterator[str]:
    """Find the errors of overrides one after another, each with the valid ones before it."""
    applied: list[tuple[str, JsonValue]] = []
    for path, value in overrides:
        found = _setting_errors(base, file, [*applied, (path, value)], f"{tree.at(('overrides', path))} overrides")
        yield from found
        applied += [] if found else [(path, value)]


def _late_faults(spec: Campaign, tree: yaml_tree.Tree, base: str, file: str) -> list[str]:
    """Find faults that would begin after flights of the stated duration."""
    if spec.duration_s is None:
        return []
    found = _setting_errors(base, file, [("duration_s", spec.duration_s)], f"{tree.at(('duration_s',))}")
    return [line for line in found if ": faults" in line]


def _overlaps(spec: Campaign, tree: yaml_tree.Tree, scenario: yaml_tree.Tree) -> Iterator[str]:
    """Find varied settings that replace an override, and those that are the same as, or part of, another one."""
    varied = {path: yaml_tree.location_of(scenario, path) for path in spec.vary}
    overridden = {path: yaml_tree.location_of(scenario, path) for path in spec.overrides}
    for path, location in varied.items():
        at = f"{tree.at(('vary', path))} vary {path}:"
        replaced = [other for other, found in overridden.items() if found[: len(location)] == location]
        yield from (f"{at} replaces {other} in `overrides`" for other in replaced)
        inside = [other for other, found in varied.items() if other != path and location[: len(found)] == found]
        yield from (f"{at} is also varied by {other}" for other in inside)


def _value_at(data: Any, path: str) -> Any:
    """Return the value of a setting; None if the scenario does not state it."""
    for name in path.split("."):
        if isinstance(data, list):
            named = [entry for entry in data if isinstance(entry, dict) and entry.get("name") == name]
            data = named[0] if named else dict(enumerate(data)).get(int(name)) if name.isdecimal() else None
        else:
            data = data.get(name) if isinstance(data, dict) else None
    return data


def _with_floats(variation: Variation, value: Any) -> Variation:
    """Return a grid with its whole numbers as floats if the setting consists of floats, so that it is one structure."""
    stated = value if isinstance(value, list) else [value]
    if not isinstance(variation, Grid) or not stated or not all(isinstance(entry, float) for entry in stated):
        return variation
    floats = (float(entry) if type(entry) is int else entry for entry in variation.values)
    return variation.model_copy(update={"values": tuple(floats)})


def _extremes(variation: Variation) -> tuple[JsonValue, ...]:
    """Return the values of a variation that are checked before a campaign."""
    match variation:
        case Grid():
            return variation.values
        case Normal():
            return (variation.mean,)
        case Uniform() | LogUniform():
            return variation.low, variation.high
    raise TypeError(f"no variation: {type(variation).__name__}")


def _setting_errors(base: str, file: str, settings: list[tuple[str, JsonValue]], at: str) -> list[str]:
    """Return the errors of the last setting, in the words of `--set`."""
    try:
        with_settings(base, file, settings)
    except ScenarioError as error:
        path, value = settings[-1]
        inherited = f"{file}:1: "
        return [
            f"{at} {line.removeprefix('--set ')}"
            if line.startswith("--set ")
            else f"{at} {path}, with {format_value(value)}: {line.removeprefix(inherited)}"
            for line in str(error).splitlines()
        ]
    return []
