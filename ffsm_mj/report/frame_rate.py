"""How fast films may be; apart from what draws them, so that the command line can ask before that is imported."""

MOST_FRAMES_PER_SECOND = 50
"""GIF counts hundredths of a second, and viewers slow down what is faster than 50 pictures a second."""
