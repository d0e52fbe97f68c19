"""Colours of viewers: the palette of Okabe and Ito, which is distinct with every kind of colour vision, and its uses."""

from __future__ import annotations

Colour = tuple[int, int, int]
# Curves are seen on black and on white: a viewer has a dark and a light theme.
PALE, GREY = (165, 165, 165), (130, 130, 130)
ORANGE, VERMILION, YELLOW = (230, 159, 0), (213, 94, 0), (240, 228, 66)
SKY, BLUE, GREEN, PURPLE = (86, 180, 233), (0, 114, 178), (0, 158, 115), (204, 121, 167)

MARK, FORCE, TORQUE, PLUME = YELLOW, GREEN, ORANGE, (255, 170, 60)
PLUME_OPACITY = 200 / 255


def shares(colour: Colour, opacity: float = 1.0) -> tuple[float, ...]:
    """Red, green, blue and opacity of a colour, each from 0 to 1."""
    return (*(value / 255 for value in colour), opacity)


def packed(colour: Colour) -> int:
    """A colour as one number, 0xRRGGBB."""
    red, green, blue = colour
    return red << 16 | green << 8 | blue
