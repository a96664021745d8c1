"""Numerical limits and the folders to which each rule applies."""

MAX_SENTENCE_WORDS = 40
MAX_MODULE_LINES = 400
MAX_FUNCTION_LINES = 60
MAX_PACKAGE_ENTRIES = 17
MAX_README_WORDS = 650
MAX_README_NUMBERS = 25
MAX_LEARNING_WORDS = 2500
MAX_GLOSSARY_TERMS = 60
MAX_DECISION_RECORDS = 40
MAX_TEST_NAME_LENGTH = 60

PACKAGE = "src/colift"
"""Folder of the library."""

PROSE_CODE_FOLDERS = ("src", "examples", "benchmarks", "evidence", "docs", "checks", "tests")
"""Folders whose Python docstrings, comments and help strings are checked for banned words."""

PROSE_YAML_FOLDERS = ("src", "examples")
"""Folders whose YAML comments and descriptions are checked for banned words."""

PROSE_PAGES = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")
"""Markdown pages outside `docs/` that are checked for banned words."""

IGNORED_FOLDERS = frozenset(
    {
        ".cache",
        ".git",
        ".hypothesis",
        ".mypy_cache",
        ".pytest_cache",
        ".ruff_cache",
        ".venv",
        "__pycache__",
        "_build",
        "build",
        "dist",
        "node_modules",
        "out",
    }
)
"""Folders that no rule reads, wherever they are."""
