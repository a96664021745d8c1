"""`python docs/results_tables PAGE ... [--check]`: rewrites the tables of pages that are read without a build."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import results_tables

sys.exit(results_tables.main(sys.argv[1:]))
