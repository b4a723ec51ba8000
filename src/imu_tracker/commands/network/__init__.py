"""The commands of the programs beside the daemon that talk to others.

In: parsed arguments. Out: an exit code. Not here: what is served or sent (`serve/`,
`publish/`).
"""

__all__ = ["publish", "serve"]
