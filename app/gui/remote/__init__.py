"""Web page of the window: its settings and its server."""
