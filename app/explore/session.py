"""One person's way through the model: where the sliders stand and stood, which curves are kept, where one looks. No Qt.

What the sliders of the Explore page vary, as a study file. No Qt.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.archive.replay import Measured
from app.common.undo import History
from app.explore.engine import Question
from app.explore.sliders import SLIDERS
from app.explore.state import DRIVE, Kept, Preset, Setting, difference, preset

if TYPE_CHECKING:
    from model.studies.parameter_study import Study


SAME_DRIVE = 0.02
"""By how much, of it, a run's drive may differ from the curve's."""


class Exploration:
    """What the Explore page shows. A setting that is not physical is refused with a ParameterError; all then stays."""

    def __init__(self) -> None:
        self.history = History(Setting())
        self.kept: tuple[Kept, ...] = ()
        self.variable = "delta"
        """What a study is about: the slider moved last, or what the preset's curves differ in."""
        self.top_hz, self.at_hz = 250.0, 160.0

    @property
    def setting(self) -> Setting:
        return self.history.now

    @property
    def question(self) -> Question:
        """What the model is to answer."""
        return Question(self.setting, self.kept, self.top_hz, self.at_hz)

    def turn(self, name: str, value: float) -> None:
        """One slider to a value, SI."""
        if name == DRIVE.name:
            self.go(Setting(self.setting.values, self.setting.on_skin, value), name)
            return
        self.variable = name
        self.go(self.setting.moved(name, value), name)

    def reset(self, name: str) -> None:
        """One slider back."""
        s = self.setting
        self.go(Setting(s.values, s.on_skin) if name == DRIVE.name else s.reset(name))

    def lay_on_skin(self, on: bool) -> None:
        """Put the tactor on the skin, or take it off."""
        self.go(Setting(self.setting.values, on, self.setting.peak_to_peak_v))

    def go(self, setting: Setting, moving: str = "") -> None:
        """Another setting; `moving` names the slider that is being moved."""
        _ = setting.specimen
        self.history.go(setting, moving)

    def choose(self, name: str) -> Preset:
        """Begin from a preset, with its curves."""
        chosen = preset(name)
        self.kept, self.variable = chosen.kept, chosen.variable or self.variable
        self.go(chosen.setting)
        return chosen

    def keep(self) -> None:
        """Let the present curve stay while the sliders move on."""
        last = self.kept[-1].setting if self.kept else Setting()
        self.kept += (Kept(difference(last, self.setting), self.setting),)

    def otherwise_driven(self, runs: Sequence[Measured]) -> list[Measured]:
        """The runs whose drive is not the curve's."""
        return [run for run in runs if abs(run.peak_to_peak_v / self.setting.peak_to_peak_v - 1) > SAME_DRIVE]

    def record(self) -> dict[str, Any]:
        """The setting as plain values."""
        s = self.setting
        return {"values": dict(s.values), "on_skin": s.on_skin, "peak_to_peak_v": s.peak_to_peak_v}

    def begin_from(self, record: Mapping[str, Any]) -> None:
        """Begin anew from what `record` gave; sliders that are no longer known are passed over.

        Raises:
            ValueError, KeyError, TypeError, AttributeError: it is no such record.
        """
        values = {str(n): float(v) for n, v in record["values"].items() if n in SLIDERS}
        setting = Setting(values, bool(record["on_skin"]), float(record["peak_to_peak_v"]))
        _ = setting.specimen
        self.history = History(setting)


def write_study(path: Path, study: "Study", variable: str) -> str:
    """Compute a study into a file, HDF5 or by its ending CSV; what was written, in words."""
    from protocols.runfile.study_file import StudyFile, StudyHeader  # HDF5, which no window waits for

    if path.suffix == ".csv":
        study.run().to_csv(path)
    else:
        with StudyFile(path, StudyHeader.of(study)) as file:
            for start, block in study.blocks():
                file.write(start, block)
    return f"{path.name}: max − min over {variable}, {study.shape[0]} values"
