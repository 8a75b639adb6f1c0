"""Colours that colour-blind people can tell apart (Okabe and Ito), BGR."""

from __future__ import annotations

Colour = tuple[int, int, int]

BLACK: Colour = (0, 0, 0)
WHITE: Colour = (255, 255, 255)

# Ordered so that the first ones stand out from boards of wood, white and black alike.
_OKABE_ITO: tuple[Colour, ...] = (
    (0, 94, 213),  # vermilion
    (233, 180, 86),  # sky blue
    (115, 158, 0),  # bluish green
    (167, 121, 204),  # reddish purple
    (66, 228, 240),  # yellow
    (0, 159, 230),  # orange
    (178, 114, 0),  # blue
)


def colour_of(track_id: int) -> Colour:
    """The colour of an id, the same in every picture."""
    return _OKABE_ITO[track_id % len(_OKABE_ITO)]


def as_hex(colour: Colour) -> str:
    """``#rrggbb``, for plots and pages."""
    blue, green, red = colour
    return f"#{red:02x}{green:02x}{blue:02x}"
