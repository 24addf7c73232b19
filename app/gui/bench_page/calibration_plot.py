"""Plot of a sensor's calibration: positions over volts and the fitted line, above the residuals."""

from collections.abc import Sequence

import numpy as np

from app.config import CalibrationPoint, SensorCalibration
from app.gui.face import set_length
from app.gui.plots import MODEL_WIDTH, SOLID, Chart, Panel, Picture, layer

LEAST_RANGE_UM = 0.01


class CalibrationPlot(Chart):
    """Points and line; residuals below on the same volts."""

    def __init__(self) -> None:
        super().__init__("points and line of the calibration", headed=False, zooms=False)
        self.is_simulated = False
        set_length(self, height=300)
        self.setObjectName("bench.calibration.plot")
        self.setAccessibleName("calibration: positions, line and residuals")

    def show_points(self, points: Sequence[CalibrationPoint], calibration: SensorCalibration | None) -> None:
        """Draw the points, and the line if there is one."""
        volts = np.array([point.volts for point in points])
        layers = [layer(name="points", x=volts, y=np.array([1e6 * p.position_m for p in points]), symbol="o")]
        largest_um = LEAST_RANGE_UM
        if calibration is not None:
            ends = np.array([volts.min(), volts.max()])
            line = 1e6 * calibration.gain_m_per_v * (ends - calibration.zero_v)
            residuals_um = 1e6 * np.array(calibration.residuals_m)
            largest_um = max(float(np.abs(residuals_um).max()), LEAST_RANGE_UM)
            layers += [
                layer(name="line", x=ends, y=line, tone="model", line=SOLID, width=MODEL_WIDTH),
                layer(name="zero", x=ends, y=np.zeros(2), tone="model", line=SOLID, panel=1, copied=False),
                layer(name="residuals", x=volts, y=residuals_um, symbol="o", panel=1),
            ]
        self.show_picture(
            Picture(
                x_title="Sensor's output, V", layers=tuple(layers), log=(False, False), simulated=self.is_simulated,
                panels=(
                    Panel(title="Position, µm", share=3, x_labels=False),
                    Panel(title="Residual, µm", share=2, low=-largest_um, high=largest_um),
                ),
            )
        )  # fmt: skip
