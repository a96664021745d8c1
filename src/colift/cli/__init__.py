"""Command line of colift."""
