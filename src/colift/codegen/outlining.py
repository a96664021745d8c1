"""Outlining: split long C functions into parts, because compile time grows faster than linearly with length.

Statements keep their order. A cut is placed where the fewest values are live; those values are stored in the frame, an
array that all parts share.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

MAX_PART_LINES = 1000  # of one part of a function
MAX_PIECE_LINES = 8000  # of one piece of the source, the unit of parallel compilation
PART_PATTERN = re.compile(r"OWN .*? f\d+_\d+\(")
NAME_PATTERN = re.compile(r"\bx\d+\b")
PARAMETER_PATTERN = re.compile(r"\b(?:[ao]\d+|m|go)\b")


@dataclass(frozen=True)
class Line:
    """C statement.

    Attributes:
        text: The statement.
        defines: Names that it defines, and whether each is a mask.
    """

    text: str
    defines: dict[str, bool]


def assemble(lines: Sequence[Line], parameters: dict[str, str], lanes: int, frame_size: int, stack_bytes: int) -> str:
    """Write a C function of statements; its name is the placeholder `@name`.

    Args:
        lines: Statements in order.
        parameters: Declarations of the parameters, by name.
        lanes: Samples per vector.
        frame_size: Elements of the frame that the statements use.
        stack_bytes: Maximum size of a frame on the stack; a larger one is allocated.

    Returns:
        C definitions of the parts, then of the function.
    """
    parts, frame_size = _split_function(lines, lanes, frame_size)
    inner = {**parameters, "m": f"V_{lanes} *restrict m"}
    texts, body = [], parts[0]
    if len(parts) > 1:
        body = []
        for k, part in enumerate(parts):
            used = set(PARAMETER_PATTERN.findall("\n".join(part)))
            own_parameters = [p for p in inner if p in used]
            texts.append(_function(f"@name_{k}", [inner[p] for p in own_parameters], part))
            body.append(f"@name_{k}({', '.join(own_parameters)});")
    if frame_size and frame_size * 8 * lanes <= stack_bytes:
        body = [f"V_{lanes} m[{frame_size}];", *body]
    elif frame_size:
        body = [f"V_{lanes} *m = allocate({frame_size} * sizeof(V_{lanes}));", *body, "free(m);"]
    return "".join([*texts, _function("@name", list(parameters.values()), body)])


def _function(name: str, parameters: Sequence[str], body: Sequence[str]) -> str:
    """Return the C definition of a function."""
    text = "\n".join("  " + line for line in body)
    return f"OWN __attribute__((noinline)) void {name}({', '.join(parameters) or 'void'}) {{\n{text}\n}}\n"


def split_into_pieces(functions: Sequence[str]) -> str:
    """Distribute functions over pieces of limited length.

    Parts of functions come last, because `build` compiles them with other flags: functions that are not split are short
    and run most often.

    Args:
        functions: Texts as returned by `assemble`, callees first.

    Returns:
        C text with a guard `IN(piece)` around each piece.
    """
    single = [
        text
        for text_of_function in functions
        for text in re.split(r"^(?=OWN )", text_of_function, flags=re.MULTILINE)
        if text
    ]
    heads = [text.split(" {\n", 1)[0] + ";" for text in single]
    whole, parts = ([text for text in single if (PART_PATTERN.match(text) is not None) == cut] for cut in (False, True))
    if sum(text.count("\n") for text in single) <= MAX_PIECE_LINES:
        found, num_pieces = [single], 1
    else:
        found = _fill_pieces(whole)
        num_pieces = len(found)
        found += _fill_pieces(parts)
    guarded = [f"#if IN({k})\n{''.join(piece)}#endif\n" for k, piece in enumerate(found)]
    return "\n".join([f"#define PIECES {len(found)}\n#define WHOLE {num_pieces}", *heads, *guarded])


def _fill_pieces(texts: Sequence[str]) -> list[list[str]]:
    """Group texts in order until a group exceeds the maximum length."""
    found: list[list[str]] = [[]]
    for text in texts:
        if sum(part.count("\n") for part in found[-1]) > MAX_PIECE_LINES:
            found.append([])
        found[-1].append(text)
    return found


def _split_function(lines: Sequence[Line], lanes: int, frame_size: int) -> tuple[list[list[str]], int]:
    """Split statements into parts; return the lines of each part and the size of the frame."""
    if sum(line.text.count("\n") + 1 for line in lines) <= MAX_PART_LINES:
        return [[line.text for line in lines]], frame_size
    used = [set(NAME_PATTERN.findall(line.text)) - line.defines.keys() for line in lines]
    part = _assign_parts(lines, used)
    made = {name: (part[k], mask) for k, line in enumerate(lines) for name, mask in line.defines.items()}
    slots: dict[str, int] = {}
    for k, names in enumerate(used):
        for name in sorted(names):
            if made[name][0] != part[k] and name not in slots:
                slots[name] = frame_size
                frame_size += 1

    def text(k: int, line: Line) -> list[str]:
        def substitute(found: re.Match[str]) -> str:
            name = found[0]
            if name in line.defines or made[name][0] == part[k]:
                return name
            return f"bits_{lanes}(m[{slots[name]}])" if made[name][1] else f"m[{slots[name]}]"

        kept = [(name, mask) for name, mask in line.defines.items() if name in slots]
        stores = [f"m[{slots[name]}] = {f'real_{lanes}({name})' if mask else name};" for name, mask in kept]
        return [NAME_PATTERN.sub(substitute, line.text), *stores]

    parts: list[list[str]] = [[] for _ in range(part[-1] + 1)]
    for k, line in enumerate(lines):
        parts[part[k]] += text(k, line)
    return parts, frame_size


def _assign_parts(lines: Sequence[Line], used: Sequence[set[str]]) -> list[int]:
    """Assign each statement to a part."""
    last = {name: k for k, names in enumerate(used) for name in names}
    alive = np.zeros(len(lines) + 1, dtype=int)  # number of live values before each statement
    for k, line in enumerate(lines):
        for name in line.defines:
            if name in last:
                alive[k + 1] += 1
                alive[last[name] + 1] -= 1
    alive = np.cumsum(alive)
    length = np.cumsum([0, *(line.text.count("\n") + 1 for line in lines)])
    cuts = [0]
    while length[-1] - length[cuts[-1]] > MAX_PART_LINES:
        low, high = np.searchsorted(length, length[cuts[-1]] + np.array([MAX_PART_LINES // 2, MAX_PART_LINES]))
        low = max(int(low), cuts[-1] + 1)
        high = max(int(high), low + 1)
        cuts.append(low + int(np.argmin(alive[low:high])))
    return (np.searchsorted(cuts, np.arange(len(lines)), side="right") - 1).tolist()
