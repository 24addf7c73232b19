"""Siglent SDG1000X and SDG2000X function generators (also sold as Teledyne T3AFG).

Not SCPI: parameters come in pairs (`C1:BSWV OFST,2.5`), replies carry the header and units, and there is no error queue: a
value that the instrument cannot do is clipped silently. So every setting is read back, and a different value is an error.
Burst mode must be on before its other parameters are accepted. A selected waveform restores the frequency, amplitude and
offset it was stored with, so it is stored with the present ones.

Sources: SDG Series Programming Guide (BSWV, BTWV, WVDT, ARWV, OUTP); how WVDT frames its bytes differs between sources:
this driver states the length (`LENGTH,4096B`) and sends them bare. Test it once on the instrument before high voltage is on.
"""

import math
import re
from collections.abc import Iterable, Sequence

import numpy as np

from drivers.errors import LinkError
from drivers.generators.arbitrary_waveform import SINE_CYCLE, Points
from drivers.generators.burst_generator import LEVEL_TOLERANCE_V, BurstGenerator
from drivers.generators.expected_setting import ExpectedSetting, expect_keyword, expect_range, expect_value

FULL_SCALE = 32767
WAVEFORM_NAMES = ("tbench1", "tbench2")


class SiglentSdg(BurstGenerator):
    """A `Source` that keeps one amplitude and carries every drive in the points of its waveform."""

    MODELS = ("SDG1", "SDG2", "T3AFG")
    PRODUCT_NAMES = "Siglent SDG1000X and SDG2000X"
    CAN_FREEZE_RANGE = False

    def idle_level_v(self) -> float:
        return self._query_number("BSWV", "OFST")

    def _query_parameters(self, command: str) -> dict[str, str]:
        """Return the parameters of a reply by name."""
        answer = self._scpi.query(f"C1:{command}?")
        header = re.match(r"(?:C1:)?([A-Z]+) ", answer)
        if header is None or header[1] != command:
            self._scpi.link.clear()
            raise LinkError(
                f"{self._scpi.instrument}: 'C1:{command}?' was answered by '{answer[:60]}', which is no list of parameters; "
                f"check the cable at {self._scpi.link.name}"
            )
        fields = answer[header.end() :].split(",")
        if command == "OUTP":
            fields = ["STATE", *fields]
        return dict(zip(fields[::2], fields[1::2], strict=False))

    def _query_number(self, command: str, name: str) -> float:
        text = self._query_setting(f"{command} {name}")
        try:
            return float(text)
        except ValueError:
            raise LinkError(
                f"{self._scpi.instrument}: 'C1:{command}?' names no {name} ('{text[:30]}'); is it in the mode it was set to?"
            ) from None

    def _query_setting(self, name: str) -> str:
        command, _, parameter = name.partition(" ")
        text = self._query_parameters(command).get(parameter, "nothing")
        number = re.match(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?(?=[A-Z]*$)", text)
        return number[0] if number else text

    def _set_number(self, command: str, name: str, value: float, tolerance: float) -> None:
        self._scpi.link.write(_parameter_command(command, name, value))
        self._check_readback(self._query_number(command, name), value, tolerance, f"{command} {name}")

    def _set_keywords(self, command: str, **values: str) -> None:
        fields = ",".join(f"{name},{value}" for name, value in values.items())
        self._scpi.link.write(f"C1:{command} {fields.removeprefix('STATE,') if command == 'OUTP' else fields}")
        seen = self._query_parameters(command)
        for name, value in values.items():
            if seen.get(name) != value:
                raise LinkError(
                    f"{self._scpi.instrument}: {command} {name} was set to {value} and reads back {seen.get(name, 'nothing')}; "
                    "nothing more was sent. Look at the instrument's front panel"
                )

    def _expected_settings(self, rest_v: float, low_v: float, high_v: float) -> Iterable[ExpectedSetting]:
        return (
            expect_keyword("OUTP LOAD", "HZ"),
            expect_keyword("OUTP PLRT", "NOR"),
            expect_keyword("BSWV WVTP", "ARB"),
            expect_value("BSWV OFST", rest_v, LEVEL_TOLERANCE_V),
            expect_value("BSWV AMP", high_v - low_v, LEVEL_TOLERANCE_V),
            expect_keyword("BTWV STATE", "ON"),
            expect_keyword("BTWV GATE_NCYC", "NCYC"),
            expect_keyword("BTWV TRSR", "MAN"),
            expect_value("BTWV STPS", 0.0, 1e-3),
            expect_range("BTWV TIME", 1, self.MAX_BURST_CYCLES),
        )

    def _is_output_on(self) -> bool:
        return self._query_setting("OUTP STATE") == "ON"

    def _clear_error_queue(self) -> None:
        """Do nothing: there is no error queue."""

    def _configure(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._set_keywords("OUTP", LOAD="HZ")
        self._set_keywords("OUTP", PLRT="NOR")
        self._set_keywords("BSWV", WVTP="ARB")
        self._set_number("BSWV", "AMP", 0.1, 1e-3)
        self._set_keywords("BTWV", STATE="OFF")
        self._set_number("BSWV", "OFST", rest_v, 1e-3)
        self._stored_waveform = None
        self._load_waveform(SINE_CYCLE)
        self._set_keywords("BTWV", STATE="ON")
        self._set_keywords("BTWV", GATE_NCYC="NCYC", TRSR="MAN")
        self._set_number("BTWV", "STPS", 0, 1e-3)
        self._set_cycles(1)
        self._set_number("BSWV", "AMP", high_v - low_v, 1e-3)

    def _enable_output(self) -> None:
        self._set_keywords("OUTP", STATE="ON")

    def _offset_command(self, volts: float) -> str:
        return _parameter_command("BSWV", "OFST", volts)

    def _set_offset(self, volts: float) -> None:
        self._set_number("BSWV", "OFST", volts, 1e-3)

    def _query_amplitude(self) -> float:
        return self._query_number("BSWV", "AMP")

    def _amplitude_command(self, vpp: float) -> str:
        return _parameter_command("BSWV", "AMP", vpp)

    def _set_amplitude(self, vpp: float) -> None:
        self._set_number("BSWV", "AMP", vpp, 1e-3)

    def _set_rate(self, rate_hz: float, point_count: int) -> None:  # noqa: ARG002 - the rate is in whole periods
        self._set_number("BSWV", "FRQ", rate_hz, 1e-6 * rate_hz + 1e-6)

    def _set_cycles(self, cycles: int) -> None:
        self._set_number("BTWV", "TIME", cycles, 0.5)

    def _query_burst_duration_s(self) -> float:
        if self._query_setting("BTWV STATE") != "ON":
            return 0.0
        cycles = self._query_setting("BTWV TIME")
        return math.inf if cycles == "INF" else float(cycles) / self._query_number("BSWV", "FRQ")

    def _trigger(self) -> None:
        self._send(
            "C1:BTWV MTRIG"
        )  # a trigger cannot be confirmed; the query at least shows that the instrument still replies

    def _send(self, command: str) -> None:
        self._scpi.link.write(command)
        self._query_parameters("OUTP")

    def _abort_commands(self) -> Sequence[str]:
        return "C1:BTWV STATE,OFF", "C1:BTWV STATE,ON"

    def _download_waveform(self, points: Points) -> None:
        playing = self._query_parameters("ARWV").get("NAME", "")
        name = (
            WAVEFORM_NAMES[1] if playing.startswith(WAVEFORM_NAMES[0]) else WAVEFORM_NAMES[0]
        )  # never the waveform on the output
        data = np.rint(points * FULL_SCALE).astype("<i2").tobytes()
        hertz, vpp, offset = (self._query_number("BSWV", name) for name in ("FRQ", "AMP", "OFST"))
        brought = f"FREQ,{hertz:.10g},AMPL,{vpp:.6g},OFST,{offset:.6g},PHASE,0"
        self._scpi.link.write(
            f"C1:WVDT WVNM,{name},TYPE,5,LENGTH,{len(data)}B,{brought},WAVEDATA,{data.decode('latin-1')}"
        )
        self._set_keywords("ARWV", NAME=name)

    def _max_points(self) -> int:
        return 16_384 if self.identity.model.upper().startswith("SDG1") else 1_000_000


def _parameter_command(command: str, name: str, value: float) -> str:
    return f"C1:{command} {name},{value:.10g}"
