"""Parameter studies, sensitivity, uncertainty and the figures of the paper."""
