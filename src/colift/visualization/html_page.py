"""Parts that all HTML pages share: document, style, security policy, sections, tables and figures.

A page is one file that makes no network request. All functions escape the text that they are given; parameters named
`content` are HTML.
"""

from __future__ import annotations

import base64
import hashlib
import html
from collections.abc import Iterable, Mapping, Sequence

STATIC_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Content security policy of a page without scripts: no request, no script."""
STYLE = """
:root { color-scheme: light dark; --text: #22262b; --quiet: #5c646d; --line: #d3d8dd; --paper: #fff; --bad: #b3261e;
  --link: #0b57a4; }
@media (prefers-color-scheme: dark) {
  :root { --text: #e4e7ea; --quiet: #a2abb4; --line: #363c43; --paper: #15181c; --bad: #ff8a80; --link: #8ab8f0; }
  figure img { filter: brightness(0.9); }
}
body { max-width: 1080px; margin: 0 auto; padding: 16px; background: var(--paper); color: var(--text);
  font: 15px/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { margin: 0; } h2 { margin: 1.6em 0 0.4em; } h3 { margin: 1.2em 0 0.3em; }
a { color: var(--link); }
.quiet, figcaption { color: var(--quiet); } .bad { color: var(--bad); font-weight: 600; }
#conclusion { margin: 1em 0 0; padding-left: 12px; border-left: 3px solid var(--link); font-size: 17px; }
.wide { overflow-x: auto; } pre { overflow-x: auto; font-size: 13px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 9px; border-bottom: 1px solid var(--line); text-align: right; vertical-align: top; }
thead th { vertical-align: bottom; }
.wide td, .wide th { white-space: nowrap; } .wide .words td, .wide td.text { white-space: normal; min-width: 7em; }
th:first-child, td:first-child, .text, .words td, .words th { text-align: left; overflow-wrap: normal; }
.words th { font-weight: normal; color: var(--quiet); vertical-align: top; white-space: nowrap; }
.words td { overflow-wrap: anywhere; } .wide + .words { margin-top: 1.2em; }
dl.columns { display: grid; grid-template-columns: max-content 1fr; gap: 2px 14px; margin: 0.8em 0; font-size: 14px; }
dl.columns dt { color: var(--quiet); } dl.columns dd { margin: 0; }
figure { margin: 1.2em 0; } figure img { display: block; width: 100%; background: #fff; }
@media (max-width: 700px) { .words th { white-space: normal; }
  dl.columns { grid-template-columns: fit-content(40%) 1fr; }
  figure { overflow-x: auto; } figure img { width: 700px; max-width: none; } }
"""
"""Style sheet of pages with text, tables and figures, for light and dark mode and for narrow windows."""


def document(title: str, content: str, policy: str = STATIC_POLICY, style: str = STYLE, run: str = "") -> str:
    """Return an HTML document.

    Args:
        title: Title of the window.
        content: Content of the body.
        policy: Content security policy, which restricts the requests and scripts of the page.
        style: Style sheet.
        run: Identifier by which `run_directory` recognizes the file as one of colift.

    Returns:
        The text of the file.
    """
    generator = f'<meta name="generator" content="{html.escape(f"colift {run}".strip())}">\n'
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n{generator}'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
        f"<title>{html.escape(title)}</title>\n<style>{style}</style>\n</head>\n<body>\n{content}\n</body>\n</html>\n"
    )


def script_policy(script: str) -> str:
    """Return the content security policy of a page that runs one script, which is identified by its digest.

    Args:
        script: Text of the script element.
    """
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return f"{STATIC_POLICY}; script-src 'sha256-{digest}'"


def section(title: str, content: str) -> str:
    """Return a section with its title.

    Args:
        title: Text of the heading.
        content: Content below the heading.
    """
    return f"<section><h2>{html.escape(title)}</h2>\n{content}</section>"


def paragraphs(lines: Iterable[str]) -> str:
    """Return a paragraph for each line of text."""
    return "".join(f"<p>{html.escape(line)}</p>" for line in lines)


def conclusion(sentences: Sequence[str]) -> str:
    """Return the paragraph at the top of a page that states its result."""
    return f'<p id="conclusion">{html.escape(" ".join(sentences))}</p>'


def definitions(rows: Mapping[str, str]) -> str:
    """Return a table with a name and a text in each row."""
    cells = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(x)}</td></tr>" for name, x in rows.items())
    return f'<table class="words">{cells}</table>'


def column_meanings(meanings: Mapping[str, str]) -> str:
    """Return the definitions of the columns of a table, for the place below it."""
    entries = "".join(f"<dt>{html.escape(name)}</dt><dd>{html.escape(x)}</dd>" for name, x in meanings.items())
    return f'<dl class="columns">{entries}</dl>'


def table(
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    title: str = "",
    words: bool = False,
    text_columns: int = 1,
) -> str:
    """Return a table that scrolls within the page if it is wider.

    Args:
        header: Text of each column; line breaks are kept.
        rows: Text of the cells.
        title: Text above the table.
        words: True for cells with text, which are left-aligned and broken into lines.
        text_columns: Number of first columns that are left-aligned; the others contain numbers.
    """
    head = _cells("th", header, text_columns)
    body = "".join(f"<tr>{_cells('td', row, text_columns)}</tr>" for row in rows)
    kind = ' class="words"' if words else ""
    above = f'<p class="quiet">{html.escape(title)}</p>' if title else ""
    return f'{above}<div class="wide"><table{kind}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def figure(png: bytes, caption: str) -> str:
    """Return a figure that is part of the page.

    Args:
        png: Content of the PNG file.
        caption: Text below the figure.
    """
    text = html.escape(caption)
    image = f'<img alt="{text}" src="data:image/png;base64,{base64.b64encode(png).decode()}">'
    return f"<figure>{image}<figcaption>{text}</figcaption></figure>\n"


def _cells(tag: str, texts: Sequence[str], text_columns: int) -> str:
    """Return the cells of a row."""
    kinds = (' class="text"' * (0 < k < text_columns) for k in range(len(texts)))
    return "".join(f"<{tag}{kind}>{_lines(text)}</{tag}>" for kind, text in zip(kinds, texts, strict=True))


def _lines(text: str) -> str:
    """Return escaped text with its line breaks."""
    return html.escape(text.strip("\n")).replace("\n", "<br>")
