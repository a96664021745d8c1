"""Files that a result depends on, found from the import statements without importing anything.

The closure of an evidence module contains:

- the evidence module and each project module that it imports, directly or through other modules, with the packages
  around them;
- names that a package serves lazily from a literal ``{name: module}`` table in its ``__init__``;
- data files beside a module whose names the module contains as strings;
- scenario files whose names the evidence module contains as strings;
- source files of the folders in its ``RUNS``, for evidence modules that start other programs;
- lock files: ``requirements/run.txt``, and each other lock that pins a third-party package of the closure.

An evidence module that compares two commits of the history (`HISTORY`) depends on its own module only.

Imports inside functions are not followed, except third-party imports of the evidence module: they select lock files.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import re
import types
from collections.abc import Iterable, Iterator
from pathlib import Path

PACKAGES = {"colift": "src/colift", "evidence": "evidence", "tests": "tests", "benchmarks": "benchmarks"}
TOOLS = ("__init__", "__main__", "dependencies", "restamp", "status", "targets")  # of `evidence`: they change no result
HISTORY = ("renaming",)  # of `evidence`: they run two commits and not the present code
SOURCE = {".py", ".yaml", ".h"}
NAME = set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-")
LOCKS = "requirements"
RUN_LOCK = "run"
DISTRIBUTIONS = {"pinocchio": "pin", "yaml": "pyyaml", "sklearn": "scikit-learn"}  # import name to package name


def closure(module: Path, root: Path) -> set[Path]:
    """Return the project files that an evidence module depends on, see the module's description.

    Args:
        module: File of the evidence module.
        root: The project's folder.
    """
    if module.stem in HISTORY:
        return {module}
    tools = {root / "evidence" / f"{name}.py" for name in TOOLS}
    found: set[Path] = set()
    left = {module}
    while left:
        path = left.pop()
        found.add(path)
        tree = parsed(path)
        found |= _beside(path)
        left |= _imported(tree, path, root) - found - tools
    named = words(module)
    found |= {path for path in (root / PACKAGES["colift"]).rglob("*.yaml") if path.stem in named}
    found |= {path for folder in _runs(parsed(module)) for path in (root / folder).rglob("*") if path.suffix in SOURCE}
    found -= tools
    return found | set(_locks(module, found, root))


@functools.cache
def _tree(path: Path, changed: int, size: int) -> ast.Module:
    del changed, size  # a file that is written again is parsed again
    return ast.parse(path.read_text())


def parsed(path: Path) -> ast.Module:
    """Return the syntax tree of a file, parsed once as long as the file stays the same."""
    stat = path.stat()
    return _tree(path, stat.st_mtime_ns, stat.st_size)


@functools.cache
def _strings(tree: ast.Module) -> frozenset[str]:
    nodes = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
    return frozenset(value for value in nodes if isinstance(value, str) and value and set(value) <= NAME)


def words(path: Path) -> frozenset[str]:
    """Return the strings of a module that may be names of files or scenarios."""
    return _strings(parsed(path))


def _beside(path: Path) -> set[Path]:
    """Return files in a module's folder whose names it contains."""
    return {path.parent / name for name in words(path) & _listing(path.parent)}


def _listing(folder: Path) -> frozenset[str]:
    stat = folder.stat()
    return _files_in(folder, stat.st_mtime_ns)


@functools.cache
def _files_in(folder: Path, changed: int) -> frozenset[str]:
    del changed
    return frozenset(path.name for path in folder.iterdir() if path.is_file())


