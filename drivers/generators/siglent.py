"""Siglent SDG1000X, SDG2000X and SDG6000X function generators (also sold as Teledyne T3AFG).

Not SCPI: parameters come in pairs (`C1:BSWV OFST,2.5`), replies carry the header and units, and there is no error queue: an
impossible value is clipped silently. Therefore every setting is read back, and a different value is an error. Burst mode must be
on before its other parameters are accepted.

A waveform is uploaded as bare bytes in a line, so that no byte of it may be 0x0A, which would end the message. It is selected on
arrival, the instrument then does not reply for seconds, and a selection may have to be repeated. Waveforms are read back before
they are played, are kept in the instrument and selected again, and stay below 64 kB: several larger ones hang the instrument's
remote and panel with its output running. Over USB uploads are lost without an error. One connection is served.

An SDG6000X differs: its waveforms are big-endian, follow the header of a block with their size, and arrive over USB. An application
note of Siglent's names it among the little-endian models: the self-test at arming tries the other order, too.

Sources: SDG Series Programming Guide PG02-E05B; benchctrl at 0c6e51e (SDG1032X, firmware 1.01.01.33R1B6);
dmm6500-serial-decode at 0465be2 (SDG2122X, firmware 2.01.01.38R4 and 39R7); nacs-lab/pyctrl at cdd5b16 (SDG6022X, firmware
6.01.01.37R6 and 38R3).
"""

import hashlib
import math
import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import InstrumentError, LinkError
from drivers.generators.burst import BurstGenerator
from drivers.generators.capabilities import Capabilities
from drivers.generators.dialect import (
    LEVEL_TOLERANCE_V,
    ConfirmedCommand,
    ExpectedSetting,
    Levels,
    check_readback,
    expect_keyword,
    expect_range,
    expect_value,
)
from drivers.generators.waveform import Points
from drivers.transport import ScpiSession, definite_length_block

T = TypeVar("T")

FULL_SCALE = 32767
WAVEFORM_NAMES = tuple(f"tbench{i}" for i in range(1, 9))
"""Names of the waveforms kept in the instrument."""

LINE_FEED = 0x0A
ANSWER_ATTEMPTS, ANSWER_PATIENCE_S, ATTEMPT_PAUSE_S = 4, 8.0, 0.5
"""Smallest number and duration of a query's repeats while a waveform is being stored; each attempt waits for the reply timeout."""

SELECTION_ATTEMPTS = 6
UPLOAD_BYTES_PER_S, UPLOAD_SETTLE_S = 100e3, 0.12
"""Wait after an upload before the next query, in proportion to its size."""

REPLY_DIGITS = 1e-5
"""Relative accuracy of the numbers in replies, which have six digits."""

NOTHING = "nothing"
"""Placeholder for a parameter missing in a reply."""

DECIMAL_COMMA = re.compile(r",-?\d+,\d+(?:E[+-]?\d+)?(?:HZ|S|V)\b", re.IGNORECASE)
"""A number with a decimal comma in a list of parameters, `OFST,2,5V`."""

COUPLED = "any"
"""Placeholder for any switch of a reply."""


