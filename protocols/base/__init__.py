"""Protocol interface: steps, records, events, quality flags."""
