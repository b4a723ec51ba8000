"""Matplotlib opens its fonts once in a process and keeps them."""

from io import BytesIO

from matplotlib.figure import Figure


def load_fonts() -> None:
    """Open them before a test does, which would seem to leave files open."""
    figure = Figure()
    figure.suptitle("0123 $x$")
    figure.savefig(BytesIO())
