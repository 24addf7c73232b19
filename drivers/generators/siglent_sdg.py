"""Siglent SDG1000X, SDG2000X and SDG6000X function generators (also sold as Teledyne T3AFG).

Not SCPI: parameters come in pairs (`C1:BSWV OFST,2.5`), replies carry the header and units, and there is no error queue: a
value that the instrument cannot do is clipped silently. So every setting is read back, and a different value is an error.
Burst mode must be on before its other parameters are accepted.

A waveform is uploaded as bare bytes in a line, so that no byte of it may be 0x0A, which would end the message. It is selected
as soon as it has arrived, is silent about it for seconds, and a selection may have to be repeated. Waveforms are read back
before they are played, are kept in the instrument and selected again, and stay below 64 kB: several larger ones hang the
instrument's remote and panel with its output running. Over USB uploads are lost without a word. One connection is served.

Sources: SDG Series Programming Guide PG02-E05B; benchctrl at 0c6e51e (SDG1032X, firmware 1.01.01.33R1B6);
dmm6500-serial-decode at 0465be2 (SDG2122X, firmware 2.01.01.38R4 and 39R7).
"""

import hashlib
import math
import re
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.errors import InstrumentError, LinkError
from drivers.generators.arbitrary_waveform import SINE_CYCLE, Points
from drivers.generators.burst_generator import LEVEL_TOLERANCE_V, BurstGenerator
from drivers.generators.expected_setting import ExpectedSetting, expect_keyword, expect_range, expect_value
from drivers.transport.scpi import Link

T = TypeVar("T")

FULL_SCALE = 32767
WAVEFORM_NAMES = tuple(f"tbench{i}" for i in range(1, 9))
"""Names of the waveforms that are kept in the instrument."""

LINE_FEED = 0x0A
ANSWER_ATTEMPTS, ANSWER_PATIENCE_S, ATTEMPT_PAUSE_S = 4, 8.0, 0.5
"""How often and how long a query is repeated at least while a waveform is taken in; each attempt waits for the reply timeout."""

SELECTION_ATTEMPTS = 6
UPLOAD_BYTES_PER_S, UPLOAD_SETTLE_S = 100e3, 0.12
"""Wait after an upload before the next query, in proportion to its size."""

REPLY_DIGITS = 1e-5
"""Relative accuracy of the numbers in replies, which have six digits."""


