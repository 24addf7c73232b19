"""Result card of a run, and the report of its specimen."""
