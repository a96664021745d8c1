"""Reading of files: special files, sizes, encodings and JSON."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from colift.runtime import bounded_read


def test_a_regular_file_is_read_whole(tmp_path: Path):
    (tmp_path / "file").write_bytes(b"content")
    assert bounded_read.read_bytes(tmp_path / "file", 7) == b"content"


def test_a_larger_file_is_refused(tmp_path: Path):
    (tmp_path / "file").write_bytes(b"content")
    with pytest.raises(OSError, match="larger than"):
        bounded_read.read_bytes(tmp_path / "file", 6)


def test_a_pipe_without_a_writer_is_refused_at_once(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="a pipe, socket or device, not a regular file"):
        bounded_read.read_bytes(tmp_path / "pipe", 10)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no devices")
def test_an_endless_device_is_refused():
    with pytest.raises(OSError, match="a pipe, socket or device"):
        bounded_read.read_bytes("/dev/zero", 10)


def test_a_folder_is_refused(tmp_path: Path):
    with pytest.raises(OSError, match="a folder, not a file"):
        bounded_read.read_bytes(tmp_path, 10)


def test_a_byte_order_mark_is_removed(tmp_path: Path):
    (tmp_path / "file").write_bytes("\ufefftext".encode())
    assert bounded_read.read_text(tmp_path / "file") == "text"


def test_text_that_is_not_utf_8_is_refused_with_its_line(tmp_path: Path):
    (tmp_path / "file").write_bytes(b"first\nsec\xffond")
    with pytest.raises(ValueError, match=r"file:2: not UTF-8 text \(byte 9\)"):
        bounded_read.read_text(tmp_path / "file")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('{"a": 1,\n', "file:2: not JSON"),
        ("[1]", "must contain a JSON object"),
        ("[" * 100_000, "nested too deeply"),
        ("", "file:1: not JSON"),
        ('{"a": NaN}', r"file: not JSON \(NaN is not a number\)"),
        ('{"a": [-Infinity]}', "-Infinity is not a number"),
        ('{"a": "\\ud800"}', "a text contains a lone surrogate"),
        ('{"a": ' + "9" * 5000 + "}", "file: not JSON"),
    ],
)
def test_other_content_than_a_json_object_is_refused(tmp_path: Path, text: str, reason: str):
    (tmp_path / "file").write_text(text)
    with pytest.raises(ValueError, match=reason):
        bounded_read.read_json(tmp_path / "file")
