"""Simulated bench in the Bench page: speed, prompts and faults, and the true parameters as forms."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QFrame, QWidget

from app.config import BenchConfig, SimulationTable, simulation_tables, table_at, with_simulation_tables
from app.gui.bench_page.table_form import TableForm
from app.gui.bench_page.tiles import TileGrid
from app.gui.status import SimulationControls
from app.gui.widgets import column, make_button, make_label, make_panel, make_toggle, row

MAIN_FIELDS = 4

TITLES = {
    (): "Noise, grid and speed",
    ("tactor",): "Tactor",
    ("skin",): "Skin under the tactor at the start",
    ("membrane",): "Membrane",
    ("hands",): "Simulated operator",
    ("beyond",): "Effects outside the model",
    ("mounting",): "Differences between mountings",
    ("electrical",): "Electrical properties of the specimen",
    ("room",): "Room",
    ("ageing",): "Ageing of the specimen by cycles",
    ("generator",): "Function generator",
    ("amplifier",): "Amplifier",
    ("amplifier", "map"): "Amplifier's map",
    ("supply",): "DC supply",
    ("sensor",): "Displacement sensor",
    ("card",): "Card",
    ("interlock",): "Interlock",
}


class SimulationPanel(QFrame):
    """Settings of a simulated bench; hidden for a real one.

    Args:
        controls: speed and operator of the simulated bench; None for a real bench.
    """

    changed = Signal()

    def __init__(self, controls: SimulationControls | None) -> None:
        super().__init__()
        self.controls = controls
        self.forms: dict[tuple[str, ...], TableForm] = {}
        """The forms by the keys of their tables; made when they are first shown."""
        self._simulation: Mapping[str, Any] | None = None
        self.faults_button = make_button(
            "Faults …", self._toggle_faults, "choice", "Inject and clear faults", "bench.faults", "F9"
        )
        self._content = QWidget()
        title = "True parameters: specimen, instruments, operator"
        tip = "True values that a measurement on the simulated bench should find"
        self.open_button = make_toggle(title, tip, "bench.simulation.open", self._content)
        self.open_button.toggled.connect(self._make_forms)
        make_panel(
            make_label("Simulated bench", "heading", wrap=False),
            *(() if controls is None else (controls,)),
            row(self.open_button, self.faults_button, None),
            self._content,
            frame=self,
        )

    @property
    def table(self) -> dict[str, Any] | None:
        """The table [simulation] as it is typed; None for a real bench."""
        if self._simulation is None:
            return None
        return with_simulation_tables(self._simulation, {keys: form.record for keys, form in self.forms.items()})

    def set_config(self, config: BenchConfig, is_open: bool) -> None:
        """Show the table of a bench.

        Args:
            config: of the bench.
            is_open: whether the window has opened it, so that its speed may be changed.
        """
        self._simulation = config.simulation
        self.setVisible(config.simulated)
        self.faults_button.setVisible(is_open)
        if self.controls is not None:
            self.controls.setVisible(is_open)
        for keys, form in self.forms.items():
            form.set_record(self._record(keys))

    def _make_forms(self) -> None:
        """Make the forms when they are first shown."""
        if self.forms:
            return
        panels = []
        for keys, kind in simulation_tables().items():
            form = TableForm(".".join(("simulation", *keys)), kind, tuple(kind.model_fields)[:MAIN_FIELDS])
            form.set_record(self._record(keys))
            form.changed.connect(self.changed)
            self.forms[keys] = form
            panels.append(make_panel(make_label(TITLES[keys], "caption"), form, None, spacing=4))
        column(TileGrid(panels), parent=self._content)

    def _record(self, keys: tuple[str, ...]) -> SimulationTable:
        return simulation_tables()[keys].from_record(table_at(self._simulation or {}, keys))

    def _toggle_faults(self) -> None:
        if (action := self.window().findChild(QAction, "faults.toggle")) is not None:
            action.trigger()
