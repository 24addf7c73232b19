"""State of the Explore page: setting with undo history, kept curves, cursor and range; writes study files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.archive import MeasuredResponse
from app.common import UndoHistory
from app.explore.engine import ExploreRequest
from app.explore.sliders import SLIDERS
from app.explore.state import DRIVE_SLIDER, ExploreSetting, KeptCurve, describe_difference, make_preset

if TYPE_CHECKING:
    from model.response import PerceptionThreshold
    from model.studies import Study


DRIVE_TOLERANCE = 0.02
"""Relative difference between the drives of a run and of the curve above which a warning is shown."""


class ExploreSession:
    """State of the Explore page. A setting that is not physical raises ParameterError and changes nothing."""

    def __init__(self) -> None:
        self.history = UndoHistory(ExploreSetting())
        self.kept_curves: tuple[KeptCurve, ...] = ()
        self.study_variable = "delta"
        """The variable of a study: the last moved slider, or the variable of the preset's curves."""
        self.max_hz, self.cursor_hz = 250.0, 160.0
        self.site = "abdomen"
        """Body site of the perception threshold."""
        self.own_threshold: PerceptionThreshold | None = None
        """Threshold of the laboratory file."""

    @property
    def setting(self) -> ExploreSetting:
        return self.history.current

    @property
    def request(self) -> ExploreRequest:
        """The request for the response engine."""
        return ExploreRequest(
            self.setting, self.kept_curves, self.max_hz, self.cursor_hz, self.site, self.own_threshold
        )

    def set_value(self, name: str, value: float) -> None:
        """Set a slider, SI."""
        if name != DRIVE_SLIDER.name:
            self.study_variable = name
        self.set_setting(self.setting.with_value(name, value), name)

    def set_setting(self, setting: ExploreSetting, merge_key: str = "") -> None:
        """Change the setting; consecutive changes with the same `merge_key`, a slider's name, are one step of the history."""
        _ = setting.specimen
        self.history.push(setting, merge_key)

    def load_preset(self, name: str) -> None:
        """Start from a preset with its curves."""
        chosen = make_preset(name)
        self.kept_curves, self.study_variable = chosen.kept_curves, chosen.variable or self.study_variable
        self.set_setting(chosen.setting)

    def keep_curve(self) -> None:
        """Keep the current curve for comparison."""
        last = self.kept_curves[-1].setting if self.kept_curves else ExploreSetting()
        self.kept_curves += (KeptCurve(describe_difference(last, self.setting), self.setting),)

    def runs_with_other_drive(self, runs: Sequence[MeasuredResponse]) -> list[MeasuredResponse]:
        """Return the runs whose drive differs from the curve's."""
        return [run for run in runs if abs(run.peak_to_peak_v / self.setting.peak_to_peak_v - 1) > DRIVE_TOLERANCE]

    def to_record(self) -> dict[str, Any]:
        """Return the setting as JSON-ready values."""
        s = self.setting
        return {"values": dict(s.values), "on_skin": s.on_skin, "peak_to_peak_v": s.peak_to_peak_v}

    def restore_record(self, record: Mapping[str, Any]) -> None:
        """Restore the setting from `to_record`; unknown sliders are ignored.

        Raises:
            ValueError, KeyError, TypeError, AttributeError: the record is not valid.
        """
        values = {str(n): float(v) for n, v in record["values"].items() if n in SLIDERS}
        setting = ExploreSetting(values, bool(record["on_skin"]), float(record["peak_to_peak_v"]))
        _ = setting.specimen
        self.history = UndoHistory(setting)


def write_study(path: Path, study: "Study", variable: str) -> str:
    """Compute a study into a file, HDF5 or CSV by its suffix; returns a message."""
    from protocols.runfile import StudyFileWriter, StudyHeader  # lazily: loads h5py

    if path.suffix == ".csv":
        study.run().to_csv(path)
    else:
        with StudyFileWriter(path, StudyHeader.of(study)) as file:
            for start, block in study.chunks():
                file.write(start, block)
    return f"{path.name}: max − min over {variable}, {study.shape[0]} values"
