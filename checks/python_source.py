"""Identifiers, prose and code lines of one Python file."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

from checks.prose import PLACEHOLDER

_ALLOW = re.compile(r"#\s*checks:\s*allow\b[:\s]*(.*)$", re.MULTILINE)
_INLINE_CODE = re.compile(r"``[^`]+``|`[^`\n]+(?:\n[^`\n]+)?`|\$[^$\s][^$\n]*\$")
_HELP_KEYWORDS = frozenset({"description", "epilog", "help", "short_help"})
_LAYOUT = frozenset(
    {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENCODING}
    | {tokenize.ENDMARKER}
)

FunctionNode = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Identifier:
    """A public name.

    Attributes:
        kind: One of `module`, `class`, `function`, `field`, `parameter`, `constant`.
        name: The identifier.
        owner: Qualified name of the enclosing class or function, or an empty string.
        line: Line of its definition.
    """

    kind: str
    name: str
    owner: str
    line: int


@dataclass(frozen=True)
class Text:
    """A docstring, comment or help string.

    Attributes:
        kind: One of `docstring`, `comment`, `help`.
        line: First line.
        last_line: Last line.
        text: Content without quotes or number sign.
    """

    kind: str
    line: int
    last_line: int
    text: str


@dataclass
class PythonSource:
    """A parsed Python file.

    Attributes:
        text: Content of the file.
        name: File name for error messages.
    """

    text: str
    name: str
    tree: ast.Module = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Parse the file."""
        self.tree = ast.parse(self.text, self.name)

    @cached_property
    def _tokens(self) -> list[tokenize.TokenInfo]:
        return list(tokenize.generate_tokens(io.StringIO(self.text).readline))

    @cached_property
    def _nodes(self) -> list[ast.AST]:
        return list(ast.walk(self.tree))

    @cached_property
    def identifiers(self) -> tuple[Identifier, ...]:
        """Public classes, functions, fields, parameters and constants in the order of the file."""
        return tuple(_identifiers(self.tree.body, "", in_class=False))

    @cached_property
    def docstrings(self) -> tuple[Text, ...]:
        """Docstrings of the module, classes, functions and attributes."""
        return tuple(
            Text("docstring", node.lineno, node.end_lineno or node.lineno, node.value.value)
            for node in self._nodes
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        )

    @cached_property
    def comments(self) -> tuple[Text, ...]:
        """Comments; consecutive full-line comments are one text."""
        found: list[Text] = []
        joinable = False
        for token in self._tokens:
            if token.type != tokenize.COMMENT:
                continue
            line, column = token.start
            text = token.string.lstrip("#!:").removeprefix(" ")
            full_line = not token.line[:column].strip()
            if found and full_line and joinable and found[-1].last_line == line - 1:
                found[-1] = Text("comment", found[-1].line, line, f"{found[-1].text}\n{text}")
            else:
                found.append(Text("comment", line, line, text))
            joinable = full_line
        return tuple(found)

    @cached_property
    def help_strings(self) -> tuple[Text, ...]:
        """String values of keyword arguments such as `help` and `description`."""
        return tuple(
            Text("help", part.lineno, part.end_lineno or part.lineno, part.value)
            for node in self._nodes
            if isinstance(node, ast.keyword) and node.arg in _HELP_KEYWORDS
            for part in ast.walk(node.value)
            if isinstance(part, ast.Constant) and isinstance(part.value, str)
        )

    @cached_property
    def code_lines(self) -> frozenset[int]:
        """Numbers of the lines with code: neither blank nor only a comment or docstring."""
        documented = {line for text in self.docstrings for line in range(text.line, text.last_line + 1)}
        return frozenset(
            line
            for token in self._tokens
            if token.type not in _LAYOUT
            for line in range(token.start[0], token.end[0] + 1)
            if not (token.type == tokenize.STRING and line in documented)
        )

    @cached_property
    def functions(self) -> tuple[FunctionNode, ...]:
        """All functions and methods, nested ones included."""
        return tuple(node for node in self._nodes if isinstance(node, FunctionNode))

    @cached_property
    def exceptions(self) -> dict[int, frozenset[str]]:
        """Lines with an exception comment, and the words or rules it allows; none means all.

        A comment behind code holds for its own line, and a comment on its own line also for the line below.
        """
        allowed: dict[int, frozenset[str]] = {}
        if not _ALLOW.search(self.text):
            return allowed
        for token in self._tokens:
            match = _ALLOW.search(token.string) if token.type == tokenize.COMMENT else None
            if match:
                line, column = token.start
                entries = frozenset(word.strip().lower() for word in match[1].split(",") if word.strip())
                allowed[line] = entries
                if not token.line[:column].strip():
                    allowed[line + 1] = entries
        return allowed

    @property
    def exception_count(self) -> int:
        """Number of exception comments."""
        if not _ALLOW.search(self.text):
            return 0
        return sum(bool(token.type == tokenize.COMMENT and _ALLOW.search(token.string)) for token in self._tokens)

    def allows(self, lines: range, *entries: str) -> bool:
        """Return whether an exception comment in some lines covers a rule or word.

        Args:
            lines: Line numbers at which the comment may stand.
            entries: Names under which the exception may be stated, for example the rule and the word.
        """
        names = {entry.lower() for entry in entries}
        return any(
            line in self.exceptions and (not self.exceptions[line] or self.exceptions[line] & names) for line in lines
        )


