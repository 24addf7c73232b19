"""What is measured: steps, the runner, signals to points, the run file; one file per protocol."""
