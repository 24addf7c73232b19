"""The Runs page: catalogue table, filter, viewer and transfers."""
