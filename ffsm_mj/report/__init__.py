"""Reports of a finished run: figures, text, tables, videos."""

MOST_FRAMES_PER_SECOND = 50
"""Frame durations in GIF are in hundredths of a second, and viewers slow down animations above 50 frames per second."""
