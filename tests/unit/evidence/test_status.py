"""Tests of the status of results and of pages that quote them."""

from __future__ import annotations

import pytest

from evidence import status

NAMES = ["layered", "proof"]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("No figures.", set()),
        ("<!-- evidence: proof layered -->", {"proof", "layered"}),
        ("<!-- evidence: proof, layered -->", {"proof", "layered"}),
        ("<!--table: proof.errors-->\n<!-- table: proof+layered.both -->", {"proof", "layered"}),
    ],
)
def test_results_that_a_page_quotes(text, names):
    """Both markers contain names of results."""
    assert status.quoted(text) == names


def test_status_is_1_where_a_page_quotes_a_stale_result(project, store, capsys):
    """A stale result is an error only if a page quotes it; a table of a missing result is not an error."""
    store({})
    page = project / "docs" / "results" / "page.md"
    page.parent.mkdir(parents=True)
    page.write_text("<!-- evidence: proof -->\n<!-- table: layered.errors -->\n")
    assert status.main([], NAMES) == 0
    output = capsys.readouterr().out
    assert "proof        2026-01-02 at " in output
    assert "layered      no result yet" in output
    (project / "benchmarks" / "model.py").write_text("scale = 1\n")
    assert status.main([], NAMES) == 1
    output = capsys.readouterr().out
    assert "since then changed: benchmarks/model.py" in output
    assert "docs/results/page.md: quotes proof, which is older than its code or missing" in output
    assert status.main(["layered"], NAMES) == 0
    page.write_text("<!-- evidence: layered -->\n")
    assert status.main(["layered"], NAMES) == 1
    page.write_text("<!-- table: unknown.errors -->\n")
    assert status.main([], NAMES) == 1
    assert "docs/results/page.md: quotes unknown, which is not a result" in capsys.readouterr().out
    assert status.main(["unknown"], NAMES) == 2


def test_generated_pages_are_not_read(project):
    """Pages below `_build` and `_generated` are generated."""
    for name in ("docs/_build/a.md", "docs/results/_generated/b.md", "docs/c.md"):
        (project / name).parent.mkdir(parents=True, exist_ok=True)
        (project / name).write_text("")
    assert [path.name for path in status.pages(project)] == ["README.md", "c.md"]
