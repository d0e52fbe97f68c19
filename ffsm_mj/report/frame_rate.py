"""Limit on the frame rate of animations; a module of its own, so that the command line need not import Matplotlib."""

MOST_FRAMES_PER_SECOND = 50
"""Frame durations in GIF are in hundredths of a second, and viewers slow down animations above 50 frames per second."""