class SiglentSdg(BurstGenerator):
    """A `Source` that keeps one amplitude and carries every drive in the points of its waveform."""

    MODELS = ("SDG1", "SDG2", "SDG6", "T3AFG")
    MODEL_PATTERN = r"SDG|T3AFG(?!(5|10)$)"
    PRODUCT_NAMES = "Siglent SDG1000X, SDG2000X and SDG6000X"
    CAN_FREEZE_RANGE = False
    SINGLE_SESSION = True

    def __init__(self, link: Link, clock: Clock, *, step_v: float = 0.05, step_interval_s: float = 0.002) -> None:
        if link.name.upper().startswith("USB"):
            link.close()
            raise InstrumentError(
                f"{link.name}: a Siglent generator loses uploaded waveforms on USB without an error. Connect its LAN port and "
                "give its address as the resource, TCPIP::...::5025::SOCKET"
            )
        super().__init__(link, clock, step_v=step_v, step_interval_s=step_interval_s)
        self._kept: dict[str, str] = {}  # digests of the waveforms in the instrument by name, the last used one last
        self._unknown: frozenset[str] = frozenset()
        self._selects_by_name = True  # an SDG6022X with firmware 6.01.01.37R6 ignores it, one with 38R3 does not

    def reconnect(self) -> None:
        super().reconnect()
        self._kept.clear()

    def is_at_rest(self, rest_v: float, low_v: float, high_v: float) -> bool:
        self._kept.clear()  # another program may have overwritten them
        return super().is_at_rest(rest_v, low_v, high_v)

    def idle_level_v(self) -> float:
        return self._query_number("BSWV", "OFST")

    @property
    def _is_sdg1000(self) -> bool:
        return not self.identity.model.upper().startswith(("SDG2", "SDG6"))

    def _query_parameters(self, command: str) -> dict[str, str]:
        """Return the parameters of a reply by name."""
        query = f"{_full_header(command)}?"
        answer = self._scpi.query(query)
        header = re.match(r"(?:C1:)?([A-Z]+) ", answer)
        if header is None or header[1] != command:
            self._scpi.link.clear()
            raise LinkError(
                f"{self._scpi.instrument}: '{query}' was answered by '{answer[:60]}', which is not a list of parameters; "
                f"check the cable at {self._scpi.link.name}"
            )
        fields = [field.strip() for field in answer[header.end() :].split(",")]
        if command in ("OUTP", "INVT", "CMBN") and fields[0] != "STATE":
            fields = ["STATE", *fields]
        if command == "MDWV" and "STATE" in fields:  # the type of modulation precedes it, or follows
            return {"STATE": fields[fields.index("STATE") + 1]}
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
        parameters = self._query_parameters(command)
        if parameter == COUPLED:
            return "ON" if "ON" in parameters.values() else "OFF"
        text = parameters.get(parameter, NOTHING)
        number = re.match(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?(?=[A-Z]*$)", text)
        return number[0] if number else text

    def _query_optional_setting(self, name: str) -> str | None:
        if name in self._unknown:
            return None
        try:
            answer = self._query_setting(name)
        except LinkError:
            self._query_parameters("OUTP")  # it answers, so that it does not know the other query
            self._unknown |= {name}
            return None
        return None if answer == NOTHING else answer

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
        yield from (
            expect_keyword("OUTP LOAD", "HZ"),
            expect_keyword("OUTP PLRT", "NOR"),
            *(expect_keyword(name, *values, optional=True) for name, values, _ in self._foreign_settings()),
            expect_keyword("BSWV WVTP", "ARB"),
            expect_value("BSWV OFST", rest_v, LEVEL_TOLERANCE_V),
            expect_value("BSWV AMP", high_v - low_v, LEVEL_TOLERANCE_V),
            expect_keyword("BTWV STATE", "ON"),
            expect_keyword("BTWV GATE_NCYC", "NCYC"),
            expect_keyword("BTWV TRSR", "MAN"),
            expect_value("BTWV STPS", 0.0, 1e-3),
            expect_range("BTWV TIME", 1, self.MAX_BURST_CYCLES),
            ExpectedSetting("BTWV DLAY", low=0.0, high=1e-6, optional=True),
        )

    def _foreign_settings(self) -> Iterable[tuple[str, tuple[str, ...], Sequence[str]]]:
        """Yield settings of other users that persist: name, neutral values, and the commands that restore them."""
        yield "INVT STATE", ("OFF",), ("C1:INVT OFF",)
        yield "CMBN STATE", ("OFF",), ("C1:CMBN OFF",)
        names = (
            ("TRACE", "FCOUP", "PCOUP", "ACOUP") if self._is_sdg1000 else ("STATE", "TRACE", "FCOUP", "PCOUP", "ACOUP")
        )
        yield f"COUP {COUPLED}", ("OFF",), [f"COUP {name},OFF" for name in names]
        yield "SWWV STATE", ("OFF",), ("C1:SWWV STATE,OFF",)
        yield "MDWV STATE", ("OFF",), ("C1:MDWV STATE,OFF",)
        if not self._is_sdg1000:
            yield "SRATE MODE", ("DDS",), ("C1:SRATE MODE,DDS",)

    def _reset_foreign_settings(self) -> None:
        self._set_keywords("OUTP", PLRT="NOR")
        for name, neutral, commands in self._foreign_settings():
            answer = self._query_optional_setting(name)
            if answer is not None and answer not in neutral:
                for command in commands:
                    self._send(command)

    def _is_output_on(self) -> bool:
        return self._query_setting("OUTP STATE") == "ON"

    def _clear_error_queue(self) -> None:
        """Do nothing: this instrument has no error queue."""

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
        self._scpi.link.write(_parameter_command("BTWV", "DLAY", 0))
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
        self._set_number("BSWV", "FRQ", rate_hz, REPLY_DIGITS * rate_hz + 1e-6)

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
        codes = without_line_feeds(np.rint(points * FULL_SCALE).astype("<i2"))
        data = codes.tobytes()
        levels = [self._query_number("BSWV", name) for name in ("FRQ", "AMP", "OFST")]
        # Selecting a waveform may restore the levels that it was stored with: only one that has the present ones is used again.
        digest = hashlib.sha256(data + repr(levels[1:]).encode()).hexdigest()
        name = next((kept for kept, held in self._kept.items() if held == digest), "") if self._selects_by_name else ""
        if name and self.identity.model.upper().startswith("SDG6") and not self._is_selected(name):
            self._selects_by_name, name = False, ""  # it is uploaded again, which selects it
        if not name:
            name = self._name_to_overwrite()
            self._kept.pop(name, None)
            self._upload(name, data, levels)
        self._kept[name] = self._kept.pop(name, digest)
        self._select(name)
        for setting, level in zip(("AMP", "OFST"), levels[1:], strict=True):
            self._check_readback(self._query_number("BSWV", setting), level, LEVEL_TOLERANCE_V, f"BSWV {setting}")

    def _name_to_overwrite(self) -> str:
        """Return a name that is not on the output: a free one, or the one that was not used for longest."""
        selected = self._selected_name()
        names = [name for name in WAVEFORM_NAMES if name not in self._kept] + list(self._kept)
        return next(name for name in names if name != selected)

    def _upload(self, name: str, data: bytes, levels: Sequence[float]) -> None:
        """Store a waveform and read it back; it is selected as soon as it has arrived."""
        hertz, vpp, offset = levels
        # A header with levels was seen to work on an SDG1032X, one without on an SDG2122X, each not to work on the other.
        # On an SDG6022X a public driver sends levels, too.
        bare = self.identity.model.upper().startswith("SDG2")
        brought = "" if bare else f"FREQ,{hertz:.10g},AMPL,{vpp:.6g},OFST,{offset:.6g},PHASE,0,"
        self._scpi.link.write(f"C1:WVDT WVNM,{name},{brought}WAVEDATA,{data.decode('latin-1')}")
        self._clock.sleep(UPLOAD_SETTLE_S + len(data) / UPLOAD_BYTES_PER_S)
        stored = self._repeat_until_answered(
            lambda: self._scpi.query_block(f"WVDT? USER,{name}", b"WAVEDATA,", _block_size)
        )
        if stored != data:
            raise InstrumentError(
                f"{self._scpi.instrument}: the waveform {name} reads back with {len(stored)} bytes in place of the {len(data)} that "
                "were sent, or with others; it was not played. Use its LAN port (TCPIP::...::5025::SOCKET)"
            )

    def _is_selected(self, name: str) -> bool:
        """Select a stored waveform, and return whether it is; a selection that did not take is sent again."""
        for _ in range(SELECTION_ATTEMPTS):
            if self._repeat_until_answered(self._selected_name) == name:
                return True
            self._scpi.link.write(f"C1:ARWV NAME,{name}")  # bare: a quoted name is ignored
            self._clock.sleep(UPLOAD_SETTLE_S)
        return self._repeat_until_answered(self._selected_name) == name

    def _select(self, name: str) -> None:
        if not self._is_selected(name):
            raise InstrumentError(
                f"{self._scpi.instrument}: the waveform {name} was selected {SELECTION_ATTEMPTS} times and is not; nothing was "
                "played. Look at the instrument's front panel"
            )

    def _selected_name(self) -> str:
        return self._query_parameters("ARWV").get("NAME", "").removesuffix(".bin")

    def _repeat_until_answered(self, query: Callable[[], T]) -> T:
        """Repeat a query that the instrument does not answer while it takes a waveform in."""
        begin_s, attempts = self._clock.now(), 0
        while True:
            try:
                return query()
            except LinkError:
                attempts += 1
                if attempts >= ANSWER_ATTEMPTS and self._clock.now() - begin_s > ANSWER_PATIENCE_S:
                    raise
                self._clock.sleep(ATTEMPT_PAUSE_S)

    def _max_points(self) -> int:
        return max_points(self.identity.model)


def max_points(model: str) -> int:
    """Return the longest waveform of a model."""
    return 32_000 if model.upper().startswith(("SDG2", "SDG6")) else 16_384


NOTHING = "nothing"
"""In place of a parameter that a reply does not have."""

COUPLED = "any"
"""Stands for any of the switches of a reply."""


def without_line_feeds(codes: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return the codes with none of their bytes 0x0A: moved by one, or to the nearest code outside 2560 to 2815."""
    moved = codes.astype(np.int32)
    in_high_byte = (moved >> 8) == LINE_FEED
    moved[in_high_byte] = np.where(
        moved[in_high_byte] < (LINE_FEED << 8) + 128, (LINE_FEED << 8) - 1, (LINE_FEED + 1) << 8
    )
    moved[(moved & 0xFF) == LINE_FEED] += 1
    return moved.astype("<i2")


def _full_header(command: str) -> str:
    return command if command == "COUP" else f"C1:{command}"


def _block_size(header: str) -> int:
    """Return the number of bytes that a `WVDT?` header announces."""
    size = re.search(r"LENGTH\s*,\s*(\d+)\s*(K?)B", header, re.IGNORECASE)
    if size is None:
        raise LinkError(f"a waveform's header without its length: '{header[:60]}'")
    return int(size[1]) * (1024 if size[2] else 1)


def _parameter_command(command: str, name: str, value: float) -> str:
    return f"C1:{command} {name},{value:.10g}"
