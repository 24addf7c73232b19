"""Evidence for the assumptions of the drivers about sources and cards, as data, and its reader."""