def prose_of(text: Text) -> str:
    """Return the prose of a docstring, comment or help string; examples and inline code are blanked."""
    lines, in_example = [], False
    for line in text.text.split("\n"):
        in_example = line.lstrip().startswith(">>>") or (in_example and bool(line.strip()))
        lines.append("" if in_example or line.lstrip().startswith("checks: allow") else line)
    return _INLINE_CODE.sub(_blank, "\n".join(lines))


def _blank(match: re.Match[str]) -> str:
    return f" {PLACEHOLDER} " + "\n" * match.group().count("\n")


def _public(name: str) -> bool:
    return not name.startswith("_")


def _identifiers(body: list[ast.stmt], owner: str, in_class: bool) -> Iterator[Identifier]:
    kind = "field" if in_class else "constant"
    for node in body:
        if isinstance(node, ast.ClassDef):
            if _public(node.name):
                name = f"{owner}.{node.name}".lstrip(".")
                yield Identifier("class", node.name, owner, node.lineno)
                yield from _identifiers(node.body, name, in_class=True)
        elif isinstance(node, FunctionNode):
            yield from _function(node, owner, in_class)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                for name in ast.walk(target):
                    if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store) and _public(name.id):
                        yield Identifier(kind, name.id, owner, name.lineno)
        elif isinstance(node, ast.If | ast.Try | ast.With):
            for part in ("body", "orelse", "finalbody"):
                yield from _identifiers(getattr(node, part, []), owner, in_class)


def _function(node: FunctionNode, owner: str, in_class: bool) -> Iterator[Identifier]:
    special = node.name in ("__init__", "__call__")
    if not (_public(node.name) or special):
        return
    name = f"{owner}.{node.name}".lstrip(".")
    if not special:
        yield Identifier("function", node.name, owner, node.lineno)
    arguments = node.args
    for argument in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg):
        if argument is not None and _public(argument.arg) and argument.arg not in ("self", "cls"):
            yield Identifier("parameter", argument.arg, name, argument.lineno)
    if in_class and special:
        for statement in ast.walk(node):
            if (
                isinstance(statement, ast.Attribute)
                and isinstance(statement.ctx, ast.Store)
                and isinstance(statement.value, ast.Name)
                and statement.value.id == "self"
                and _public(statement.attr)
            ):
                yield Identifier("field", statement.attr, owner, statement.lineno)
