"""The Measure page: form, presets, run panel and estimates."""
