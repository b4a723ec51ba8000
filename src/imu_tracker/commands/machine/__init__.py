"""Commands about the computer that it runs on: setup.

In: parsed arguments. Out: an exit code. Not here: what a Pi needs (`setup/`).
"""

__all__ = ["setup"]
