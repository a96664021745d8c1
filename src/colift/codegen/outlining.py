"""A long function in parts: the time of C compilers grows faster than the length of what they compile.

Statements keep their order. A part is cut where the fewest values are used further on; those lie in the frame.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LONGEST = 1000  # lines of one part
PIECE = 8000  # lines of what is compiled at once
PART = re.compile(r"OWN .*? f\d+_\d+\(")
NAME = re.compile(r"\bx\d+\b")
PARAMETER = re.compile(r"\b(?:[ao]\d+|m|go)\b")


@dataclass(frozen=True)
class Line:
    """A statement, and the values it defines: whether they are masks."""

    text: str
    defines: dict[str, bool]


def assemble(lines: Sequence[Line], parameters: dict[str, str], lanes: int, room: int, stack: int) -> str:
    """The text of a function `@name` of some statements; its frame m has `room` elements before what is added here."""
    parts, room = _parts(lines, lanes, room)
    inner = {**parameters, "m": f"V_{lanes} *restrict m"}
    texts, body = [], parts[0]
    if len(parts) > 1:
        body = []
        for k, part in enumerate(parts):
            used = set(PARAMETER.findall("\n".join(part)))
            mine = [p for p in inner if p in used]
            texts.append(_function(f"@name_{k}", [inner[p] for p in mine], part))
            body.append(f"@name_{k}({', '.join(mine)});")
    if room and room * 8 * lanes <= stack:
        body = [f"V_{lanes} m[{room}];", *body]
    elif room:
        body = [f"V_{lanes} *m = allocate({room} * sizeof(V_{lanes}));", *body, "free(m);"]
    return "".join([*texts, _function("@name", list(parameters.values()), body)])


def _function(name: str, parameters: Sequence[str], body: Sequence[str]) -> str:
    text = "\n".join("  " + line for line in body)
    return f"OWN __attribute__((noinline)) void {name}({', '.join(parameters) or 'void'}) {{\n{text}\n}}\n"


def pieces(functions: Sequence[str]) -> str:
    """The text of functions in as many pieces as it takes for none to be long; those of parts of functions come last.

    Parts lie behind so that they can be compiled otherwise: what is not cut is short, and what runs most.
    """
    single = [text for many in functions for text in re.split(r"^(?=OWN )", many, flags=re.MULTILINE) if text]
    heads = [text.split(" {\n", 1)[0] + ";" for text in single]
    whole, parts = ([text for text in single if (PART.match(text) is not None) == cut] for cut in (False, True))
    if sum(text.count("\n") for text in single) <= PIECE:
        found, apart = [single], 1
    else:
        found = _filled(whole)
        apart = len(found)
        found += _filled(parts)
    guarded = [f"#if IN({k})\n{''.join(piece)}#endif\n" for k, piece in enumerate(found)]
    return "\n".join([f"#define PIECES {len(found)}\n#define WHOLE {apart}", *heads, *guarded])


def _filled(texts: Sequence[str]) -> list[list[str]]:
    found: list[list[str]] = [[]]
    for text in texts:
        if sum(part.count("\n") for part in found[-1]) > PIECE:
            found.append([])
        found[-1].append(text)
    return found


def _parts(lines: Sequence[Line], lanes: int, room: int) -> tuple[list[list[str]], int]:
    """The statements of each part, and the room of the frame then."""
    if sum(line.text.count("\n") + 1 for line in lines) <= LONGEST:
        return [[line.text for line in lines]], room
    used = [set(NAME.findall(line.text)) - line.defines.keys() for line in lines]
    part = _cut(lines, used)
    made = {name: (part[k], mask) for k, line in enumerate(lines) for name, mask in line.defines.items()}
    slots: dict[str, int] = {}
    for k, names in enumerate(used):
        for name in sorted(names):
            if made[name][0] != part[k] and name not in slots:
                slots[name] = room
                room += 1

    def text(k: int, line: Line) -> list[str]:
        def spelled(found: re.Match[str]) -> str:
            name = found[0]
            if name in line.defines or made[name][0] == part[k]:
                return name
            return f"bits_{lanes}(m[{slots[name]}])" if made[name][1] else f"m[{slots[name]}]"

        kept = [(name, mask) for name, mask in line.defines.items() if name in slots]
        stores = [f"m[{slots[name]}] = {f'real_{lanes}({name})' if mask else name};" for name, mask in kept]
        return [NAME.sub(spelled, line.text), *stores]

    parts: list[list[str]] = [[] for _ in range(part[-1] + 1)]
    for k, line in enumerate(lines):
        parts[part[k]] += text(k, line)
    return parts, room


def _cut(lines: Sequence[Line], used: Sequence[set[str]]) -> list[int]:
    """The part of each statement."""
    last = {name: k for k, names in enumerate(used) for name in names}
    alive = np.zeros(len(lines) + 1, dtype=int)  # before a statement, values used from it on
    for k, line in enumerate(lines):
        for name in line.defines:
            if name in last:
                alive[k + 1] += 1
                alive[last[name] + 1] -= 1
    alive = np.cumsum(alive)
    length = np.cumsum([0, *(line.text.count("\n") + 1 for line in lines)])
    cuts = [0]
    while length[-1] - length[cuts[-1]] > LONGEST:
        low, high = np.searchsorted(length, length[cuts[-1]] + np.array([LONGEST // 2, LONGEST]))
        low = max(int(low), cuts[-1] + 1)
        high = max(int(high), low + 1)
        cuts.append(low + int(np.argmin(alive[low:high])))
    return (np.searchsorted(cuts, np.arange(len(lines)), side="right") - 1).tolist()
