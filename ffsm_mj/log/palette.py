"""Colours of viewers, pages and figures: the palette of Okabe and Ito, distinct with every kind of colour vision."""

from __future__ import annotations

Colour = tuple[int, int, int]
BLACK, WHITE = (0, 0, 0), (255, 255, 255)
ORANGE, VERMILION, YELLOW = (230, 159, 0), (213, 94, 0), (240, 228, 66)
SKY, BLUE, GREEN, PURPLE = (86, 180, 233), (0, 114, 178), (0, 158, 115), (204, 121, 167)
# Curves are seen on black and on white: a viewer has a dark and a light theme.
PALE, GREY = (165, 165, 165), (130, 130, 130)

ROBOT, ROBOT_ON_DARK = BLUE, SKY
"""The robot on white, and on the dark ground of a viewer."""
OBJECTS = (VERMILION, ORANGE, GREEN, SKY, PURPLE)
"""Objects in the order of the scenario, in turn."""
TIP_BEFORE, TIP_BEFORE_ON_DARK, TIP_AFTER = BLACK, PALE, PURPLE
"""Path of the tip before the first event, on white and on dark, and after it."""
TARGET, TARGET_ON_DARK = BLACK, WHITE
ON_ANY_GROUND = GREY
"""Instead of black and white where the ground may be either."""
MARK, FORCE, PART_OF_FORCE, TORQUE, PLUME = YELLOW, GREEN, VERMILION, ORANGE, (255, 170, 60)
PLUME_OPACITY = 200 / 255
GHOST = YELLOW
"""Where the control law takes a body to be."""
AXES = ((224, 82, 82), (92, 184, 92), (92, 140, 240))
"""Axes x, y and z of a frame."""


def object_colour(index: int) -> Colour:
    """Colour of an object by its index in the scenario."""
    return OBJECTS[index % len(OBJECTS)]


def mixed(colour: Colour, other: Colour, part: float) -> Colour:
    """A colour with a part, from 0 to 1, of another."""
    red, green, blue = (round((1.0 - part) * a + part * b) for a, b in zip(colour, other, strict=True))
    return red, green, blue


def shares(colour: Colour, opacity: float = 1.0) -> tuple[float, ...]:
    """Red, green, blue and opacity of a colour, each from 0 to 1."""
    return (*(value / 255 for value in colour), opacity)


def packed(colour: Colour) -> int:
    """A colour as one number, 0xRRGGBB."""
    red, green, blue = colour
    return red << 16 | green << 8 | blue


def hexadecimal(colour: Colour) -> str:
    """A colour as in HTML, ``#RRGGBB``."""
    return f"#{packed(colour):06X}"
