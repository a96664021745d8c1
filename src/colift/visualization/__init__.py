"""Figures, animations, playback pages and reports of logged flights."""
