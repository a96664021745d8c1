"""User-defined parts, named in a scenario as `module:Name`: a section of settings with a method `build`.

Loading a scenario with such a part imports its module and thereby executes it.
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
)  # folder of the scenario that is loaded
_REFUSED: ContextVar[bool] = ContextVar("_REFUSED", default=False)  # whether no module may be imported


@contextlib.contextmanager
def plugin_path(folder: Path) -> Generator[None]:
    """Search modules of parts also in a folder, after the installed modules, within the context."""
    token = PLUGIN_DIRECTORY.set(folder.resolve())
    try:
        yield
    finally:
        PLUGIN_DIRECTORY.reset(token)


@contextlib.contextmanager
def refuse_imports() -> Generator[None]:
    """Refuse user-defined parts within the context, for scenarios that can be of untrusted origin."""
    token = _REFUSED.set(True)
    try:
        yield
    finally:
        _REFUSED.reset(token)


def plugin_settings(name: str, settings: Any, base: type[BaseModel]) -> BaseModel:
    """Validate the settings of a user-defined part.

    Args:
        name: Class of the part, as `module:Name`.
        settings: Settings of the part.
        base: Required base class.

    Returns:
        Instance of the class.

    Raises:
        ValidationError: If there is no such module or class, if the class is not a section with a method `build`, if
            the settings contain errors, or within `refuse_imports`.
    """
    try:
        kind = _kind(name, base)
    except ValueError as error:
        raise validation.as_validation_error([(("class_path",), str(error))], "worded") from None
    try:
        return TypeAdapter(kind).validate_python(settings)
    except ValidationError as error:
        messages = validation.validation_messages(error, kind, settings)
        raise validation.as_validation_error(
            [(("settings", *at), message) for at, message in messages], "worded"
        ) from None


def _kind(name: str, base: type[BaseModel]) -> type[BaseModel]:
    """Return the class of a part; raise ValueError if it cannot be used."""
    module, _, last = name.partition(":")
    if _REFUSED.get():
        raise ValueError(f"{module} is not imported, because a log names it")
    folder = PLUGIN_DIRECTORY.get()
    if folder and str(folder) not in sys.path:
        sys.path.append(str(folder))  # not removed: the module may import others later
    importlib.invalidate_caches()  # a file may be newer than the cached listing of its folder
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise ValueError(f"{module} cannot be imported: {_exception_message(error)}") from None
        searched = f"in {folder}, nor among those installed" if folder else "on the import path"
        raise ValueError(f"there is no module {format_value(module)} {searched}") from None
    except Exception as error:  # a user-defined module may raise any exception
        raise ValueError(f"{module} cannot be imported: {_exception_message(error)}") from None
    _same_file(module, found, folder)
    kind = getattr(found, last, None)
    if kind is None:
        raise ValueError(f"{module} has no {format_value(last)}{suggestion(last, vars(found))}")
    if not (isinstance(kind, type) and issubclass(kind, base) and callable(getattr(kind, "build", None))):
        raise ValueError(f"{name} must be a class that extends colift.scenario.Section and has a method `build`")
    return kind


def _same_file(module: str, found: Any, folder: Path | None) -> None:
    """Reject an imported module if the scenario's folder contains another one of that name."""
    expected = folder and folder / f"{module.replace('.', '/')}.py"
    imported = getattr(found, "__file__", None)
    if expected and expected.is_file() and (imported is None or not expected.samefile(imported)):
        raise ValueError(
            f"module {format_value(module)} is {imported or 'built in'} here, not {expected}: give it another name"
        )


def _exception_message(error: Exception) -> str:
    """Format an exception as `file:line: kind: message`."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    name, line = (error.filename, error.lineno) if isinstance(error, SyntaxError) else (last.filename, last.lineno)
    return f"{Path(str(name)).name}:{line}: {type(error).__name__}: {error}"
