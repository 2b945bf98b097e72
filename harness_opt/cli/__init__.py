"""Commands, options, exit codes: the only room that prints or exits."""

from .commands import main

__all__ = ["main"]
