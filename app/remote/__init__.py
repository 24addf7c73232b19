"""Read-only web page of the window's state, for a phone or a second screen."""
