"""The bench session: connection, run thread, window state and messages."""
