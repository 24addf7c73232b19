"""Run files on disk: catalogue, summaries, notes, replay, export and import."""
