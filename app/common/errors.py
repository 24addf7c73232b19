"""How a command ends: its exit code, or a sentence about what was asked wrongly."""

DONE, FAILED, USAGE, UNSAFE = 0, 1, 2, 3


class UsageError(Exception):
    """The command was given something it cannot use; the sentence says what and what would do."""
