"""Picture of a response over frequency: points on the model's curves, earlier runs, marks, skin threshold, residual or phase."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from app.common import format_point
from app.gui.plots.curve_layers import NOTHING, PHASE, RESIDUAL
from app.gui.plots.picture import (
    DASHED,
    DATA_WIDTH,
    DOTTED,
    EMPTY_PX,
    MODEL_WIDTH,
    ON_AXIS,
    POINT_PX,
    SOLID,
    Layer,
    Panel,
    Picture,
    Region,
    Rule,
    Spot,
    curve_symbol,
    curve_tone,
    layer,
)
from app.gui.plots.series import SERIES, AmplitudeSeries
from app.live import COVERAGE, ModelCurves, ResponseCurves
from model import Array
from model.response import ABDOMEN_THRESHOLD, THRESHOLD_M, UNCOMFORTABLE_HZ
from protocols.base import Quality

if TYPE_CHECKING:
    from app.archive import MeasuredResponse

DISPLACEMENT, FREQUENCY = "Peak-to-peak displacement, µm", "Frequency, Hz"
UNCOMFORTABLE = "Tends to be uncomfortable"
THRESHOLD_HZ = np.geomspace(1.0, 4000.0, 300)
ENDLESS_HZ = 1e6
LOWER = (NOTHING, RESIDUAL, PHASE)
MODEL, BAND, NO_BAND, EARLIER = "Model", f"{100 * COVERAGE:g} % band", "no band", "Earlier runs"
COMING = "still to be measured"
NOT_USABLE = "crossed: not usable"


@dataclass(frozen=True, slots=True, eq=False)
class Threshold:
    """Perception threshold of the skin as it is drawn: one level, or a curve; µm over Hz."""

    label: str = ABDOMEN_THRESHOLD.line_label
    level_um: float = 1e6 * THRESHOLD_M
    curve: tuple[Array, Array] | None = None

    @classmethod
    def of(cls, threshold: Any) -> "Threshold":
        """Return a model's threshold; the abdomen's for None."""
        if threshold is None:
            return cls()
        label = str(threshold.line_label)
        if len(threshold.frequency_hz) == 1:
            return cls(label, float(1e6 * threshold.amplitude_m[0]))
        return cls(label, curve=(THRESHOLD_HZ, 1e6 * threshold.amplitude_at(THRESHOLD_HZ)))

    def add_to(self, picture: Picture) -> Picture:
        """Return a picture over frequency with the threshold and the stretches where vibration is uncomfortable."""
        low, high = UNCOMFORTABLE_HZ
        regions = (
            Region(low=low, high=high, tone="sand", label=UNCOMFORTABLE),
            Region(low=high, high=ENDLESS_HZ, tone="sand2"),
        )
        lower = tuple(replace(each, panel=1, label="") for each in regions) if len(picture.panels) > 1 else ()
        if self.curve is None:
            rule = Rule(at=self.level_um, label=self.label, along_y=True)
            first = replace(picture.panels[0], high=max(picture.panels[0].high or 0.0, 1.5 * self.level_um))
            panels = (first, *picture.panels[1:])
            return replace(picture, regions=(*regions, *lower), rules=(*picture.rules, rule), panels=panels)
        line = layer(
            name=self.label, x=self.curve[0], y=self.curve[1], tone="text2", line=DASHED, label=self.label, copied=False
        )
        return replace(picture, regions=(*regions, *lower), layers=(*picture.layers, line))


def model_layers(
    curves: ModelCurves, shown: Sequence[AmplitudeSeries] = SERIES, label: str = MODEL, band: bool = True
) -> list[Layer]:
    """Return the model's layers for the free tactor and, each in its own colour, for the elongations of the membrane."""
    layers = []
    several = bool(curves.on_membrane)
    for at, each in enumerate((curves.free, *curves.on_membrane.values())):
        where = f", {each['peak_to_peak'].label}" if several else ""
        tone = curve_tone(at) if several else "model"
        for series in shown:
            drawn = each[series.column].scaled(1.0, series.factor)
            is_main = series is SERIES[0]
            has_band = band and drawn.band is not None
            layers.append(
                layer(
                    name=f"{series.label}{where}, curve: {curves.active_model.description}",
                    x=drawn.x, y=drawn.plotted, band=drawn.band if has_band else None, tone=tone,
                    line=series.line, width=MODEL_WIDTH if is_main else DATA_WIDTH,
                    label=((each["peak_to_peak"].label if several else f"{label}, {BAND if has_band else NO_BAND}" if band else label) if is_main else ""),
                    group=MODEL,
                )
            )  # fmt: skip
    return layers


