"""The command `model`: parameters, modes, statics, responses, latency, added mass, drive and power, membrane and convergence of the model."""

from typing import Any

import numpy as np
from annotated_types import Interval

from app.cli.model_options import VOLTAGE, ShapeOptions, Topic, describe_specimen, read_load, read_specimen, read_values
from app.cli.model_response import FrequencyResponseTopic, MembraneTopic, StepTopic
from app.cli.options import CommandGroup, FileOptions, command, group, option
from app.cli.output import CommandResult
from app.cli.specimen import AddedMassTopic, DriveTopic, PowerTopic
from app.common import Column, Table, UsageError, read_number, track
from app.identification import TABLE_ONE
from model import (
    NONIDEAL_NAMES,
    Membrane,
    ParameterSpec,
    Series,
    Specimen,
    Tactor,
    parameter_specs,
    specimen_record,
    variable_specs,
)
from model.response import (
    FREQUENCY_SPEC,
    damping_ratios,
    deflection,
    exact_response,
    load_compliance,
    mode_shapes,
    natural_frequencies,
    poles,
    voltage_gain,
)
from model.studies import PaperFigure

SHAPE_COUNT = ParameterSpec("n", "", Interval(), "number of shape functions", 7)
CURVE_POINTS = 201


@command("--set 'E_Al=69 GPa' --elongation '1.27 mm'")
class ParametersTopic(Topic):
    """List every parameter with value, unit, limits and meaning, and the derived values."""

    def compute(self) -> CommandResult:
        specimen = read_specimen(self, on_membrane=True)
        t, values = specimen.tactor, specimen_record(specimen)
        specs = variable_specs()

        def listed(name: str, title: str, names: list[str]) -> Table:
            facts = (
                Column(n, specs[n].unit, [values[n]], description=f"{specs[n].description}; {specs[n].limits}")
                for n in names
            )
            return Table(name, title, tuple(facts), vertical=True)

        derived = (
            Column("I_Al", "m^4", [t.I_Al], description="second moment of area of the plate"),
            Column("k1", "N m^2", [t.k1], description="bending stiffness of the bare plate"),
            Column(
                "eta", "kg/m", [t.eta], description="added mass per length of the third segment, m_add / (2 (L - L2))"
            ),
            Column("tau", "s", [t.tau], description="characteristic time sqrt(rho1 L^4 / k1)"),
            Column("c_bar", "kg/(m s)", [t.c_bar], description="characteristic damping k1 tau / L^4"),
            Column("k_s", "N/m^2", [values["k_s"]], description="distributed stiffness of the skin"),
            Column("c_s", "kg/(m s)", [values["c_s"]], description="distributed damping of the skin"),
        )
        tables = (
            listed("tactor", "Tactor", [q.name for q in parameter_specs(Tactor)]),
            listed(
                "skin", "Membrane and skin", [*(q.name for q in parameter_specs(Membrane)), "delta", "contact_length"]
            ),
            listed("nonideal", "Effects outside the paper's beam model", list(NONIDEAL_NAMES)),
            Table("derived", "What follows", derived, vertical=True),
            Table(
                "sources",
                "The paper's Table I, and the standard uncertainty of its instrument",
                (
                    Column("name", "", list(TABLE_ONE), "parameter"),
                    Column("source", "", [each.description for each in TABLE_ONE.values()]),
                    Column("stated", "", [_format_table_one(n) for n in TABLE_ONE], "uncertainty"),
                ),
            ),
        )
        note = "Change one with --set, for example --set 'L=22 mm'; k_s and c_s too, in place of the membrane's."
        return CommandResult("model parameters", values, tables, (note,))


def _format_table_one(name: str) -> str:
    uncertainty = TABLE_ONE[name].uncertainty
    if uncertainty is None:
        return ""
    from app.identification import sheet_unit  # slow to load

    factor, unit = sheet_unit(name)
    return f"{factor * uncertainty:.2g} {unit}"


