"""Charts and pictures drawn with matplotlib: model curves, runs, panels with error bars."""
