"""Rule on the length of sentences."""

from __future__ import annotations

from collections.abc import Iterator

from checks.limits import MAX_SENTENCE_WORDS
from checks.markdown import Kind
from checks.prose import PLACEHOLDER, sentences, words
from checks.repository import Problem, Repository

RULE = "sentence-length"


def sentence_length(repository: Repository) -> Iterator[Problem]:
    """Reject sentences over the word limit in docs/ and README.md.

    Headings, tables, code, display mathematics, link targets and bibliographies are not read. Inline code and inline
    mathematics count as one word each. A list item ends a sentence.
    """
    for path in (*repository.files("docs", ".md"), *repository.files("README.md")):
        for block in repository.page(path).blocks:
            if block.kind is not Kind.PARAGRAPH or block.in_bibliography or RULE in block.allowed:
                continue
            for offset, sentence in sentences(block.text):
                count = len(words(sentence))
                if count > MAX_SENTENCE_WORDS:
                    yield Problem(repository.name(path), block.line_at(offset), RULE, _message(sentence, count))


def _message(sentence: str, count: int) -> str:
    start = " ".join(sentence.replace(PLACEHOLDER, "`...`").split()[:6])
    return (
        f"sentence of {count} words (limit {MAX_SENTENCE_WORDS}): '{start} ...'; "
        "split it: one idea per sentence, or a list for enumerations"
    )