@command("--set m_add=0 --pre-stretch 0.0075 --picture modes.png")
class ModesTopic(Topic):
    """Compute natural frequencies, poles and damping ratios, free and on the membrane."""

    shapes: ShapeOptions = group(ShapeOptions)
    count: int = option("number of modes (default: %(default)s)", 3)
    files: FileOptions = group(FileOptions, "the mode shapes")

    def compute(self) -> CommandResult:
        on = read_specimen(self, on_membrane=True)
        free = Specimen(on.tactor)
        choices = [self.shapes.choose(specimen) for specimen in (free, on)]
        choice = max(choices, key=lambda each: each.error if self.shapes.n else each.n)
        n = choice.n
        count = min(self.count, n)
        if count < 1:
            raise UsageError(f"--count {self.count}: give at least one mode")
        x = np.linspace(0, on.tactor.L, CURVE_POINTS)
        columns, panels, curve = [Column("mode", "", range(1, count + 1))], [], [Column("x", "m", x)]
        tables = []
        for key, head, specimen in (("free", "free", free), ("on_skin", "on the skin", on)):
            f = natural_frequencies(on.tactor, specimen.skin, n)[:count]
            columns.append(Column(f"{key}_frequency", "Hz", f, f"{head}, undamped", format_spec=".2f"))
            s = poles(on.tactor, specimen.skin, n)
            s = s[s.imag >= 0][:count]
            tables.append(
                Table(
                    f"{key}_poles",
                    f"Poles, {describe_specimen(specimen)}",
                    (
                        Column("frequency", "Hz", np.abs(s) / (2 * np.pi), "frequency |s|/2π", format_spec=".2f"),
                        Column("damping_ratio", "", damping_ratios(s), "damping ratio", format_spec=".4f"),
                        Column("pole_re", "1/s", s.real, "real part", format_spec=".2f"),
                        Column("pole_im", "rad/s", s.imag, "imaginary part", format_spec=".2f"),
                    ),
                )
            )
            shapes = mode_shapes(on.tactor, x, specimen.skin, n, count)
            curve += [Column(f"{head}, mode {i}", "kg^-1/2", shape) for i, shape in enumerate(shapes, 1)]
            lines = tuple(
                Series(x, w, label=f"mode {i}, {hz:.1f} Hz") for i, (hz, w) in enumerate(zip(f, shapes, strict=True), 1)
            )
            caption = f"Undamped mode shapes of the half beam, {describe_specimen(specimen)}."
            panels.append(
                PaperFigure(f"modes_{key}", "x, clamp to centre", "m", "mode shape", "kg^-1/2", lines, caption)
            )
        first = Table("undamped", "Natural frequencies without damping", tuple(columns))
        return CommandResult(
            "model modes",
            specimen_record(on),
            (first, *tables),
            (f"{choice.describe()}.",),
            write_csv=Table("shapes", "", tuple(curve)).to_csv,
            figures=tuple(panels),
            extra={"shapes": choice.n, "shape_error": choice.error},
        )


