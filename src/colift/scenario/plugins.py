"""Parts of one's own, named in a scenario as `module:Name`: a section of settings with a method `build`.

Reading a scenario that names one imports its module, which runs it, as a Python program does.
"""

from __future__ import annotations

import contextlib
import importlib
import sys
import traceback
from collections.abc import Generator
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from colift.scenario import validation
from colift.scenario.errors import format_value, suggestion

PLUGIN_DIRECTORY: ContextVar[Path | None] = ContextVar(
    "PLUGIN_DIRECTORY", default=None
)  # the folder of the scenario that is read


@contextlib.contextmanager
def plugin_path(folder: Path) -> Generator[None]:
    """Within it, modules of parts are looked for in that folder too, after those that are installed."""
    token = PLUGIN_DIRECTORY.set(folder.resolve())
    try:
        yield
    finally:
        PLUGIN_DIRECTORY.reset(token)


def plugin_settings(name: str, given: Any, base: type[BaseModel]) -> BaseModel:
    """The settings of the part that `module:Name` names, validated by it.

    Raises ValidationError: no such module or class, one that is no section with a `build`, or the mistakes in `given`.
    """
    try:
        kind = _kind(name, base)
    except ValueError as error:
        raise validation.as_validation_error([(("class_path",), str(error))], "worded") from None
    try:
        return TypeAdapter(kind).validate_python(given)
    except ValidationError as error:
        wrong = validation.validation_messages(error, kind, given)
        raise validation.as_validation_error([(("settings", *at), said) for at, said in wrong], "worded") from None


def _kind(name: str, base: type[BaseModel]) -> type[BaseModel]:
    module, _, last = name.partition(":")
    folder = PLUGIN_DIRECTORY.get()
    if folder and str(folder) not in sys.path:
        sys.path.append(str(folder))  # for good: the module may import others later
    importlib.invalidate_caches()  # a file may be younger than what Python remembers of its folder
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise ValueError(f"{module} cannot be imported: {_said(error)}") from None
        where = f"in {folder}, nor among those installed" if folder else "on the import path"
        raise ValueError(f"there is no module {format_value(module)} {where}") from None
    except Exception as error:  # whatever a person's module does
        raise ValueError(f"{module} cannot be imported: {_said(error)}") from None
    _same_file(module, found, folder)
    kind = getattr(found, last, None)
    if kind is None:
        raise ValueError(f"{module} has no {format_value(last)}{suggestion(last, vars(found))}")
    if not (isinstance(kind, type) and issubclass(kind, base) and callable(getattr(kind, "build", None))):
        raise ValueError(f"{name} must be a class that extends colift.scenario.Section and has a method `build`")
    return kind


def _same_file(module: str, found: Any, folder: Path | None) -> None:
    """Two modules of one name are two things: refuses the one that is not beside the scenario where one is."""
    here = folder and folder / f"{module.replace('.', '/')}.py"
    there = getattr(found, "__file__", None)
    if here and here.is_file() and (there is None or not here.samefile(there)):
        raise ValueError(
            f"module {format_value(module)} is {there or 'built in'} here, not {here}: give it another name"
        )


def _said(error: Exception) -> str:
    """`file:line: kind: message`."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    name, line = (error.filename, error.lineno) if isinstance(error, SyntaxError) else (last.filename, last.lineno)
    return f"{Path(str(name)).name}:{line}: {type(error).__name__}: {error}"
