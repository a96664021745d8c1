"""Language and structure checks of the repository; `python -m checks` runs them all.

The package needs only the standard library. Each rule is one function in `checks.rules`, and all numerical limits are
in `checks.limits`.
"""
