"""Mutants of shipped scenarios, one for every seed: typing errors, changes by other programs, malicious input."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from colift import scenario
from colift.scenario.shipped import SHIPPED_DIRECTORY

SAMPLE = Path(__file__).parent / "sample_scenario.yaml"
TEXTS = [(SHIPPED_DIRECTORY / f"{name}.yaml").read_text(encoding="utf-8") for name in scenario.shipped_names()]
TEXTS.append(SAMPLE.read_text(encoding="utf-8"))

NUMBERS = """0 -0.0 -1 1 2 20 1e-300 1e-12 1e-3 1e3 1e5 1e6 1e9 1e12 1e300 1.7e308 1e999 -1e999 .inf -.inf .nan 5e-324
9223372036854775807 9223372036854775808 18446744073709551616 1234567890123456789012345678901 0x10 0o17 0b11 1_000 +5
0x_ 0o_ 1__0 1e 12:30:45 190:20:30 2001-01-01 2001-99-99 ~ null true false yes 1.5.5 --1 1e5e5""".split()
NUMBERS += ["9" * 400, "9" * 5000, "0x" + "f" * 40_000, "0." + "1" * 9000, "1" + "_" * 3000]
VALUES = [
    *("!!bool foo", "!!int foo", "!!float foo", "!!null foo", "!!timestamp foo", "!!binary //8=", "!!set {a, b}"),
    *("!!omap [a: 1]", "!!python/object:os.system x", "!foo bar", "!!str 5", "!!seq {a: 1}", "!!map [1]", "! 5"),
    *(
        '"\\ud800"',
        '"\\x00"',
        '"\\U0010ffff"',
        '"\\uDFFF\\ud800"',
        "'\u202e'",
        "\u00e9",
        '""',
        "''",
        "|",
        ">",
        "- 1",
        "*arm",
    ),
    *("*nowhere", "&a [*a]", "&b {c: *b}", "&arm 5", "<<", "{<<: *arm}", "{<<: 5}", "{<<: [*arm, 3]}", "&m {<<: *m}"),
    *(
        "[]",
        "{}",
        "[[]]",
        "[{}]",
        "{a: 1, a: 2}",
        "{1: 2}",
        "{[1]: 2}",
        "{{a: 1}: 2}",
        "{? : 1}",
        "{~: 1}",
        "? a",
        "@a",
        "`a`",
    ),
    *("[1, 2]", "[1, 2, 3]", "[1, 2, 3, 4]", "[.nan, .inf, 1e999]", "[a, b, c]", "[[1, 2, 3], [4, 5, 6], [7, 8, 9]]"),
    *("paper", "payload", "agents", "base", "front/left", "nobody", "{kind: wind}", "{kind: 5}", "{urdf: /dev/zero}"),
    *(
        "{urdf: ., thrust_max_N: 5, tips: [a]}",
        '{urdf: "a\\0b", thrust_max_N: 5, tips: [a]}',
        "%",
        "# all",
        "---",
        "...",
    ),
    *("{urdf: /dev/zero, thrust_max_N: 5, tips: [a]}", "{urdf: no.urdf, tips: 5}", "x" * 5000, "[" * 60 + "]" * 60),
    *("[" * 3000, "{a: " * 3000, "- " * 500, "[" + "5, " * 9000 + "]", "[" + "{name: a}, " * 2000 + "]", "? " * 200),
    "[" + ", ".join(f"[{i}]" for i in range(3000)) + "]",
]
BOMB = "z0: &z0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"z{i}: &z{i} [{', '.join(9 * [f'*z{i - 1}'])}]\n" for i in range(1, 12)
)
HEADS = [
    "\ufeff",
    "%YAML 1.1\n---\n",
    "%YAML 1.3\n---\n",
    "%TAG ! x:\n---\n",
    "---\n",
    "--- !!map\n",
    "\t",
    BOMB,
    "&a\n",
]

Mutation = Callable[[np.random.Generator, str], str]

NAME = r"(?<![A-Za-z_0-9])([A-Za-z_0-9]+):"
"""Name of a setting. Without the condition on its start, the search takes quadratic time in long words."""


def _pick(rng: np.random.Generator, of: list[str]) -> str:
    return of[rng.integers(len(of))]


def _replace_match(rng: np.random.Generator, text: str, pattern: str, values: list[str]) -> str:
    """Return the text with one match of a pattern replaced."""
    found = list(re.finditer(pattern, text, re.MULTILINE))
    if not found:
        return text
    at = found[rng.integers(len(found))]
    return text[: at.start(1)] + _pick(rng, values) + text[at.end(1) :]


def _lines(change: Callable[[np.random.Generator, list[str], int], list[str]]) -> Mutation:
    def mutation(rng: np.random.Generator, text: str) -> str:
        rows = text.split("\n")
        return "\n".join(change(rng, rows, int(rng.integers(len(rows)))))

    return mutation


MUTATIONS: list[Mutation] = [
    *3 * [lambda rng, text: _replace_match(rng, text, r"(?<![\w.])(-?\d[\d.e+-]*)", NUMBERS)],
    *2 * [lambda rng, text: _replace_match(rng, text, r"(?<![\w.])(-?\d[\d.e+-]*)", VALUES)],
    *2 * [lambda rng, text: _replace_match(rng, text, r": (\S.*)$", VALUES)],
    lambda rng, text: _replace_match(rng, text, r": ([A-Za-z_/]+)", VALUES),
    lambda rng, text: _replace_match(rng, text, NAME, ["name", "kind", "urdf", "1", "~", '"\\ud800"', "<<", "x"]),
    lambda rng, text: _replace_match(rng, text, NAME, ["".join(rng.choice(list("abc_NmHz"), 6))]),
    _lines(lambda rng, rows, i: rows[:i] + rows[i + 1 :]),
    _lines(lambda rng, rows, i: rows[: i + 1] + rows[i:]),
    _lines(lambda rng, rows, i: rows[:i] + 200 * rows[i : i + 1] + rows[i:]),
    _lines(lambda rng, rows, i: rows[:i] + [" " * int(rng.integers(4)) + rows[i]] + rows[i + 1 :]),
    _lines(lambda rng, rows, i: rows[:i] + [rows[i].strip()] + rows[i + 1 :]),
    _lines(lambda rng, rows, i: rows[:i] + [_pick(rng, VALUES)] + rows[i:]),
    _lines(lambda rng, rows, i: rows[:i] + rows[int(rng.integers(len(rows))) :]),
    lambda rng, text: _pick(rng, HEADS) + text,
    lambda rng, text: text + _pick(rng, ["\n---\na: 1\n", "\n...\n", "\0", "\n%", "\n" + BOMB, "\n" + 20_000 * " "]),
    lambda rng, text: text.replace("\n", _pick(rng, ["\r\n", "\r", "\x85", "\u2028", " "])),
    lambda rng, text: text[: int(rng.integers(len(text)))],
    lambda rng, text: text[(i := int(rng.integers(len(text)))) :] + text[:i],
    lambda rng, text: _insert_yaml_signs(rng, text),
    lambda rng, text: text * int(rng.integers(2, 40)),
]


def _insert_yaml_signs(rng: np.random.Generator, text: str) -> str:
    """Insert characters with a meaning in YAML at random positions."""
    for _ in range(int(rng.integers(1, 6))):
        i = int(rng.integers(len(text) + 1))
        text = text[:i] + _pick(rng, list("[]{},:#&*!|>'\"%@`?-\n\t\0 \x07\x7f\u0085\ufeff\U0001f681")) + text[i:]
    return text


def _bytes(rng: np.random.Generator, text: str) -> bytes:
    """Encode a mutant, mostly as UTF-8; sometimes in another encoding or with invalid bytes."""
    way = rng.integers(20)
    if way == 0:
        return text.encode(_pick(rng, ["utf-16", "utf-32", "latin-1", "utf-8-sig"]), "replace")
    raw = text.encode("utf-8", "surrogatepass")
    if way == 1 and raw:
        i = int(rng.integers(len(raw)))
        return raw[:i] + rng.bytes(int(rng.integers(1, 30))) + raw[i:]
    return raw


def mutant(seed: int) -> bytes:
    """Return one of the scenarios with one or several mutations."""
    rng = np.random.default_rng(seed)
    text = _pick(rng, TEXTS)
    for _ in range(int(rng.geometric(0.6))):
        if text:
            text = MUTATIONS[rng.integers(len(MUTATIONS))](rng, text)
    return _bytes(rng, text)