def run_layers(run: "MeasuredResponse", at: int, shown: Sequence[AmplitudeSeries] = SERIES[:1]) -> list[Layer]:
    """Return the layers of a recorded run, the n-th of several; each in its colour and with its symbol."""
    return [
        layer(
            name=f"{run.title}{'' if len(shown) == 1 else f': {series.label}'}", x=run.frequency_hz,
            y=series.values_of(run), errors=series.errors_of(run), usable=run.peak_to_peak.fit_rows,
            tone=curve_tone(at), line=SOLID if series is shown[0] else None, width=1.0,
            symbol=curve_symbol(at), size=EMPTY_PX if at % 2 else POINT_PX, hollow=series is not shown[0],
            label=run.label if series is shown[0] else "", group=run.label,
        )
        for series in shown
    ]  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class RunInPlot:
    """A run as one layer of a response.

    Attributes:
        name: of the run, with its drive.
        layer: its max - min, µm over Hz.
        natural_hz: identified natural frequency; NaN without one.
    """

    name: str
    layer: Layer
    natural_hz: float = math.nan

    @property
    def largest(self) -> float:
        """Largest response at a usable point, µm; NaN without one."""
        y = self.layer.y[self.layer.usable]
        return float(np.nanmax(y)) if np.isfinite(y).any() else math.nan