class SiglentSession:
    """Parameters by command and name over the session with a Siglent instrument: queried, set and read back."""

    def __init__(self, scpi: ScpiSession) -> None:
        self.scpi = scpi
        self._unknown: set[str] = set()

    def parameters(self, command: str) -> dict[str, str]:
        """Query the parameters of a command; return them by name."""
        query = f"{'' if command == 'COUP' else 'C1:'}{command}?"
        answer = self.scpi.query(query)
        header = re.match(r"(?:C1:)?([A-Z_]+) ", answer)
        if header is None or header[1] != command:  # another user may have chosen long headers, or none
            self.scpi.link.write("CHDR SHORT")
            answer = self.scpi.query(query)
            header = re.match(r"(?:C1:)?([A-Z_]+) ", answer)
        if header is None or header[1] != command:
            self.scpi.link.clear()
            raise LinkError(
                f"{self.scpi.instrument}: '{query}' was answered by '{answer[:60]}', which is not a list of parameters; "
                f"check the cable at {self.scpi.link.name}, and that its response headers are short (CHDR SHORT)"
            )
        if DECIMAL_COMMA.search(answer):
            raise LinkError(
                f"{self.scpi.instrument}: '{query}' was answered with decimal commas ('{answer[:60]}'); set its number format to a decimal point"
            )
        fields = [field.strip() for field in answer[header.end() :].split(",")]
        if command in ("OUTP", "INVT", "CMBN") and fields[0] != "STATE":
            fields = ["STATE", *fields]
        if command == "MDWV" and "STATE" in fields:  # the type of modulation precedes it, or follows
            return {"STATE": fields[fields.index("STATE") + 1]}
        return dict(zip(fields[::2], fields[1::2], strict=False))

    def setting(self, name: str) -> str:
        """Query a setting by command and parameter, e.g. `BSWV OFST`; a number is returned without its unit."""
        command, _, parameter = name.partition(" ")
        parameters = self.parameters(command)
        if parameter == COUPLED:
            return "ON" if "ON" in parameters.values() else "OFF"
        text = parameters.get(parameter, NOTHING)
        number = re.match(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?(?=[A-Z]*$)", text)
        return number[0] if number else text

    def optional_setting(self, name: str) -> str | None:
        """Query a setting that the model may lack; return None if it does."""
        if name in self._unknown:
            return None
        try:
            answer = self.setting(name)
        except LinkError:
            self.parameters("OUTP")  # it answers, so it does not know the other query
            self._unknown.add(name)
            return None
        return None if answer == NOTHING else answer

    def number(self, name: str) -> float:
        """Query a number by command and parameter."""
        text = self.setting(name)
        try:
            return float(text)
        except ValueError:
            command, _, parameter = name.partition(" ")
            raise LinkError(
                f"{self.scpi.instrument}: 'C1:{command}?' names no {parameter} ('{text[:30]}'); is it in the mode it was set to?"
            ) from None

    def set_number(self, name: str, value: float, tolerance: float) -> None:
        """Set a number and read it back."""
        self.scpi.link.write(number_command(name, value))
        check_readback(self.scpi.instrument, self.number(name), value, tolerance, name)

    def set_keywords(self, command: str, **values: str) -> None:
        """Set keywords and read them back."""
        fields = ",".join(f"{name},{value}" for name, value in values.items())
        self.scpi.link.write(f"C1:{command} {fields.removeprefix('STATE,') if command == 'OUTP' else fields}")
        seen = self.parameters(command)
        for name, value in values.items():
            if seen.get(name) != value:
                raise LinkError(
                    f"{self.scpi.instrument}: {command} {name} was set to {value} and reads back {seen.get(name, 'nothing')}; "
                    "nothing more was sent. Look at the instrument's front panel"
                )

    def send(self, command: str) -> None:
        """Send a command that cannot be confirmed; a query then shows that the instrument still replies."""
        self.scpi.link.write(command)
        self.parameters("OUTP")


class WaveformStore:
    """The waveforms in a Siglent instrument: uploaded, read back, kept and selected by name."""

    def __init__(self, session: SiglentSession, clock: Clock, model: str) -> None:
        self._session, self._clock, self._model = session, clock, model
        self._kept: dict[str, str] = {}  # digests of the waveforms in the instrument by name, the last used one last
        self._is_certain = not model.startswith("SDG6")
        self._byte_order = "little-endian" if self._is_certain else "big-endian"
        self._selects_by_name = True  # an SDG6022X with firmware 6.01.01.37R6 ignores it, one with 38R3 does not

    def byte_order(self, new: str = "") -> str:
        """Set the byte order if `new` is given, and return the present one; empty if the model has only one."""
        if self._is_certain:
            return ""
        if new:
            self._byte_order = new
            self.forget()
        return self._byte_order

    def forget(self) -> None:
        """Forget the waveforms: another program may have overwritten them."""
        self._kept.clear()

    def play(self, points: Points) -> None:
        """Select the waveform of these points, upload it if it is not stored, and check that the levels have not changed."""
        codes = without_line_feeds(np.rint(points * FULL_SCALE).astype(np.int16))
        data = codes.astype(">i2" if self._byte_order == "big-endian" else "<i2").tobytes()
        levels = [self._session.number(f"BSWV {name}") for name in ("FRQ", "AMP", "OFST")]
        # Selecting a waveform may restore the levels stored with it: only a waveform with the present levels is reused.
        digest = hashlib.sha256(data + repr(levels[1:]).encode()).hexdigest()
        name = next((kept for kept, held in self._kept.items() if held == digest), "") if self._selects_by_name else ""
        if name and self._model.startswith("SDG6") and not self._is_selected(name):
            self._selects_by_name, name = False, ""  # uploaded again, which selects it
        if not name:
            name = self._name_to_overwrite()
            self._kept.pop(name, None)
            self._upload(name, data, levels)
        self._kept[name] = self._kept.pop(name, digest)
        self._select(name)
        for setting, level in zip(("BSWV AMP", "BSWV OFST"), levels[1:], strict=True):
            seen = self._session.number(setting)
            check_readback(self._session.scpi.instrument, seen, level, LEVEL_TOLERANCE_V, setting)

    def _name_to_overwrite(self) -> str:
        """Return a name that is not on the output: a free one, or the least recently used one."""
        selected = self._selected_name()
        names = [name for name in WAVEFORM_NAMES if name not in self._kept] + list(self._kept)
        return next(name for name in names if name != selected)

    def _upload(self, name: str, data: bytes, levels: Sequence[float]) -> None:
        """Store a waveform and read it back; it is selected on arrival."""
        hertz, vpp, offset = levels
        # A header with levels works on an SDG1032X, one without on an SDG2122X, but neither on the other model.
        brought = f"FREQ,{hertz:.10g},AMPL,{vpp:.6g},OFST,{offset:.6g},PHASE,0,"
        block = data.decode("latin-1")
        if self._model.startswith("SDG2"):
            brought = ""
        elif self._model.startswith("SDG6"):
            brought = f"WVTP,USER,AMPL,{vpp:.6g},OFST,{offset:.6g},FREQ,{hertz:.10g},"
            block = definite_length_block(data)
        scpi = self._session.scpi
        scpi.link.write(f"C1:WVDT WVNM,{name},{brought}WAVEDATA,{block}")
        self._clock.sleep(UPLOAD_SETTLE_S + len(data) / UPLOAD_BYTES_PER_S)
        stored = self._repeat_until_answered(lambda: scpi.query_block(f"WVDT? USER,{name}", b"WAVEDATA,", _block_size))
        if stored != data:
            raise InstrumentError(
                f"{scpi.instrument}: the waveform {name} reads back with {len(stored)} bytes in place of the {len(data)} that "
                "were sent, or with others; it was not played. Use its LAN port (TCPIP::...::5025::SOCKET)"
            )

    def _is_selected(self, name: str) -> bool:
        """Select a stored waveform and return the success; a selection without effect is sent again."""
        for _ in range(SELECTION_ATTEMPTS):
            if self._repeat_until_answered(self._selected_name) == name:
                return True
            self._session.scpi.link.write(f"C1:ARWV NAME,{name}")  # bare: a quoted name is ignored
            self._clock.sleep(UPLOAD_SETTLE_S)
        return self._repeat_until_answered(self._selected_name) == name

    def _select(self, name: str) -> None:
        if not self._is_selected(name):
            raise InstrumentError(
                f"{self._session.scpi.instrument}: the waveform {name} was selected {SELECTION_ATTEMPTS} times and is not; nothing was "
                "played. Look at the instrument's front panel"
            )

    def _selected_name(self) -> str:
        return self._session.parameters("ARWV").get("NAME", "").removesuffix(".bin")

    def _repeat_until_answered(self, query: Callable[[], T]) -> T:
        """Repeat a query that the instrument does not answer while it stores a waveform."""
        begin_s, attempts = self._clock.now(), 0
        while True:
            try:
                return query()
            except LinkError:
                attempts += 1
                if attempts >= ANSWER_ATTEMPTS and self._clock.now() - begin_s > ANSWER_PATIENCE_S:
                    raise
                self._clock.sleep(ATTEMPT_PAUSE_S)


class SiglentDialect:
    """An SDG keeps one amplitude and carries every drive in the points of its waveform."""

    capabilities: ClassVar[Capabilities] = Capabilities(
        models=r"SDG[126]|T3AFG(?!(5|10)$)",
        product_names="Siglent SDG1000X, SDG2000X and SDG6000X",
        holds_range=False,
        single_session=True,
        joins_commands=False,
        usb_problem="a Siglent generator loses uploaded waveforms on USB without an error. Connect its LAN port and "
        "give its address as the resource, TCPIP::...::5025::SOCKET",
        models_without_usb_problem="SDG6",
    )

    def __init__(self, scpi: ScpiSession, clock: Clock, model: str) -> None:
        self._model = model.upper()
        self._session = SiglentSession(scpi)
        self._waveforms = WaveformStore(self._session, clock, self._model)

    @property
    def max_points(self) -> int:
        return 32_000 if self._model.startswith(("SDG2", "SDG6")) else 16_384

    def query_setting(self, name: str) -> str:
        return self._session.setting(name)

    def query_optional_setting(self, name: str) -> str | None:
        return self._session.optional_setting(name)

    def download_waveform(self, points: Points) -> None:
        self._waveforms.play(points)

    def forget_waveforms(self) -> None:
        self._waveforms.forget()

    def byte_order(self, new: str = "") -> str:
        return self._waveforms.byte_order(new)

    def expected_settings(self, levels: Levels) -> Iterable[ExpectedSetting]:
        yield from (
            expect_keyword("OUTP LOAD", "HZ"),
            expect_keyword("OUTP PLRT", "NOR"),
            *(expect_keyword(name, *values, optional=True) for name, values, _ in self._foreign_settings()),
            expect_keyword("BSWV WVTP", "ARB"),
            expect_value("BSWV OFST", levels.rest_v),
            expect_value("BSWV AMP", levels.span_v),
            expect_keyword("BTWV STATE", "ON"),
            expect_keyword("BTWV GATE_NCYC", "NCYC"),
            expect_keyword("BTWV TRSR", "MAN"),
            expect_value("BTWV STPS", 0.0, 1e-3),
            expect_range("BTWV TIME", 1, self.capabilities.max_burst_cycles),
            ExpectedSetting("BTWV DLAY", low=0.0, high=1e-6, optional=True),
        )

    def _foreign_settings(self) -> Iterable[tuple[str, tuple[str, ...], Sequence[str]]]:
        """Yield persistent settings of other users: name, neutral values, and the commands that restore them."""
        is_sdg1000 = not self._model.startswith(("SDG2", "SDG6"))
        yield "INVT STATE", ("OFF",), ("C1:INVT OFF",)
        yield "CMBN STATE", ("OFF",), ("C1:CMBN OFF",)
        names = (*(() if is_sdg1000 else ("STATE",)), "TRACE", "FCOUP", "PCOUP", "ACOUP")
        yield f"COUP {COUPLED}", ("OFF",), [f"COUP {name},OFF" for name in names]
        yield "SWWV STATE", ("OFF",), ("C1:SWWV STATE,OFF",)
        yield "MDWV STATE", ("OFF",), ("C1:MDWV STATE,OFF",)
        if not is_sdg1000:
            yield "NOISE_ADD STATE", ("OFF",), ("C1:NOISE_ADD STATE,OFF",)
            yield "SRATE MODE", ("DDS",), ("C1:SRATE MODE,DDS",)

    def reset_foreign_settings(self) -> None:
        self._session.set_keywords("OUTP", PLRT="NOR")
        for name, neutral, commands in self._foreign_settings():
            answer = self.query_optional_setting(name)
            if answer is not None and answer not in neutral:
                for command in commands:
                    self._session.send(command)

    def set_up(self, levels: Levels) -> None:
        self._session.set_keywords("OUTP", LOAD="HZ")
        self._session.set_keywords("OUTP", PLRT="NOR")
        self._session.set_keywords("BSWV", WVTP="ARB")
        self._session.set_number("BSWV AMP", 0.1, 1e-3)
        self._session.set_keywords("BTWV", STATE="OFF")
        self._session.set_number("BSWV OFST", levels.rest_v, 1e-3)

    def arm(self, levels: Levels) -> None:
        self._session.set_keywords("BTWV", STATE="ON")
        self._session.set_keywords("BTWV", GATE_NCYC="NCYC", TRSR="MAN")
        self._session.set_number("BTWV STPS", 0, 1e-3)
        self._session.scpi.link.write(number_command("BTWV DLAY", 0))
        self.set_cycles(1)
        self._session.set_number("BSWV AMP", levels.span_v, 1e-3)

    def is_output_on(self) -> bool:
        return self.query_setting("OUTP STATE") == "ON"

    def enable_output(self) -> None:
        self._session.set_keywords("OUTP", STATE="ON")

    def clear_errors(self) -> None:
        """Do nothing: this instrument has no error queue."""

    def idle_level_v(self) -> float:
        return self._session.number("BSWV OFST")

    def offset_command(self, volts: float) -> ConfirmedCommand:
        return self._level_command("BSWV OFST", volts)

    def amplitude_vpp(self) -> float:
        return self._session.number("BSWV AMP")

    def amplitude_command(self, vpp: float) -> ConfirmedCommand:
        return self._level_command("BSWV AMP", vpp)

    def _level_command(self, name: str, volts: float) -> ConfirmedCommand:
        return ConfirmedCommand(number_command(name, volts), partial(self._session.set_number, name, volts, 1e-3))

    def set_rate(self, rate_hz: float, point_count: int) -> None:
        del point_count  # the rate is in whole periods
        self._session.set_number("BSWV FRQ", rate_hz, REPLY_DIGITS * rate_hz + 1e-6)

    def set_cycles(self, cycles: int) -> None:
        self._session.set_number("BTWV TIME", cycles, 0.5)

    def burst_duration_s(self) -> float:
        if self.query_setting("BTWV STATE") != "ON":
            return 0.0
        cycles = self.query_setting("BTWV TIME")
        return math.inf if cycles == "INF" else float(cycles) / self._session.number("BSWV FRQ")

    def trigger(self) -> None:
        self._session.send("C1:BTWV MTRIG")

    def abort_commands(self) -> Sequence[ConfirmedCommand]:
        texts = ("C1:BTWV STATE,OFF", "C1:BTWV STATE,ON")
        return [ConfirmedCommand(text, partial(self._session.send, text)) for text in texts]


class SiglentSdg(BurstGenerator):
    """Driver of the Siglent SDG1000X, SDG2000X and SDG6000X, and of the Teledyne T3AFG."""

    dialect_type = SiglentDialect


DRIVERS = {"siglent-sdg": SiglentSdg}


def number_command(name: str, value: float) -> str:
    """Return the command that sets a number, e.g. of `BSWV OFST`."""
    command, _, parameter = name.partition(" ")
    return f"C1:{command} {parameter},{value:.10g}"


def without_line_feeds(codes: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return the codes without a byte 0x0A: changed by one, or to the nearest code outside 2560 to 2815."""
    moved = codes.astype(np.int32)
    in_high_byte = (moved >> 8) == LINE_FEED
    moved[in_high_byte] = np.where(
        moved[in_high_byte] < (LINE_FEED << 8) + 128, (LINE_FEED << 8) - 1, (LINE_FEED + 1) << 8
    )
    moved[(moved & 0xFF) == LINE_FEED] += 1
    return moved.astype(np.int16)


def _block_size(header: str) -> int:
    """Return the number of bytes that a `WVDT?` header announces."""
    size = re.search(r"LENGTH\s*,\s*(\d+)\s*(K?)B", header, re.IGNORECASE)
    if size is None:
        raise LinkError(f"a waveform's header without its length: '{header[:60]}'")
    return int(size[1]) * (1024 if size[2] else 1)
