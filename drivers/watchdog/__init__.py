"""The watchdog: a process that brings the bench to rest if the program is killed or hangs."""