def _runs(tree: ast.Module) -> tuple[str, ...]:
    """Return the folders in a module's `RUNS`, none if it has no such line."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == ["RUNS"]:
            return ast.literal_eval(node.value)
    return ()


@functools.cache
def _imported(tree: ast.Module, path: Path, root: Path) -> frozenset[Path]:
    """Return files of the modules that a module imports at its top, and of their packages."""
    return frozenset(file for name in _names(tree, _package(path, root)) for file in _files(name, root))


@functools.cache
def _names(tree: ast.Module, package: tuple[str, ...]) -> tuple[str, ...]:
    """Return dotted names of modules or their members that a module imports at its top."""
    names: list[str] = []
    bound: dict[str, str] = {}  # names of whole modules: `import a.b` binds a, `import a.b as c` binds c to a.b
    for node in _top(tree.body):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
            for alias in node.names:
                first = alias.name.partition(".")[0]
                bound[alias.asname or first] = alias.name if alias.asname else first
        elif isinstance(node, ast.ImportFrom):
            base = [*package[: len(package) - node.level + 1]] if node.level else []
            base += node.module.split(".") if node.module else []
            names += [".".join([*base, alias.name]) for alias in node.names] + [".".join(base)]
    bound = {name: module for name, module in bound.items() if module.partition(".")[0] in PACKAGES}
    for node in ast.walk(tree) if bound else ():
        if _is_dotted(node):
            first, _, rest = ast.unparse(node).partition(".")
            names += [f"{bound[first]}.{rest}"] if first in bound else []
    return tuple(dict.fromkeys(names))


def _is_dotted(node: ast.AST) -> bool:
    """Return whether a node is `a.b` or `a.b.c` with names only."""
    if not isinstance(node, ast.Attribute):
        return False
    while isinstance(node, ast.Attribute):
        node = node.value
    return isinstance(node, ast.Name)


def _top(body: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """Yield statements that run on import, without those for type checkers only."""
    for node in body:
        if isinstance(node, ast.If):
            if "TYPE_CHECKING" not in ast.unparse(node.test):
                yield from _top(node.body)
            yield from _top(node.orelse)
        elif isinstance(node, ast.Try):
            yield from _top([*node.body, *(line for handler in node.handlers for line in handler.body), *node.orelse])
        else:
            yield node


def _package(path: Path, root: Path) -> tuple[str, ...]:
    """Return the parts of the name of the package that contains a module."""
    for name, folder in PACKAGES.items():
        if path.is_relative_to(root / folder):
            return (name, *path.parent.relative_to(root / folder).parts)
    return ()


def _files(name: str, root: Path) -> Iterator[Path]:
    """Yield files of a dotted name: its packages, the module, and a module from which a package serves the name."""
    parts = name.split(".")
    if parts[0] not in PACKAGES:
        return
    package = None
    for n in range(1, len(parts) + 1):
        file = _file(parts[:n], root)
        if file is None:
            served = _lazy(parsed(package)).get(parts[n - 1]) if package is not None else None
            if served is not None:
                inner = served.lstrip(".")
                full = inner if inner.split(".")[0] in PACKAGES else ".".join([*parts[: n - 1], inner])
                yield from _files(full, root)
            return
        yield file
        package = file if file.name == "__init__.py" else None


def _file(parts: list[str], root: Path) -> Path | None:
    at = root.joinpath(PACKAGES[parts[0]], *parts[1:])
    return next(filter(Path.is_file, (at / "__init__.py", at.with_suffix(".py"))), None)


@functools.cache
def _lazy(tree: ast.Module) -> dict[str, str]:
    """Return names of a package's `__init__` and their modules: all of its tables of strings by strings.

    Values that are not modules yield no file, so other tables have no effect. A pair `(module, name)` counts as its
    module.
    """
    found: dict[str, str] = {}
    for node in tree.body:
        value = getattr(node, "value", None)
        if not isinstance(node, ast.Assign | ast.AnnAssign) or not isinstance(value, ast.Dict):
            continue
        for key, one in zip(value.keys, value.values, strict=True):
            first = one.elts[0] if isinstance(one, ast.Tuple) and one.elts else one
            if isinstance(key, ast.Constant) and isinstance(first, ast.Constant) and isinstance(first.value, str):
                found[str(key.value)] = first.value
    return found


def _locks(module: Path, files: set[Path], root: Path) -> Iterator[Path]:
    """Return lock files behind an evidence module: the runtime lock, and locks of other packages that its files
    import.
    """
    run = root / LOCKS / f"{RUN_LOCK}.txt"
    if not run.is_file():
        return
    yield run
    have = pins(run.read_text())
    python = [path for path in files if path.suffix == ".py"]
    foreign = {name for path in python for name in _foreign(parsed(path), path == module)}
    requested = {_normal(DISTRIBUTIONS.get(name, name)) for name in foreign}
    for lock in sorted((root / LOCKS).glob("*.txt")):
        if lock != run and requested & (pins(lock.read_text()).keys() - have.keys()):
            yield lock


@functools.cache
def _foreign(tree: ast.Module, within: bool) -> frozenset[str]:
    """Return the first parts of names that a module imports from elsewhere, at its top or within functions."""
    names: set[str] = set()
    for node in ast.walk(tree) if within else _top(tree.body):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return frozenset(names - PACKAGES.keys())


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


@functools.cache
def pins(text: str) -> dict[str, str]:
    """Return the versions that a lock file pins, by package; hashes, comments and order do not matter."""
    lines = (re.split(r"--hash|\\|#", line)[0].strip() for line in text.splitlines())
    found = (re.match(r"([A-Za-z0-9._-]+)(?:\[[^]]*\])?==([^\s;]+)\s*(.*)$", line) for line in lines)
    return {_normal(one[1]): f"{one[2]} {one[3]}".strip() for one in found if one}


def digest(content: bytes) -> str:
    """Return git's digest of a file's content: `git hash-object`."""
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


@functools.cache
def meaning(text: str, suffix: str) -> str:
    """Return a digest of the part of a file's text that affects a result.

    Of a Python file its compiled code without docstrings, comments and layout; of a lock file its pins; of other files
    everything.
    """
    if suffix == ".py":
        tree = ast.parse(text)
        _strip(tree)
        text = repr(_code(compile(tree, "", "exec", dont_inherit=True)))
    elif suffix == ".txt":
        text = repr(sorted(pins(text).items()))
    return digest(text.encode())


def _strip(node: ast.AST) -> None:
    """Remove statements that are only a constant, such as docstrings."""
    for name in ("body", "orelse", "finalbody", "handlers", "cases"):
        inner = getattr(node, name, None)
        if not isinstance(inner, list):
            continue
        kept = [one for one in inner if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))]
        if inner and not kept and not isinstance(node, ast.Module):
            kept = [ast.copy_location(ast.Pass(), inner[0])]
        setattr(node, name, kept)
        for one in kept:
            _strip(one)


def _code(code: types.CodeType) -> list[object]:
    """Return all of a code object except its line numbers, including nested code objects."""
    own = [getattr(code, name) for name in dir(code) if name.startswith("co_") and name not in LINES]
    return [*own, [_code(one) if isinstance(one, types.CodeType) else repr(one) for one in code.co_consts]]


LINES = {"co_lines", "co_linetable", "co_lnotab", "co_positions", "co_branches"}
LINES |= {"co_firstlineno", "co_filename", "co_consts"}
