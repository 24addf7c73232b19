"""Interactive model exploration: sliders, history, response engine and fits."""
