"""Unit constants: all is SI and radians inside, and the papers' feet appear as `100 * FOOT`."""

FOOT = 0.3048  # metres per foot (exact, international foot)
GRAVITY = 9.80665  # metres per second squared (standard gravity)
