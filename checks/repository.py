"""Read access to the files of one checkout."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from checks.limits import IGNORED_FOLDERS
from checks.markdown import Page
from checks.python_source import PythonSource


@dataclass(frozen=True, order=True)
class Problem:
    """One violation of a rule.

    Attributes:
        path: File relative to the root, with forward slashes.
        line: Line number from 1.
        rule: Name of the rule.
        message: The violation and its remedy.
    """

    path: str
    line: int
    rule: str
    message: str

    def __str__(self) -> str:
        """Format the problem as `file:line: rule: message`."""
        return f"{self.path}:{self.line}: {self.rule}: {self.message}"


@dataclass
class Repository:
    """The files below one folder; parsed files are kept, so that each is read once.

    Attributes:
        root: Top folder of the checkout.
    """

    root: Path
    _pages: dict[Path, Page] = field(default_factory=dict)
    _sources: dict[Path, PythonSource] = field(default_factory=dict)

    def files(self, folder: str = ".", suffix: str = "") -> list[Path]:
        """List files below a folder in sorted order; ignored folders are left out.

        Args:
            folder: Folder or file relative to the root. A missing one has no files.
            suffix: Ending of the names, as `.py`.

        Returns:
            Absolute paths.
        """
        top = self.root / folder
        if top.is_file():
            return [top] if top.name.endswith(suffix) else []
        return sorted(path for path in _walk(top) if path.name.endswith(suffix))

    def name(self, path: Path) -> str:
        """Return a path relative to the root, with forward slashes."""
        return path.relative_to(self.root).as_posix()

    def page(self, path: Path) -> Page:
        """Return a parsed Markdown page."""
        if path not in self._pages:
            self._pages[path] = Page(path.read_text(encoding="utf-8"))
        return self._pages[path]

    def source(self, path: Path) -> PythonSource:
        """Return a parsed Python file.

        Raises:
            SyntaxError: If the file is not valid Python.
        """
        if path not in self._sources:
            self._sources[path] = PythonSource(path.read_text(encoding="utf-8"), self.name(path))
        return self._sources[path]

    def sources(self, folder: str) -> Iterator[tuple[str, PythonSource]]:
        """Iterate over the Python files below a folder with their relative names."""
        for path in self.files(folder, ".py"):
            yield self.name(path), self.source(path)


def _walk(top: Path) -> Iterator[Path]:
    for folder, folders, names in os.walk(top):
        folders[:] = [name for name in folders if name not in IGNORED_FOLDERS]
        for name in names:
            path = Path(folder) / name
            if not path.is_symlink():
                yield path