@command("--load '200 g' --voltage '1500 V' --csv shape.csv")
class StaticTopic(Topic):
    """Compute the deflection under a load and a voltage, Eqs. (7, corrected) and (8), and its shape."""

    load: str = option("force at the centre, or a mass for its weight (default: %(default)s)", "1 N")
    voltage: str = option("voltage on the specimen (default: %(default)s)", "1500 V")
    files: FileOptions = group(FileOptions, "the shape w(x)")

    def compute(self) -> CommandResult:
        specimen = read_specimen(self)
        t, volts, load_n = specimen.tactor, read_number(self.voltage, VOLTAGE), read_load(self.load)
        x = np.linspace(0, t.L, CURVE_POINTS)
        if specimen.membrane is None and specimen.skin.k_s == 0:
            compliance, gain, w = load_compliance(t), voltage_gain(t), deflection(t, x, volts, load_n)
        else:  # Eqs. (7) and (8) are without skin; the closed form at 0 Hz includes it
            unit = [exact_response(t, 0.0, specimen.skin, x, source)[:, 0].real for source in ("load", "voltage")]
            compliance, gain, w = unit[0][-1], unit[1][-1], load_n * unit[0] + volts * unit[1]
        facts = Table(
            "static",
            f"Static deflection of the centre, {describe_specimen(specimen)}",
            (
                Column("compliance", "m/N", [compliance], "per newton at the centre, Eq. (7) corrected", "µm/N"),
                Column("voltage_gain", "m/V", [gain], "per volt on the specimen, Eq. (8)", "nm/V", ".6g"),
                Column("load", "N", [load_n], "load"),
                Column("voltage", "V", [volts], "voltage"),
                Column("by_load", "m", [compliance * load_n], "deflection by the load", "µm"),
                Column("by_voltage", "m", [gain * volts], "deflection by the voltage", "µm"),
                Column("deflection", "m", [w[-1]], "both", "µm"),
            ),
            vertical=True,
        )
        caption = f"Static deflection under {load_n:.4g} N and {volts:.4g} V, {describe_specimen(specimen)}."
        figure = PaperFigure(
            "static", "x, clamp to centre", "m", "deflection", "m", (Series(x, w, label="w(x)"),), caption
        )
        curve = Table("shape", "", (Column("x", "m", x), Column("deflection", "m", w)))
        return CommandResult(
            "model static", specimen_record(specimen), (facts,), write_csv=curve.to_csv, figures=(figure,)
        )


@command("--shapes 3,5,7,10,20,40 --frequencies 1:500:500")
class ConvergenceTopic(Topic):
    """Compute the error of n shape functions against the closed form."""

    shapes: str = option("values of n (default: %(default)s)", "3,5,7,10,14,20,28,40", metavar="LIST")
    frequencies: str = option("(default: %(default)s)", "1:500:500", metavar="LIST")
    files: FileOptions = group(FileOptions, "the table")

    def compute(self) -> CommandResult:
        from model.studies import convergence as study

        specimen = read_specimen(self)
        n: list[Any] = [int(v) if v == int(v) else v for v in read_values(self.shapes, SHAPE_COUNT)]
        f = read_values(self.frequencies, FREQUENCY_SPEC)
        errors = [study(specimen.tactor, specimen.skin, f, [k]) for k in track(n, "shape functions")]
        worst, worst_amplitude, first = (
            np.concatenate(column)
            for column in zip(
                *((c.max_error, c.max_amplitude_error, c.first_frequency_hz) for c in errors), strict=True
            )
        )
        table = Table(
            "convergence",
            f"Worst deviation from the closed form over {min(f):g} to {max(f):g} Hz, {describe_specimen(specimen)}",
            (
                Column("n", "", n, format_spec="g"),
                Column("error", "", worst, "complex", "%", ".3g"),
                Column("amplitude_error", "", worst_amplitude, "amplitude", "%", ".3g"),
                Column("first_frequency", "Hz", first, "first frequency, undamped", format_spec=".4f"),
            ),
        )
        shapes = np.array(n, float)
        lines = (Series(shapes, worst, label="complex"), Series(shapes, worst_amplitude, label="amplitude"))
        figure = PaperFigure(
            "convergence", "number of shape functions n", "", "worst relative error", "", lines, f"{table.title}."
        )
        return CommandResult(
            "model convergence", specimen_record(specimen), (table,), figures=(figure,), log_scale=True
        )


VERBS = CommandGroup(
    "Compute quantities of the model, for any parameters.",
    "example: tactor-bench model modes --set 'm_add=5 g' --pre-stretch 0.0075",
    {
        "parameters": ParametersTopic,
        "modes": ModesTopic,
        "static": StaticTopic,
        "frequency-response": FrequencyResponseTopic,
        "step": StepTopic,
        "added-mass": AddedMassTopic,
        "drive": DriveTopic,
        "power": PowerTopic,
        "membrane": MembraneTopic,
        "convergence": ConvergenceTopic,
    },
    "topics",
    "TOPIC",
    negative_values=True,
)
