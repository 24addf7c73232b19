"""Whether the regression guard notices: functions made 1.5 times slower, one after the other.

    python benchmarks/guard/planted_slowness.py [--only PLACE]

Each place is planted while `regression.py` measures the cases that use it. The exit code is 1 if the guard misses more than one
of them. The table must be of this computer: `python benchmarks/guard/regression.py --update` first.
"""

import argparse
import subprocess
import sys
from pathlib import Path

GUARD = Path(__file__).with_name("regression.py")

PLACES = {
    "model.response.harmonic_response:frequency_response": "response_of_the_model",
    "model.identification.joint_least_squares:joint_fit": "joint_fit_of_a_campaign",
    "protocols.signals.sine:fit_sine": "sine_fit",
    "protocols.signals.swept_response:estimate_swept_response": "response_of_a_sweep",
    "protocols.signals.disturbance:_prediction_errors": "judgement_of_a_recording",
    "protocols.runfile.writer:RunFileWriter._append_rows": "writing_of_blocks",
    "app.archive.catalogue:Catalogue.scan": "index_of_new_runs",
    "app.archive.catalogue:Catalogue.entries": "list_of_known_runs",
    "app.archive.importing:read_table": "import_of_a_table",
    "app.report.drawings:draw_report_plot": "figure_of_a_report",
    "protocols.runner.entries:EntryRunner.run": "sweep_on_the_virtual_clock",
    "protocols.runfile.reader:Run.__init__": "opening_of_a_run",
}
"""Case that should fail, by the function that is planted."""

ALLOWED_MISSES = 1


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PLACES)
    only = parser.parse_args().only
    missed = []
    for place, case in {only: PLACES[only]}.items() if only else PLACES.items():
        ran = subprocess.run(
            [sys.executable, str(GUARD), "--only", case, "--plant", place], capture_output=True, text=True, check=False
        )
        assert ran.returncode in (0, 1), ran.stderr
        print(f"{'found ' if ran.returncode else 'MISSED'} {place}: {ran.stdout.strip()}", flush=True)
        missed += [place] if ran.returncode == 0 else []
    print(f"{len(missed)} missed")
    return 1 if len(missed) > ALLOWED_MISSES else 0


if __name__ == "__main__":
    sys.exit(main())
