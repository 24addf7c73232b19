"""Main window: page host, stack of covers, menus, settings, session controller."""
