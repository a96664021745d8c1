"""Damage of result files, for tests and evidence: bytes, types of files, and entries of valid files."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np


class Damage(NamedTuple):
    """Damage of a file.

    Attributes:
        apply: Function that damages the file of a path.
        certain: Whether a reader must notice it; some flipped bits are in unused bytes.
        suffixes: Suffixes of the files to which it applies.
    """

    apply: Callable[[Path], object]
    certain: bool = True
    suffixes: tuple[str, ...] = (".json", ".nc")


def _bytes(change: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(change(path.read_bytes()))


def _instead(make: Callable[[Path], object]) -> Callable[[Path], object]:
    def apply(path: Path) -> None:
        path.unlink()
        make(path)

    return apply


def _json(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], object]:
    def apply(path: Path) -> None:
        content = json.loads(path.read_text())
        changed = change(content)
        path.write_text(json.dumps(content if changed is None else changed, indent=2) + "\n")

    return apply


def _netcdf(change: Callable[[h5py.File], object]) -> Callable[[Path], object]:
    def apply(path: Path) -> None:
        buffer = io.BytesIO(path.read_bytes())
        with h5py.File(buffer, "r+") as file:
            change(file)
        path.write_bytes(buffer.getvalue())

    return apply


def _flip(at: Callable[[int], int]) -> Callable[[bytes], bytes]:
    return lambda b: b[: at(len(b))] + bytes([b[at(len(b))] ^ 0x10]) + b[at(len(b)) + 1 :]


def _first(content: dict[str, Any]) -> dict[str, Any]:
    """Return the first case of a summary, or the first bound of a certificate."""
    return next(iter((content.get("cases") or content["ultimate_bounds"]).values()))


def _replace_number(content: dict[str, Any], value: Any) -> None:
    first = _first(content)
    if "e_p_rms_m" in first:
        first["e_p_rms_m"] = value
    else:
        first["a_posteriori"]["e_p"] = value


def _remove_required(content: dict[str, Any]) -> None:
    first = _first(content)
    del first["complete" if "complete" in first else "status"]


def _replace_variable(file: h5py.File, value: Any) -> None:
    del file["e_p"]
    file["e_p"] = value


JSON, NETCDF = (".json",), (".nc",)
DAMAGES = {
    "empty file": Damage(_bytes(lambda b: b"")),
    "first byte only": Damage(_bytes(lambda b: b[:1])),
    "truncated after a quarter": Damage(_bytes(lambda b: b[: len(b) // 4])),
    "truncated in the middle": Damage(_bytes(lambda b: b[: len(b) // 2])),
    "truncated before the end": Damage(_bytes(lambda b: b[:-3])),
    "zero bytes": Damage(_bytes(lambda b: bytes(len(b)))),
    "zero bytes in the header": Damage(_bytes(lambda b: bytes(64) + b[64:])),
    "zero bytes at the end": Damage(_bytes(lambda b: b[:-4096] + bytes(min(len(b), 4096))), certain=False),
    "flipped bit in the first byte": Damage(_bytes(_flip(lambda _n: 0))),
    "flipped bit in the header": Damage(_bytes(_flip(lambda _n: 13)), certain=False),
    "flipped bit in the middle": Damage(_bytes(_flip(lambda n: n // 2)), certain=False),
    "flipped bit near the end": Damage(_bytes(_flip(lambda n: n - 100)), certain=False),
    "bytes appended": Damage(_bytes(lambda b: b + b"\xff\x00garbage"), certain=False),
    "another format": Damage(_bytes(lambda _b: b"\x89PNG\r\n\x1a\n" + bytes(200))),
    "text": Damage(_bytes(lambda _b: b"no result\n")),
    "folder in place of the file": Damage(_instead(Path.mkdir)),
    "pipe in place of the file": Damage(_instead(os.mkfifo)),
    "link to itself": Damage(_instead(lambda path: path.symlink_to(path.name))),
    "no permission": Damage(lambda path: path.chmod(0), certain=False),  # root may read it
    "JSON list": Damage(_json(lambda content: [content]), suffixes=JSON),
    "other schema": Damage(_json(lambda content: content.update(schema=99)), suffixes=JSON),
    "schema is a text": Damage(_json(lambda content: content.update(schema="2")), suffixes=JSON),
    "missing entry": Damage(_json(_remove_required), suffixes=JSON),
    "text in place of a number": Damage(_json(lambda content: _replace_number(content, "0.1 m")), suffixes=JSON),
    "NaN in place of a number": Damage(_json(lambda content: _replace_number(content, float("nan"))), suffixes=JSON),
    "huge number": Damage(_json(lambda content: _replace_number(content, 10**400)), suffixes=JSON),
    "list in place of a section": Damage(_json(lambda content: content.update(warnings=5, observed=5)), suffixes=JSON),
    "newer log": Damage(_netcdf(lambda file: file.attrs.update(schema=99)), suffixes=NETCDF),
    "missing variable": Damage(_netcdf(lambda file: file.pop("e_p")), suffixes=NETCDF),
    "missing attribute": Damage(_netcdf(lambda file: file.attrs.pop("update_times_s")), suffixes=NETCDF),
    "attribute of another type": Damage(_netcdf(lambda file: file.attrs.update(T_end_s="late")), suffixes=NETCDF),
    "NaN in a variable": Damage(_netcdf(lambda file: file["p"].__setitem__((slice(5), 0), np.nan)), suffixes=NETCDF),
    "variable of another shape": Damage(
        _netcdf(lambda file: _replace_variable(file, np.zeros((2, 2)))), suffixes=NETCDF
    ),
    "variable of another type": Damage(_netcdf(lambda file: _replace_variable(file, "text")), suffixes=NETCDF),
    "times in reverse": Damage(
        _netcdf(lambda file: file["time"].__setitem__(slice(None), file["time"][:][::-1])), suffixes=NETCDF
    ),
    "scenario of another team": Damage(
        _netcdf(lambda file: file.attrs.update(scenario_json=file.attrs["scenario_json"].replace('"n0"', '"n1"', 1))),
        certain=False,  # some commands read no scenario
        suffixes=NETCDF,
    ),
}
"""Damages by description."""
