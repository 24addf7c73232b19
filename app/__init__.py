"""Front ends: command line, graphical user interface, configuration, sessions and reports."""