@dataclass(frozen=True, slots=True, eq=False)
class ResponseView:
    """Points, model curves and marks of a response, during a run and after it.

    Attributes:
        points: of the run.
        chosen: whether each point is selected.
        curves: of the model for the run's settings; None before they are computed.
        preview: of the model for the settings of the next run; None where they are those of `curves`.
        earlier: points of runs before, with their labels and natural frequencies, Hz.
        added: recorded runs that were added to the plot.
        natural_hz: identified natural frequency; NaN without one.
        present_hz: frequency that is being measured; NaN without one.
        coming_hz: frequencies of the run that are still to be measured.
        lower: one of `LOWER`.
    """

    points: Sequence[Any] = ()
    chosen: Sequence[bool] = ()
    curves: ModelCurves | None = None
    preview: ModelCurves | None = None
    earlier: Sequence[tuple[str, Sequence[Any], float]] = ()
    added: "Sequence[MeasuredResponse]" = ()
    natural_hz: float = math.nan
    present_hz: float = math.nan
    present_text: str = ""
    coming_hz: tuple[float, ...] = ()
    lower: str = NOTHING
    threshold: Threshold = Threshold()
    simulated: bool = False

    def picture(self) -> Picture:
        layers = [] if self.curves is None else model_layers(self.curves)
        if self.preview is not None:
            volts = 2 * self.preview.request.amplitude_v
            thin = model_layers(self.preview, SERIES[:1], f"next, {volts:.3g} V", band=False)[0]
            series = replace(thin.series, name=f"next run, {thin.name}")
            layers.append(replace(thin, series=series, width=1.0, line=DASHED, tone="accent_text", group=""))
        layers += [run.layer for run in self.other_runs()]
        if self.coming_hz:
            x = np.array(self.coming_hz)
            layers.append(
                layer(
                    name=COMING, x=x, y=np.zeros(x.size), tone="text2", symbol=ON_AXIS, size=2 * EMPTY_PX, hollow=True,
                    copied=False,
                )
            )  # fmt: skip
        layers += [layer for series in reversed(SERIES) for layer in self._measured(series)]
        panels, lower = self._lower()
        top = 0.0 if self.curves is None else self.curves.request.max_hz
        right = max([top, 0.0 if self.curves else 250.0, *(1.03 * p.frequency for p in self.points)])
        picture = Picture(
            title="Response", note=self._note(), alarming=self._is_alarming, x_title=FREQUENCY,
            panels=(Panel(title=DISPLACEMENT, low=0.0, share=4), *panels), layers=(*layers, *lower),
            spots=tuple(self._spots()), rules=tuple(self._rules()), x=(0.0, right), simulated=self.simulated,
        )  # fmt: skip
        return self.threshold.add_to(picture)

    def runs(self) -> list[RunInPlot]:
        """Return the runs in the plot, the present one first."""
        present = next(iter(self._measured(SERIES[0])), None)
        first = [] if present is None else [RunInPlot("This run", present, self.natural_hz)]
        return [*first, *self.other_runs()]

    def other_runs(self) -> Iterable[RunInPlot]:
        """Yield the runs before, and those that were added."""
        for at, (label, points, natural_hz) in enumerate(self.earlier):
            x = np.array([p.frequency for p in points])
            yield RunInPlot(
                label,
                layer(
                    name=label, x=x, y=SERIES[0].factor * np.array([p.peak_to_peak for p in points]),
                    usable=np.array([Quality(p.quality).usable for p in points], bool),
                    tone=curve_tone(at), line=SOLID, width=1.0, symbol=curve_symbol(at), size=EMPTY_PX,
                    label=label, group=EARLIER if len(self.earlier) > 3 else label,
                ),
                natural_hz,
            )  # fmt: skip
        for at, run in enumerate(self.added, len(self.earlier)):
            yield RunInPlot(f"{run.label}, {run.peak_to_peak_v:.3g} V", run_layers(run, at)[0], run.natural_hz)

    def _measured(self, series: AmplitudeSeries) -> Iterable[Layer]:
        is_main, tones = series is SERIES[0], dict[str, list[int]]()
        for at, point in enumerate(self.points):
            tones.setdefault(self._tone_of(point), []).append(at)
        for number, (tone, rows) in enumerate(tones.items()):
            points = [self.points[row] for row in rows]
            errors = [series.errors_of(p) for p in points]
            yield layer(
                name=f"{series.label}, measured{f', {number + 1}' if number else ''}",
                x=np.array([p.frequency for p in points]),
                y=np.array([float(series.values_of(p)) for p in points]),
                errors=np.array([np.nan if e is None else float(e) for e in errors]), tone=tone,
                symbol=series.symbol, size=POINT_PX if is_main else EMPTY_PX, hollow=not is_main,
                usable=np.array([Quality(p.quality).usable for p in points]),
                chosen=np.array([bool(self.chosen) and self.chosen[row] for row in rows]),
                texts=[format_point(p) for p in points], label="" if number else series.label, group=series.label,
            )  # fmt: skip

    def _tone_of(self, point: Any) -> str:
        """Return the tone of a point: its curve's, where several are drawn."""
        if self.curves is None or not self.curves.on_membrane:
            return "ink"
        own = self.curves.at_elongation(getattr(point, "elongation", None))
        every = (self.curves.free, *self.curves.on_membrane.values())
        return next((curve_tone(at) for at, each in enumerate(every) if each is own), "ink")

    def _usable(self) -> list[Any]:
        return [p for p in self.points if Quality(p.quality).usable and np.isfinite(p.peak_to_peak)]

    def _spots(self) -> Iterable[Spot]:
        if math.isfinite(self.present_hz):
            at = math.nan
            if self.curves is not None:
                curve = self.curves.free["peak_to_peak"]
                at = float(np.interp(self.present_hz, curve.x, 1e6 * curve.y))
            text = f"{self.present_hz:g} Hz{f', {self.present_text}' if self.present_text else ''}"
            yield Spot(x=self.present_hz, y=at, label=text, tone="amber", column=True)
        elif len(usable := self._usable()) > 2:
            top = max(usable, key=lambda p: p.peak_to_peak)
            um = 1e6 * float(top.peak_to_peak)
            yield Spot(x=float(top.frequency), y=um, label=f"Largest {um:.0f} µm at {top.frequency:.4g} Hz")

    def _rules(self) -> Iterable[Rule]:
        if math.isfinite(self.natural_hz):
            label = f"Natural frequency {self.natural_hz:.1f} Hz"
            yield Rule(at=self.natural_hz, label=label, tone="text", style=DOTTED, marked=True)

    @property
    def _is_alarming(self) -> bool:
        return bool(self._without_curve()) or bool(self.curves is not None and self.curves.active_model.problem)

    def _without_curve(self) -> str:
        """Return which elongations have no curve of the model."""
        if self.curves is None:
            return ""
        elongations = {float(getattr(p, "elongation", math.nan)) for p in self.points}
        bare = sorted(e for e in elongations if not math.isnan(e) and self.curves.at_elongation(e) is None)
        return f"no curve of {', '.join(f'{1e3 * e:g}' for e in bare)} mm" if bare else ""

    def _note(self) -> str:
        if missing := self._without_curve():
            return missing
        notes = [] if self.curves is None else [f"curve: {self.curves.active_model.description}"]
        if any(not Quality(p.quality).usable for p in self.points):
            notes.append(NOT_USABLE)
        return "; ".join(notes)

    # -- the lower panel ---------------------------------------------------------------------------------------------

    def _lower(self) -> tuple[list[Panel], list[Layer]]:
        if self.lower == NOTHING:
            return [], []
        is_residual = self.lower == RESIDUAL
        title = "Residual, %" if is_residual else "Phase, °"
        y, errors, line = self._residual() if is_residual else self._phase()
        x = np.array([p.frequency for p in self.points])
        usable = np.array([Quality(p.quality).usable for p in self.points], bool)
        layers = [
            layer(
                name=self.lower, x=x, y=y, errors=errors, symbol="o", size=EMPTY_PX, usable=usable, panel=1,
                group=SERIES[0].label if is_residual else "",
            )
        ]  # fmt: skip
        if line is not None:
            layers.insert(
                0, layer(name=f"{self.lower}, model", x=line[0], y=line[1], tone="model", line=SOLID, panel=1)
            )
        return [Panel(title=title, x_labels=False)], layers

    def _residual(self) -> tuple[Array, Array, tuple[Array, Array] | None]:
        """Return measured max - min less the model's, in per cent of the model's, its errors, and the line of zero."""
        if self.curves is None:
            nothing = np.full(len(self.points), np.nan)
            return nothing, nothing, None
        model = np.array([_model_peak_to_peak(point, self.curves) for point in self.points])
        y = 100 * (np.array([p.peak_to_peak for p in self.points]) / model - 1)
        errors = 100 * np.array([p.peak_to_peak_errors for p in self.points]) / model
        return y, errors, (self.curves.free["peak_to_peak"].x[[0, -1]], np.zeros(2))

    def _phase(self) -> tuple[Array, Array, tuple[Array, Array] | None]:
        """Return the phase of the fundamental relative to the drive, degrees, unwrapped downwards from zero."""
        phases = [(p.phase + 0.5) % (2 * np.pi) - 2 * np.pi - 0.5 if p.phase > 0.5 else p.phase for p in self.points]
        errors = np.degrees([p.phase_errors for p in self.points])
        if self.curves is None:
            return np.degrees(phases), errors, None
        # One line after the other with a gap between them: free, then on the membrane.
        every = [curves["fundamental"] for curves in (self.curves.free, *self.curves.on_membrane.values())]
        lines = [(one.x, np.degrees(np.unwrap(np.angle(one.y)))) for one in every]
        x, y = (np.concatenate([np.append(part, np.nan) for part in parts]) for parts in zip(*lines, strict=True))
        return np.degrees(phases), errors, (x, y)


def _model_peak_to_peak(point: Any, curves: ModelCurves) -> float:
    """Return the model's max - min at a point, at the point's elongation of the membrane; NaN without such a curve."""
    own: ResponseCurves | None = curves.at_elongation(getattr(point, "elongation", None))
    return math.nan if own is None else float(np.interp(point.frequency, own["peak_to_peak"].x, own["peak_to_peak"].y))
