"""Who is asking: command line, configuration, session, pictures; `app.gui` is the only Qt."""
