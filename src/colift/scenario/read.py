"""From a YAML file to settings, or to every mistake in it at once, each with its line."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

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
    file = given if len(given) <= 200 else f"{given[:200]}..."
    try:
        path = Path(given).expanduser()
        if not given or (path.suffix not in SUFFIXES and not path.exists()):
            raise _unknown(given)
        with path.open("rb") as opened:
            raw = opened.read(tree.MOST_BYTES + 1)
        return parse(raw.decode("utf-8-sig"), file)
    except OSError as error:
        raise ScenarioError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise ScenarioError(f"{file}:{line}: cannot be read: not UTF-8 text (byte {error.start})") from None
    except ScenarioError:
        raise
    except (ValueError, RuntimeError) as error:  # a NUL in the path, the home of nobody
        raise ScenarioError(f"{shown(given)}: cannot be read: {error}") from None


def _unknown(given: str) -> ScenarioError:
    return ScenarioError(
        f"there is no scenario {shown(given)} (shipped: {', '.join(names())}; or the path of a .yaml file)"
        f"{closest(given, names())}"
    )


def parse(text: str, file: str) -> Settings:
    """The settings that a text states; `file` names it in messages. Raises ScenarioError as `load` does."""
    written = tree.read(text, file)
    data, in_urdf = _expanded(written.data, Path(file).parent)
    unread = {place[:2] for place, _ in in_urdf}
    found: dict[Place, list[str | ErrorDetails]] = {}
    for place, sentence in (*written.wrong, *in_urdf):
        found.setdefault(place, []).append(sentence)
    try:
        settings = SETTINGS.validate_python(data)
    except ValidationError as error:
        wrong = [e for e in error.errors(include_url=False) if e["loc"][:2] not in unread]
        _add(found, [(validation.place(data, e["loc"], e["type"]), e) for e in wrong])
        # references are checked by the model only once all sections are valid: check them here as well
        _add(found, [] if unread else mistakes(data))
    else:
        if not found:
            return settings
    raise _told(found, written)


def _add(found: dict[Place, list[str | ErrorDetails]], more: Sequence[tuple[Place, str | ErrorDetails]]) -> None:
    """Adds mistakes where none is told yet: what follows from one is not another."""
    before = set(found)
    for place, said in more:
        if place not in before:
            found.setdefault(place, []).append(said)


def _told(found: dict[Place, list[str | ErrorDetails]], written: tree.Tree) -> ScenarioError:
    """The first mistakes in the order of the file, each once."""
    schema = validation.of(Settings)
    told, count = [], sum(len(said) for said in found.values())
    ahead = sorted(((place, said) for place in found for said in found[place]), key=lambda it: written.line(it[0]))
    for place, said in ahead[: validation.MOST_TOLD]:
        words = said if isinstance(said, str) else validation.sentence(said, schema)
        told.append(f"{written.file}:{written.line(place)}: {validation.where(place, schema)}: {words}")
    return ScenarioError("\n".join([*dict.fromkeys(told), *validation.more(count)]))


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
