"""Commissioning of a bench in the window: progress, checks and the page of traces."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QPixmap, QResizeEvent
from PySide6.QtWidgets import QFrame, QLabel

from app.common import Severity, number_text, sentence_case
from app.gui.face import tokens
from app.gui.widgets import (
    BackgroundWorker,
    StatusLine,
    configure,
    fill_table,
    make_button,
    make_label,
    make_panel,
    make_progress_bar,
    make_read_only_table,
    row,
    set_tone,
)
from app.live import CommissioningJob
from protocols.commissioning import CheckedOutput, OutputVerdict, worst_verdict

ABOUT_TEXT = (
    "With high voltage off, the source exercises the driver's assumptions, and the card measures them at the amplifier's input: levels, "
    "polarity, amplitudes, transients, Stop, a lost connection. Takes a minute. Then the interlock, where one is wired: with 300 V on the "
    "specimen the heartbeat ends. Required for high voltage on a real bench."
)
PROGRESS_STEPS = 1000
COLUMNS = ("", "measured at the output", "figure", "limits", "unit", "worst")


class CommissioningPanel(QFrame):
    """Starts and shows a commissioning.

    Args:
        worker: draws the page of traces.
        start: begins a commissioning.
        stop: ends it.
    """

    def __init__(self, worker: BackgroundWorker, start: Callable[[], object], stop: Callable[[], object]) -> None:
        super().__init__()
        self._worker = worker
        self.job: CommissioningJob | None = None
        self._shown = False
        self._picture = QPixmap()
        self.start_button = make_button("Commission", start, "go", name="bench.commission")
        self.progress_label = make_label(kind="large", name="bench.commission.progress")
        self.progress_bar = make_progress_bar(PROGRESS_STEPS, 8, "bench.commission.bar")
        self.stop_button = make_button("Stop", stop, "stop", name="bench.commission.stop", minimumHeight=36)
        self.message_label = configure(StatusLine(), "bench.commission.message")
        self.verdict_label = make_label(kind="caption", name="bench.commission.verdict")
        self.table = make_read_only_table(
            COLUMNS, "bench.commission.table", "checks of the commissioning", minimumHeight=260
        )
        self.picture_label = configure(QLabel(), "bench.commission.traces", accessibleName="page of traces")
        make_panel(
            make_label("Commission the source and the interlock", "heading", wrap=False),
            make_label(ABOUT_TEXT),
            row(self.start_button, (self.progress_label, 1), self.stop_button),
            self.progress_bar,
            self.message_label,
            self.verdict_label,
            self.table,
            self.picture_label,
            frame=self,
        )
        for widget in (self.progress_bar, self.stop_button, self.table, self.picture_label):
            widget.hide()

    def follow(self, job: CommissioningJob) -> None:
        """Show a commissioning that begins."""
        self.job, self._shown = job, False
        self.message_label.show_message("")
        for widget in (self.table, self.picture_label):
            widget.hide()
        self.verdict_label.setText("")

    def tick(self) -> None:
        """Refresh the progress."""
        job = self.job
        if job is None:
            return
        if job.ended:
            if not self._shown:
                self._shown = True
                self._show_result(job)
            return
        self.stop_button.setVisible(not job.stopping)
        self.progress_bar.setVisible(job.started)
        self.progress_bar.setValue(round(PROGRESS_STEPS * job.fraction))
        if job.stopping:
            text = "stopping: the source goes to rest …"
        elif job.asks:
            text = "waits for your answer"
        elif job.exercises:
            text = f"exercise {len(job.exercises)}: {job.exercises[-1]} …"
        else:
            text = "opens the instruments …"
        self.progress_label.setText(text)

    def _show_result(self, job: CommissioningJob) -> None:
        for widget in (self.progress_bar, self.stop_button):
            widget.hide()
        self.progress_label.setText("")
        if job.result is None:
            self.message_label.show_message(sentence_case(job.error), is_error=True)
            return
        done = job.result
        verdict = worst_verdict(done.result.checks)
        passed = verdict is OutputVerdict.PASS
        self.verdict_label.setText(f"{'✓' if passed else '✕'} {done.identity}: {verdict}. Record: {done.path}")
        set_tone(self.verdict_label, Severity.SUCCESS if passed else Severity.ERROR)
        checks = sorted(done.result.checks, key=lambda check: check.passed)
        fill_table(
            self.table,
            [_cells(check) for check in checks],
            lambda at, place: tokens().passed_color(checks[at].passed) if place == 0 or not checks[at].passed else "",
        )
        self.table.resizeRowsToContents()
        self.table.show()
        title = f"{done.identity}, firmware {done.identity.firmware or 'unknown'}: {verdict}"
        picture = done.path.with_suffix(".png")

        def draw() -> Path:
            from app.plotting import draw_commissioning

            draw_commissioning(title, done.result.traces, job.config.amplifier.rest_v, job.config.simulated, picture)
            return picture

        self._worker.submit(draw, self._show_picture, self._on_error)

    def _show_picture(self, path: Path) -> None:
        self._picture = QPixmap(str(path))
        self.picture_label.setToolTip(str(path))
        self.picture_label.show()
        self._scale_picture()

    def _on_error(self, error: Exception) -> None:
        self.message_label.show_message(f"The page of traces could not be drawn: {error}", is_error=True)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._scale_picture()

    def _scale_picture(self) -> None:
        if not self._picture.isNull():
            width = max(self.width() - 30, 200)
            self.picture_label.setPixmap(self._picture.scaledToWidth(width, Qt.TransformationMode.SmoothTransformation))


def _cells(check: CheckedOutput) -> tuple[str, ...]:
    limits = " to ".join(number_text(limit) for limit in (check.low, check.high) if limit is not None)
    return str(check.verdict), str(check.check), number_text(check.value, 4), limits, check.unit, check.detail
