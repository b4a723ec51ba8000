"""Set the Pi up: what the sensors need of its boot files, modules and groups.

In: a configuration, and the files of a Raspberry Pi. Out: steps, each a command or the
edit of one file, which are run when the user agrees. Nothing is edited that was not
understood. The only room that starts other programs. Not here: asking and printing
(`commands/machine/setup`), probing the sensors (`check/`).
"""

__all__ = ["actions", "machine", "steps"]
