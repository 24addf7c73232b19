"""Siglent SDG1000X and SDG2000X function generators (also sold as Teledyne T3AFG).

Not SCPI: parameters come in pairs (`C1:BSWV OFST,2.5`), answers carry the header and units, and there is no error to ask
for - a value that the box cannot do is clipped without a word. So every setting is read back, and what reads back
differently is an error. Burst mode must be on before its other parameters are heard. A selected waveform brings the
frequency, amplitude and offset along that it was stored with, so it is stored with the ones that hold.

Sources: SDG Series Programming Guide (BSWV, BTWV, WVDT, ARWV, OUTP); how WVDT frames its bytes differs between sources:
this driver states the length (`LENGTH,4096B`) and sends them bare. Try it once on your box before high voltage is on.
"""

import math
import re
from collections.abc import Iterable, Sequence

import numpy as np

from drivers.errors import LinkError
from drivers.generators.arbitrary_waveform import SINE, Points
from drivers.generators.burst_generator import LEVEL_TOLERANCE_V, BurstGenerator
from drivers.generators.expected_setting import Setting, between, near, word

FULL_SCALE = 32767
NAMES = ("tbench1", "tbench2")


class SiglentSdg(BurstGenerator):
    """A `Source` that keeps one amplitude and carries every drive in the points of its waveform."""

    MODELS = ("SDG1", "SDG2", "T3AFG")
    SOLD_AS = "Siglent SDG1000X and SDG2000X"
    HOLDS_RANGE = False

    def idle_v(self) -> float:
        return self._number("BSWV", "OFST")

    def _ask(self, command: str) -> dict[str, str]:
        """The parameters that a query answers, by name."""
        answer = self._scpi.ask(f"C1:{command}?")
        header = re.match(r"(?:C1:)?([A-Z]+) ", answer)
        if header is None or header[1] != command:
            self._scpi.link.clear()
            raise LinkError(
                f"{self._scpi.instrument}: 'C1:{command}?' was answered by '{answer[:60]}', which is no list of parameters; "
                f"check the cable at {self._scpi.link.name}"
            )
        words = answer[header.end() :].split(",")
        if command == "OUTP":
            words = ["STATE", *words]
        return dict(zip(words[::2], words[1::2], strict=False))

    def _number(self, command: str, name: str) -> float:
        text = self._answer(f"{command} {name}")
        try:
            return float(text)
        except ValueError:
            raise LinkError(
                f"{self._scpi.instrument}: 'C1:{command}?' names no {name} ('{text[:30]}'); is it in the mode it was set to?"
            ) from None

    def _answer(self, name: str) -> str:
        command, _, parameter = name.partition(" ")
        text = self._ask(command).get(parameter, "nothing")
        number = re.match(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?(?=[A-Z]*$)", text)
        return number[0] if number else text

    def _put(self, command: str, name: str, value: float, tolerance: float) -> None:
        self._scpi.link.write(_words(command, name, value))
        self._agree(self._number(command, name), value, tolerance, f"{command} {name}")

    def _choose(self, command: str, **values: str) -> None:
        words = ",".join(f"{name},{value}" for name, value in values.items())
        self._scpi.link.write(f"C1:{command} {words.removeprefix('STATE,') if command == 'OUTP' else words}")
        seen = self._ask(command)
        for name, value in values.items():
            if seen.get(name) != value:
                raise LinkError(
                    f"{self._scpi.instrument}: {command} {name} was set to {value} and reads back {seen.get(name, 'nothing')}; "
                    "nothing more was sent. Look at the instrument's front panel"
                )

    def _armed_state(self, rest_v: float, low_v: float, high_v: float) -> Iterable[Setting]:
        return (
            word("OUTP LOAD", "HZ"),
            word("OUTP PLRT", "NOR"),
            word("BSWV WVTP", "ARB"),
            near("BSWV OFST", rest_v, LEVEL_TOLERANCE_V),
            near("BSWV AMP", high_v - low_v, LEVEL_TOLERANCE_V),
            word("BTWV STATE", "ON"),
            word("BTWV GATE_NCYC", "NCYC"),
            word("BTWV TRSR", "MAN"),
            near("BTWV STPS", 0.0, 1e-3),
            between("BTWV TIME", 1, self.MOST_CYCLES),
        )

    def _output_is_on(self) -> bool:
        return self._answer("OUTP STATE") == "ON"

    def _forget_errors(self) -> None:
        """Nothing: this box keeps no errors."""

    def _set_up(self, rest_v: float, low_v: float, high_v: float) -> None:
        self._choose("OUTP", LOAD="HZ")
        self._choose("OUTP", PLRT="NOR")
        self._choose("BSWV", WVTP="ARB")
        self._put("BSWV", "AMP", 0.1, 1e-3)
        self._choose("BTWV", STATE="OFF")
        self._put("BSWV", "OFST", rest_v, 1e-3)
        self._held = None
        self._load(SINE)
        self._choose("BTWV", STATE="ON")
        self._choose("BTWV", GATE_NCYC="NCYC", TRSR="MAN")
        self._put("BTWV", "STPS", 0, 1e-3)
        self._set_cycles(1)
        self._put("BSWV", "AMP", high_v - low_v, 1e-3)

    def _output_on(self) -> None:
        self._choose("OUTP", STATE="ON")

    def _offset_words(self, volts: float) -> str:
        return _words("BSWV", "OFST", volts)

    def _set_offset(self, volts: float) -> None:
        self._put("BSWV", "OFST", volts, 1e-3)

    def _amplitude(self) -> float:
        return self._number("BSWV", "AMP")

    def _amplitude_words(self, vpp: float) -> str:
        return _words("BSWV", "AMP", vpp)

    def _set_amplitude(self, vpp: float) -> None:
        self._put("BSWV", "AMP", vpp, 1e-3)

    def _set_rate(self, rate_hz: float, size: int) -> None:  # noqa: ARG002 - this box counts whole periods
        self._put("BSWV", "FRQ", rate_hz, 1e-6 * rate_hz + 1e-6)

    def _set_cycles(self, cycles: int) -> None:
        self._put("BTWV", "TIME", cycles, 0.5)

    def _longest_s(self) -> float:
        if self._answer("BTWV STATE") != "ON":
            return 0.0
        cycles = self._answer("BTWV TIME")
        return math.inf if cycles == "INF" else float(cycles) / self._number("BSWV", "FRQ")

    def _trigger(self) -> None:
        self._say("C1:BTWV MTRIG")  # nothing confirms a trigger; this at least hears that the box still answers

    def _say(self, words: str) -> None:
        self._scpi.link.write(words)
        self._ask("OUTP")

    def _cut_words(self) -> Sequence[str]:
        return "C1:BTWV STATE,OFF", "C1:BTWV STATE,ON"

    def _store(self, points: Points) -> None:
        playing = self._ask("ARWV").get("NAME", "")
        name = NAMES[1] if playing.startswith(NAMES[0]) else NAMES[0]  # never the one on the output
        data = np.rint(points * FULL_SCALE).astype("<i2").tobytes()
        hertz, vpp, offset = (self._number("BSWV", name) for name in ("FRQ", "AMP", "OFST"))
        brought = f"FREQ,{hertz:.10g},AMPL,{vpp:.6g},OFST,{offset:.6g},PHASE,0"
        self._scpi.link.write(
            f"C1:WVDT WVNM,{name},TYPE,5,LENGTH,{len(data)}B,{brought},WAVEDATA,{data.decode('latin-1')}"
        )
        self._choose("ARWV", NAME=name)

    def _most_points(self) -> int:
        return 16_384 if self.identity.model.upper().startswith("SDG1") else 1_000_000


def _words(command: str, name: str, value: float) -> str:
    return f"C1:{command} {name},{value:.10g}"
