"""From a YAML file to settings, or to every mistake in it at once, each with its line."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any, NoReturn

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from colift.scenario import tree, validation
from colift.scenario.from_urdf import AgentTypeFromUrdf, expand
from colift.scenario.mistake import Mistake, Place, ScenarioError, closest, shown
from colift.scenario.references import mistakes
from colift.scenario.settings import Settings

SHIPPED = resources.files("colift") / "scenarios"
SUFFIXES = (".yaml", ".yml")
SETTINGS, FROM_URDF = TypeAdapter(Settings), TypeAdapter(AgentTypeFromUrdf)


def names() -> list[str]:
    """Names of the shipped scenarios."""
    return sorted(Path(file.name).stem for file in SHIPPED.iterdir() if file.name.endswith(SUFFIXES))


def load(name_or_path: str | Path) -> Settings:
    """The settings of a shipped scenario, by name, or of a YAML file, by path.

    Raises ScenarioError: an unknown name, a file that cannot be read, or every mistake in it, one a line, as
    `file:line: path [unit]: what is allowed`.
    """
    given = str(name_or_path)
    if given in names():
        return parse((SHIPPED / f"{given}.yaml").read_text(encoding="utf-8"), f"{given}.yaml")
    try:
        path = Path(given).expanduser()
        if path.suffix not in SUFFIXES and not path.exists():
            _unknown(given)
        with path.open("rb") as file:
            raw = file.read(tree.MOST_BYTES + 1)
    except OSError as error:
        raise ScenarioError(f"{given}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RuntimeError) as error:  # a NUL in the path, or ~ of nobody
        if isinstance(error, ScenarioError):
            raise
        raise ScenarioError(f"{shown(given)}: cannot be read: {error}") from None
    try:
        return parse(raw.decode("utf-8-sig"), given)
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ScenarioError(f"{given}:{line}: cannot be read: not UTF-8 text (byte {error.start})") from None


def _unknown(given: str) -> NoReturn:
    raise ScenarioError(
        f"there is no scenario {shown(given)} (shipped: {', '.join(names())}; or the path of a .yaml file)"
        f"{closest(given, names())}"
    )


def parse(text: str, file: str) -> Settings:
    """The settings that a text states; `file` names it in messages. Raises ScenarioError as `load` does."""
    written = tree.read(text, file)
    data, in_urdf = _expanded(written.data, Path(file).parent)
    unread = {place[:2] for place, _ in in_urdf}
    found: list[tuple[Place, str | ErrorDetails]] = [*written.wrong, *in_urdf]
    try:
        settings = SETTINGS.validate_python(data)
    except ValidationError as error:
        wrong = [e for e in error.errors(include_url=False) if e["loc"][:2] not in unread]
        found += [(validation.place(data, e["loc"], e["type"]), e) for e in wrong]
        # references are checked by the model only once all sections are valid: check them here as well
        found += mistakes(data) if not unread else []
    else:
        if not found:
            return settings
    raise _told(found, written)


def _told(found: list[tuple[Place, str | ErrorDetails]], written: tree.Tree) -> ScenarioError:
    """The first mistakes in the order of the file, each once."""
    schema = validation.of(Settings)
    told = []
    ahead = sorted(found, key=lambda each: written.line(each[0]))
    for place, said in ahead[: validation.MOST_TOLD]:
        words = said if isinstance(said, str) else validation.sentence(said, schema)
        told.append(f"{written.file}:{written.line(place)}: {validation.where(place, schema)}: {words}")
    return ScenarioError("\n".join([*dict.fromkeys(told), *validation.more(len(found))]))


def _expanded(data: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Mistake]]:
    """The data with agent types from URDF in plain numbers, those without mistakes; and the mistakes."""
    kinds, wrong = data.get("agent_types"), []
    if not isinstance(kinds, dict):
        return data, []
    written = dict(kinds)
    for name, kind in kinds.items():
        if not isinstance(kind, dict) or "urdf" not in kind:
            continue
        try:
            written[name], found = expand(FROM_URDF.validate_python(kind), kind, folder)
        except ValidationError as error:
            schema = validation.of(AgentTypeFromUrdf)
            found = [
                (validation.place(kind, e["loc"], e["type"]), validation.sentence(e, schema))
                for e in error.errors(include_url=False)[: validation.MOST_TOLD]
            ]
        wrong += [(("agent_types", name, *place), sentence) for place, sentence in found]
    return data | {"agent_types": written}, wrong
