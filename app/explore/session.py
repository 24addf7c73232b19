"""One person's way through the model: where the sliders stand and stood, which curves are kept, where one looks. No Qt.

What the sliders of the Explore page vary, as a study file. No Qt.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.archive.replay import MeasuredResponse
from app.common.undo import UndoHistory
from app.explore.engine import ExploreRequest
from app.explore.sliders import SLIDERS
from app.explore.state import DRIVE_SLIDER, ExplorePreset, ExploreSetting, KeptCurve, describe_difference, make_preset

if TYPE_CHECKING:
    from model.studies.parameter_study import Study


DRIVE_TOLERANCE = 0.02
"""By how much, of it, a run's drive may differ from the curve's."""


class ExploreSession:
    """What the Explore page shows. A setting that is not physical is refused with a ParameterError; all then stays."""

    def __init__(self) -> None:
        self.history = UndoHistory(ExploreSetting())
        self.kept_curves: tuple[KeptCurve, ...] = ()
        self.study_variable = "delta"
        """What a study is about: the slider moved last, or what the preset's curves differ in."""
        self.max_hz, self.cursor_hz = 250.0, 160.0

    @property
    def setting(self) -> ExploreSetting:
        return self.history.current

    @property
    def request(self) -> ExploreRequest:
        """What the model is to answer."""
        return ExploreRequest(self.setting, self.kept_curves, self.max_hz, self.cursor_hz)

    def set_value(self, name: str, value: float) -> None:
        """One slider to a value, SI."""
        if name == DRIVE_SLIDER.name:
            self.set_setting(ExploreSetting(self.setting.values, self.setting.on_skin, value), name)
            return
        self.study_variable = name
        self.set_setting(self.setting.with_value(name, value), name)

    def reset_value(self, name: str) -> None:
        """One slider back."""
        s = self.setting
        self.set_setting(ExploreSetting(s.values, s.on_skin) if name == DRIVE_SLIDER.name else s.with_default(name))

    def set_on_skin(self, on_skin: bool) -> None:
        """Put the tactor on the skin, or take it off."""
        self.set_setting(ExploreSetting(self.setting.values, on_skin, self.setting.peak_to_peak_v))

    def set_setting(self, setting: ExploreSetting, merge_key: str = "") -> None:
        """Another setting; `merge_key` names the slider that is being moved."""
        _ = setting.specimen
        self.history.push(setting, merge_key)

    def load_preset(self, name: str) -> ExplorePreset:
        """Begin from a preset, with its curves."""
        chosen = make_preset(name)
        self.kept_curves, self.study_variable = chosen.kept_curves, chosen.variable or self.study_variable
        self.set_setting(chosen.setting)
        return chosen

    def keep_curve(self) -> None:
        """Let the present curve stay while the sliders move on."""
        last = self.kept_curves[-1].setting if self.kept_curves else ExploreSetting()
        self.kept_curves += (KeptCurve(describe_difference(last, self.setting), self.setting),)

    def runs_with_other_drive(self, runs: Sequence[MeasuredResponse]) -> list[MeasuredResponse]:
        """The runs whose drive is not the curve's."""
        return [run for run in runs if abs(run.peak_to_peak_v / self.setting.peak_to_peak_v - 1) > DRIVE_TOLERANCE]

    def to_record(self) -> dict[str, Any]:
        """The setting as plain values."""
        s = self.setting
        return {"values": dict(s.values), "on_skin": s.on_skin, "peak_to_peak_v": s.peak_to_peak_v}

    def restore_record(self, record: Mapping[str, Any]) -> None:
        """Begin anew from what `record` gave; sliders that are no longer known are passed over.

        Raises:
            ValueError, KeyError, TypeError, AttributeError: it is no such record.
        """
        values = {str(n): float(v) for n, v in record["values"].items() if n in SLIDERS}
        setting = ExploreSetting(values, bool(record["on_skin"]), float(record["peak_to_peak_v"]))
        _ = setting.specimen
        self.history = UndoHistory(setting)


def write_study(path: Path, study: "Study", variable: str) -> str:
    """Compute a study into a file, HDF5 or by its ending CSV; what was written, in words."""
    from protocols.runfile.study_file import StudyFileWriter, StudyHeader  # HDF5, which no window waits for

    if path.suffix == ".csv":
        study.run().to_csv(path)
    else:
        with StudyFileWriter(path, StudyHeader.of(study)) as file:
            for start, block in study.chunks():
                file.write(start, block)
    return f"{path.name}: max − min over {variable}, {study.shape[0]} values"
