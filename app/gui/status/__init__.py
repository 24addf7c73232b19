"""Status of the session and commands to it: status bar, notices, prompts, injected faults."""
