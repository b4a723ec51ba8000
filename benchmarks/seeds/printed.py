"""The figures that the thesis prints: those to beat."""

from typing import Final

FIGURES: Final = {
    "without noise": {"square": 0.0639, "circle": 0.0938, "Lissajous": 0.328},
    "with noise": {"square": 0.1090, "circle": 0.1502, "Lissajous": 1.0381},
    "with filter": {"square": 0.0924, "circle": 0.1243, "Lissajous": 0.3456},
    "R = 0": {"square": 0.0303, "circle": 0.0307, "Lissajous": 0.0592},
}
"""Square root of the mean horizontal distance, in its simulations."""

WALKS_R1: Final = {
    "straight line": (15.0, 194.0, 427.0),
    "square": (15.0, 133.0, 388.0),
    "roundabout, walked": (2.7e9, 1.6e16, 2.5e11),
}
WALKS_R0: Final = {"roundabout, walked": (4e-17, 1.1e89, 2.0e106)}
"""Average error against GPS in metres with a fix every 1, 3, 5 s, by R."""
