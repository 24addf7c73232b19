"""A simulated Keysight 33511B function generator, written from the public "33500 Series Operating and
Service Guide" alone ("the guide" below).  It shares no code with any other simulator or driver.
`Box.message` executes one SCPI message, `Box.output` gives the open output's volts as a function of time.
Volts are held inside as volts of the OPEN output; what a message says is scaled by OUTPut:LOAD."""

import re
from collections.abc import Callable

import numpy as np

INF = float("inf")
ON_OFF, FUNCTIONS = "ON|OFF", "SINusoid|SQUare|TRIangle|RAMP|PULSe|PRBS|NOISe|ARBitrary|DC"
# Settings: header pattern -> (kind, value after *RST, range or keywords).  Kinds: n number with range, v volts,
# b switch, k keyword, i integer, q quoted text.  [..] in a pattern may be left out, capitals are the short form.
PATTERNS = {
    "FUNCtion[:SHAPe]": ("k", "SIN", FUNCTIONS),
    "FUNCtion[:SHAPe]:ARBitrary:SRATe": ("n", 40e3, (1e-6, 160e6)),
    "FUNCtion[:SHAPe]:ARBitrary:ADVance": ("k", "SRAT", "TRIGger|SRATe"),
    "FUNCtion[:SHAPe]:ARBitrary:FILTer": ("k", "STEP", "NORMal|STEP|OFF"),
    "FUNCtion[:SHAPe]:SQUare:DCYCle": ("n", 50.0, (0.01, 99.99)),
    "FUNCtion[:SHAPe]:RAMP:SYMMetry": ("n", 100.0, (0.0, 100.0)),
    "FUNCtion[:SHAPe]:PULSe:WIDTh": ("n", 100e-6, (16e-9, 1e6)),
    "FUNCtion[:SHAPe]:NOISe:BANDwidth": ("n", 100e3, (1e-3, 20e6)),
    "FUNCtion[:SHAPe]:PRBS:BRATe": ("n", 1e3, (1e-3, 50e6)),
    "FREQuency[:CW]": ("n", 1e3, (1e-6, 20e6)),
    "FREQuency:MODE": ("k", "CW", "CW|FIXed|SWEep|LIST"),
    "FREQuency:STARt": ("n", 100.0, (1e-6, 20e6)),
    "FREQuency:STOP": ("n", 1e3, (1e-6, 20e6)),
    "VOLTage[:LEVel][:IMMediate][:AMPLitude]": ("v", 0.2, (0.002, 20.0)),
    "VOLTage[:LEVel][:IMMediate]:OFFSet": ("v", 0.0, (-10.0, 10.0)),
    "VOLTage:LIMit:HIGH": ("v", 10.0, (-10.0, 10.0)),
    "VOLTage:LIMit:LOW": ("v", -10.0, (-10.0, 10.0)),
    "VOLTage:UNIT": ("k", "VPP", "VPP|VRMS|DBM"),
    "VOLTage:RANGe:AUTO": ("k", "1", "ON|OFF|ONCE|1|0"),
    "PHASe[:ADJust]": ("n", 0.0, (-360.0, 360.0)),
    "UNIT:ANGLe": ("k", "DEG", "DEGree|RADian|SECond"),
    "OUTPut:LOAD": ("n", 50.0, (1.0, 1e4)),
    "OUTPut:POLarity": ("k", "NORM", "NORMal|INVerted"),
    "OUTPut:MODE": ("k", "NORM", "NORMal|GATed"),
    "OUTPut:SYNC[:STATe]": ("b", 1, ON_OFF),
    "OUTPut:SYNC:MODE": ("k", "NORM", "NORMal|CARRier|MARKer"),
    "OUTPut:SYNC:POLarity": ("k", "NORM", "NORMal|INVerted"),
    "OUTPut:SYNC:SOURce": ("k", "CH1", "CH1"),
    "OUTPut:TRIGger:SLOPe": ("k", "POS", "POSitive|NEGative"),
    "OUTPut:TRIGger:SOURce": ("k", "CH1", "CH1"),
    "BURSt:NCYCles": ("n", 1.0, (1.0, 1e8)),
    "BURSt:MODE": ("k", "TRIG", "TRIGgered|GATed"),
    "BURSt:PHASe": ("n", 0.0, (-360.0, 360.0)),
    "BURSt:INTernal:PERiod": ("n", 0.01, (1e-6, 8000.0)),
    "BURSt:GATE:POLarity": ("k", "NORM", "NORMal|INVerted"),
    "TRIGger:SOURce": ("k", "IMM", "IMMediate|EXTernal|TIMer|BUS"),
    "TRIGger:DELay": ("n", 0.0, (0.0, 1000.0)),
    "TRIGger:COUNt": ("n", 1.0, (1.0, 1e6)),
    "TRIGger:TIMer": ("n", 1.0, (1e-6, 8000.0)),
    "TRIGger:SLOPe": ("k", "POS", "POSitive|NEGative"),
    "TRIGger:LEVel": ("n", 1.65, (0.9, 3.8)),
    "INITiate:CONTinuous": ("b", 1, ON_OFF),
    "SUM:AMPLitude": ("n", 0.1, (0.0, 100.0)),
    "SUM:SOURce": ("k", "INT", "INTernal|CH1|CH2|EXTernal"),
    "SUM:INTernal:FREQuency": ("n", 100.0, (1e-6, 20e6)),
    "SWEep:TIME": ("n", 1.0, (1e-3, 8000.0)),
    "SUM:INTernal:FUNCtion": ("k", "SIN", "SINusoid|SQUare|RAMP|NRAMp|TRIangle|NOISe|PRBS|ARBitrary"),
    "COMBine:FEED": ("k", "NONE", "NONE|CH1|CH2"),
    "ROSCillator:SOURce": ("k", "INT", "INTernal|EXTernal"),
    "ROSCillator:SOURce:AUTO": ("b", 1, ON_OFF),
    "FORMat:BORDer": ("k", "NORM", "NORMal|SWAPped"),
    "DISPlay[:STATe]": ("b", 1, ON_OFF),
    "DISPlay:TEXT[:DATA]": ("q", "", ""),
    "SYSTem:BEEPer:STATe": ("b", 1, ON_OFF),
    "*ESE": ("i", 0, (0, 255)),
    "*SRE": ("i", 0, (0, 255)),
    **dict.fromkeys(
        [
            "FREQuency:COUPle[:STATe]",
            "RATE:COUPle[:STATe]",
            "VOLTage:LIMit:STATe",
            "VOLTage:COUPle[:STATe]",
            "OUTPut[:STATe]",
            "OUTPut:TRIGger[:STATe]",
            "BURSt:STATe",
            "AM:STATe",
            "FM:STATe",
            "PM:STATe",
            "FSKey:STATe",
            "BPSK:STATe",
            "PWM:STATe",
            "SUM:STATe",
            "SWEep:STATe",
            "LIST:STATe",
            "FREQuency:SWEep:STATe",
        ],
        ("b", 0, ON_OFF),
    ),
}
# Headers that do something, or are computed from the settings; Box.action has what they do.
ACTIONS = [
    "*RST",
    "*CLS",
    "*OPC",
    "*TRG",
    "*ESR",
    "*STB",
    "SYSTem:ERRor[:NEXT]",
    "APPLy[:{f}]",
    "FUNCtion[:SHAPe]:ARBitrary",
    "TRIGger[:IMMediate]",
    "FUNCtion[:SHAPe]:ARBitrary:FREQuency",
    "FUNCtion[:SHAPe]:ARBitrary:PERiod",
    "FUNCtion[:SHAPe]:ARBitrary:PTPeak",
    "VOLTage[:LEVel][:IMMediate]:HIGH",
    "VOLTage[:LEVel][:IMMediate]:LOW",
    "INITiate[:IMMediate][:ALL]",
    "ABORt",
    "DATA:VOLatile:CLEar",
    "DATA:VOLatile:CATalog",
    "DATA:VOLatile:FREE",
    "DATA:ARBitrary",
    "DATA:ARBitrary:DAC",
    "DATA:ATTRibute:POINts",
    "DATA:SEQuence",
    "PHASe:SYNChronize",
    "DISPlay:TEXT:CLEar",
]
# Queries with a fixed reply, and commands without an effect here ("").
FIXED = {
    "*IDN?": "Agilent Technologies,33511B,MY57000007,5.03-3.03-2.15-52-00",
    "*WAI": "",
    "*TST?": "+0",
    "SYSTem:VERSion?": "1999.0",
    "SYSTem:BEEPer[:IMMediate]": "",
    "SYSTem:LOCal": "",
    "SYSTem:REMote": "",
    "SYSTem:RWLock": "",
    "SYSTem:COMMunicate:LAN:IPADdress?": '"192.0.2.11"',
    "SYSTem:COMMunicate:LAN:HOSTname?": '"K-33511B-00007"',
    "MMEMory:CATalog[:ALL]?": "+0,+1000000000",
    "MMEMory:CATalog:DATA:ARBitrary?": "+0,+1000000000",
}
TEXTS = {
    -113: "Undefined header",
    -109: "Missing parameter",
    -108: "Parameter not allowed",
    -131: "Invalid suffix",
    -104: "Data type error",
    -161: "Invalid block data",
    -211: "Trigger ignored",
    -221: "Settings conflict",
    -222: "Data out of range",
    -224: "Illegal parameter value",
    -225: "Out of memory",
    -350: "Queue overflow",
    785: "Specified arb waveform does not exist",
    786: "Specified arb waveform already exists",
}
MEMORY, SHORTEST = 1_000_000, 8  # points of a waveform without the memory option, and the fewest the guide allows
EXP_RISE = "INT:\\BUILTIN\\EXP_RISE.ARB"  # the one waveform that is always loaded

COMMAND_ONLY = {
    "*RST",
    "*CLS",
    "*TRG",
    "TRIGger",
    "INITiate",
    "ABORt",
    "DATA:VOLatile:CLEar",
    "DATA:ARBitrary",
    "DATA:ARBitrary:DAC",
    "DATA:SEQuence",
    "PHASe:SYNChronize",
    "DISPlay:TEXT:CLEar",
}
QUERY_ONLY = {"*ESR", "*STB", "SYSTem:ERRor", "DATA:VOLatile:CATalog", "DATA:VOLatile:FREE", "DATA:ATTRibute:POINts"}


class ScpiError(Exception):
    """An error for the queue; the command that raised it has no effect."""


def header_regex(pattern: str) -> re.Pattern[str]:
    """The guide's header notation as a regular expression (long or short form, channel 1 only)."""

    def node(m: re.Match[str]) -> str:
        words = [f"{re.match('[^a-z]*', w)[0]}|{w.upper()}" for w in m[0].split("~")]
        return "(?:" + "|".join(words).replace("*", r"\*") + ")1?"

    text = pattern.replace("[", "\0").replace("]", "\1").replace("{f}", FUNCTIONS.replace("|", "~"))
    text = re.sub(r"[*\w~]+", node, text).replace("\0", "(?:").replace("\1", ")?")
    return re.compile("(?:SOUR(?:CE)?1?:)?" + text)


def shortest(pattern: str) -> str:
    """A pattern without what may be left out; the name of a setting or action from here on."""
    return re.sub(r"\[.*?\]", "", pattern)


TABLE = {shortest(p): v for p, v in PATTERNS.items()}
HEADERS = [(header_regex(p.rstrip("?")), shortest(p)) for p in (*PATTERNS, *ACTIONS, *FIXED)]
REPLIES = {shortest(p): reply for p, reply in FIXED.items()}


def split(text: str) -> list[tuple[str, list]]:
    """A message's commands: (header, parameters), a binary block as bytes; `;` and `,` in quotes or blocks kept."""
    commands, current, at = [], [""], 0

    def finish() -> None:
        head, _, first = current[0].strip().partition(" ")
        if head:
            rest = [c if isinstance(c, bytes) else c.strip() for c in [first, *current[1:]]]
            block_only = len(rest) > 1 and rest[0] == "" and isinstance(rest[1], bytes)
            commands.append((head, rest[1:] if block_only or rest == [""] else rest))

    while at < len(text):
        block = re.compile(r"#(\d)").match(text, at)
        if block:
            begin = at + 2 + int(block[1])
            size = text[at + 2 : begin]
            end = begin + int(size) if size.isdigit() else len(text)
            if end > len(text):
                raise ScpiError(-161)
            if len(current) == 1:  # the header's only parameter
                current.append("")
            current[-1] = text[begin:end].encode("latin-1")
            at = end
            continue
        token = re.compile(r"\"[^\"]*\"|'[^']*'|[;,\n]|[^#\"';,\n]+|.", re.S).match(text, at)[0]
        at += len(token)
        if token in (";", "\n"):
            finish()
            current = [""]
        elif token == ",":
            current.append("")
        elif isinstance(current[-1], str):
            current[-1] += token.replace("\t", " ").replace("\r", " ")
    finish()
    return commands


def number(text: str) -> float:
    """A decimal number with an optional unit (`2.5 kHz`, `10 MVPP`, `INF`)."""
    m = re.fullmatch(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:E[+-]?\d+)?)\s*([A-Z%/]*)", text.upper())
    if text.upper() in ("INF", "INFINITY"):
        return INF
    if not m:
        raise ScpiError(-224)
    unit = re.fullmatch(r"(MA|[GKMUNP]?)(HZ|S|SEC|V|VPP|VRMS|OHM|DEG|RAD|PCT|%|DBM|SA/S|)", m[2])
    if not unit:
        raise ScpiError(-131)
    scale = {"": 1, "MA": 1e6, "G": 1e9, "K": 1e3, "M": 1e-3, "U": 1e-6, "N": 1e-9, "P": 1e-12}[unit[1]]
    value = float(m[1]) * (1e6 if unit[1] == "M" and unit[2] in ("HZ", "OHM", "SA/S") else scale)
    return INF if value >= 9.9e37 else value


def keyword(text: str, words: str) -> str:
    """The short form of the keyword that `text` names."""
    for word in words.split("|"):
        short = re.match("[^a-z]*", word)[0]
        if text.upper() in (short, word.upper()):
            return short
    raise ScpiError(-224)


def nr3(value: float) -> str:
    """A number as the instrument answers it."""
    return f"{9.9e37 if value == INF else value:+.14E}"


def shape(s: dict, points: np.ndarray, rate: float) -> Callable[[np.ndarray], np.ndarray]:
    """The selected function's value (-1..1) over cycles (noise and PRBS: over samples)."""
    func = s["FUNCtion"]
    duty = s["FUNCtion:SQUare:DCYCle"] / 100 if func == "SQU" else s["FUNCtion:PULSe:WIDTh"] * rate
    rise = 0.5 if func == "TRI" else s["FUNCtion:RAMP:SYMMetry"] / 100
    linear, n = s["FUNCtion:ARBitrary:FILTer"] != "OFF", len(points)
    # The amplitude is that of the waveform's own span (Keysight community, thread 22573, on a 33522B).
    points = points * (2 / np.ptp(points)) if func == "ARB" and np.ptp(points) else points

    def value(c: np.ndarray) -> np.ndarray:
        if func == "SIN":
            return np.sin(2 * np.pi * c)
        if func in ("SQU", "PULS"):
            return np.where((c + 1e-9) % 1.0 < duty, 1.0, -1.0)
        if func in ("TRI", "RAMP"):  # phase 0 is the rising crossing of the offset
            p = (c + rise / 2) % 1.0
            return np.where(p < rise, 2 * p / max(rise, 1e-12) - 1, 1 - 2 * (p - rise) / max(1 - rise, 1e-12))
        x = c * (n if func == "ARB" else 1)
        whole = np.floor(x + 1e-6)
        i = whole.astype(np.int64) % n
        f = np.clip(x - whole, 0.0, 1.0) if linear and func == "ARB" else 0.0
        return points[i] * (1 - f) + points[(i + 1) % n] * f

    return value


def output_function(
    s: dict, points: np.ndarray, rate: float, t0: float, cycles0: float, start: float | None
) -> Callable[[np.ndarray], np.ndarray]:
    """The open output's volts over time: `t0` is when the present setting began (at `cycles0` cycles),
    `start` when the last triggered burst begins (None: none was triggered)."""
    middle, half = s["VOLTage:OFFSet"], s["VOLTage"] / 2 * (1 if s["OUTPut:POLarity"] == "NORM" else -1)
    steady = 0.0 if not s["OUTPut"] else middle if s["FUNCtion"] == "DC" else None
    until, value, phase, every = None, shape(s, points, rate), s["PHASe"] / 360, INF
    duration = s["BURSt:NCYCles"] / rate
    if steady is None and s["BURSt:STATe"]:
        phase = s["BURSt:PHASe"] / 360
        edge = 1e-8 if s["FUNCtion"] in ("SQU", "PULS") else 0.0  # a square wave rests below its first edge
        idle = middle + half * float(value(np.array([phase - edge]))[0])
        source, timer = s["TRIGger:SOURce"], s["TRIGger:TIMer"]
        if s["BURSt:MODE"] == "GAT":  # the gate input is open: low
            duration, start = INF, t0 if s["BURSt:GATE:POLarity"] == "INV" else None
        elif source in ("IMM", "TIM") and start is None and s["INITiate:CONTinuous"]:
            start = t0 + s["TRIGger:DELay"]
            every = max(s["BURSt:INTernal:PERiod"], duration)
            if source == "TIM":
                every = max(1.0, np.ceil(duration / timer - 1e-9)) * timer
        if start is None:
            steady = idle
        elif every == INF and duration < INF:
            until = start + duration

    def volts(t: np.ndarray) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        if steady is not None:
            return np.full(t.shape, steady)
        if not s["BURSt:STATe"]:
            return middle + half * value((t - t0) * rate + cycles0 + phase)
        since = t - start
        within = since if every == INF else since % every
        playing = (since >= 0) & (within * rate < s["BURSt:NCYCles"] - 1e-9 if duration < INF else True)
        return np.where(playing, middle + half * value(within * rate + phase), idle)

    if steady is not None or until is not None:
        volts.constant_from_s = -INF if until is None else until
    return volts


class Box:
    """The instrument; see the module's docstring."""

    def __init__(self) -> None:
        self.errors, self.esr, self.now, self.timing, self.key, self.uploads = [], 128, 0.0, None, None, 0
        self.waves = {EXP_RISE: (0, 1 - np.exp(-np.arange(100) / 20.0))}
        self.reset()
        self.refresh()

    def reset(self) -> None:
        self.s, self.selected = {key: row[1] for key, row in TABLE.items()}, EXP_RISE
        self.t0, self.cycles0, self.start, self.busy_until, self.armed = self.now, 0.0, None, -INF, 0

    def error(self, code: int) -> None:
        self.errors = [*self.errors, code] if len(self.errors) < 20 else [*self.errors[:19], -350]
        self.esr |= 32 if -200 < code <= -100 else 16 if -300 < code <= -200 else 8

    def message(self, data: bytes, now_s: float) -> bytes:
        """Execute one message received at bench time `now_s`; the reply without line end."""
        self.now, replies, path = now_s, [], ""
        try:
            commands = split(data.decode("latin-1"))
        except ScpiError as problem:
            commands = self.error(problem.args[0]) or []
        for header, params in commands:
            name = header.upper().removesuffix("?")
            if not name.startswith("*"):  # SCPI: a header without colon continues the path of the one before
                name = name[1:] if name.startswith(":") else path + name
                path = name[: name.rfind(":") + 1]
            try:
                reply = self.execute(name, header.endswith("?"), params)
                replies += [reply] if header.endswith("?") else []
            except ScpiError as problem:
                self.error(problem.args[0])
            except IndexError:  # a parameter is missing
                self.error(-109)
            except (TypeError, ValueError, AttributeError, ZeroDivisionError):  # a block for a number, 0 Hz
                self.error(-104)
            self.refresh()
        return ";".join(replies).encode("latin-1")

    def execute(self, name: str, query: bool, params: list) -> str:
        key = next(
            (
                k
                for regex, k in HEADERS
                if regex.fullmatch(name) and (k in TABLE or k in map(shortest, ACTIONS) or k.endswith("?") == query)
            ),
            None,
        )
        if key in REPLIES:
            return REPLIES[key]
        if key not in TABLE:
            if key is None or key in (COMMAND_ONLY if query else QUERY_ONLY):
                raise ScpiError(-113)
            return self.action(key, query, params, name)
        if query:
            return self.answer(key, params)
        if not params or len(params) > 1:
            raise ScpiError(-108 if params else -109)
        self.set(key, params[0])
        return ""

    def scale(self, key: str) -> float:
        """What a unit in a message is worth inside (open volts; degrees)."""
        if TABLE[key][0] == "v":
            return 1 + (0 if self.s["OUTPut:LOAD"] == INF else 50 / self.s["OUTPut:LOAD"])
        degrees = {"DEG": 1.0, "RAD": 180 / np.pi, "SEC": 360 * self.rate()}[self.s["UNIT:ANGLe"]]
        return degrees if key in ("PHASe", "BURSt:PHASe") else 1.0

    def limits(self, key: str) -> tuple[float, float]:
        low, high = TABLE[key][2]
        return low, 2e5 if key == "FREQuency" and self.s["FUNCtion"] in ("RAMP", "TRI") else high

    def crest(self) -> float:
        """Peak-to-peak volts per effective volt."""
        return {"SQU": 2.0, "PULS": 2.0, "RAMP": 12**0.5, "TRI": 12**0.5}.get(self.s["FUNCtion"], 8**0.5)

    def rate(self) -> float:
        """Cycles per second of the selected function (samples per second for noise and PRBS)."""
        s = self.s
        return {
            "ARB": s["FUNCtion:ARBitrary:SRATe"] / len(self.points()),
            "PRBS": s["FUNCtion:PRBS:BRATe"],
            "NOIS": 2 * s["FUNCtion:NOISe:BANDwidth"],
        }.get(s["FUNCtion"], s["FREQuency"])

    def points(self) -> np.ndarray:
        if self.s["FUNCtion"] in ("NOIS", "PRBS"):
            random = np.random.default_rng(33511).normal(size=65536) / 3
            return np.clip(random, -1, 1) if self.s["FUNCtion"] == "NOIS" else np.sign(random)
        return self.waves[self.selected][1]

    def answer(self, key: str, params: list) -> str:
        kind, value = TABLE[key][0], self.s[key]
        if kind in "bki":
            return f"+{value}" if kind == "i" else str(value)
        if kind == "q":
            return f'"{value}"'
        if params:
            value = self.limits(key)[keyword(params[0], "MINimum|MAXimum") == "MAX"]
        elif key == "FREQuency" and self.s["FUNCtion"] == "ARB":
            value = self.rate()
        value /= self.scale(key)
        if key == "VOLTage" and self.s["VOLTage:UNIT"] != "VPP":
            value /= self.crest()
            if self.s["VOLTage:UNIT"] == "DBM":
                value = 10 * np.log10(value**2 / self.s["OUTPut:LOAD"] / 1e-3)
        return nr3(value)

    def set(self, key: str, text: str) -> None:
        """Change one setting; a number outside the range is clipped with an error, as the guide says."""
        kind, _default, allowed = TABLE[key]
        if not isinstance(text, str):
            raise ScpiError(-104)
        if kind == "b":
            value = {"ON": 1, "1": 1, "OFF": 0, "0": 0}.get(text.upper())
            if value is None:
                raise ScpiError(-224)
        elif kind == "k":
            value = keyword(text, allowed)
            if key == "VOLTage:RANGe:AUTO":
                value = "1" if value in ("ON", "1") else "0"
        elif kind == "q":
            value = text.strip("\"'")
        else:
            value = self.number(key, text)
        if key == "VOLTage:UNIT" and value == "DBM" and self.s["OUTPut:LOAD"] == INF:
            raise ScpiError(-221)
        if key == "FREQuency" and self.s["FUNCtion"] == "ARB":
            key, value = "FUNCtion:ARBitrary:SRATe", value * len(self.points())
        self.s[key] = value
        if key == "FUNCtion" and self.s["FREQuency"] > self.limits("FREQuency")[1]:
            self.s["FREQuency"] = self.limits("FREQuency")[1]
            self.error(-221)
        if key == "OUTPut:LOAD" and value == INF and self.s["VOLTage:UNIT"] == "DBM":
            self.s["VOLTage:UNIT"] = "VPP"
            self.error(-221)
        self.settle(key)

    def number(self, key: str, text: str) -> float:
        low, high = self.limits(key) if TABLE[key][0] != "i" else TABLE[key][2]
        word = {
            "MIN": low,
            "MINIMUM": low,
            "MAX": high,
            "MAXIMUM": high,
            "DEF": TABLE[key][1],
            "DEFAULT": TABLE[key][1],
        }.get(text.upper())
        if word is not None:
            return word
        value = number(text)
        if value == INF and key in ("OUTPut:LOAD", "BURSt:NCYCles"):
            return INF
        unit = self.s["VOLTage:UNIT"] if key == "VOLTage" else "VPP"
        unit = next((u for u in ("VRMS", "DBM", "VPP") if text.upper().endswith(u)), unit)
        if unit == "DBM":
            value = (10 ** (value / 10) * 1e-3 * self.s["OUTPut:LOAD"]) ** 0.5
        value *= self.scale(key) * (1 if unit == "VPP" else self.crest())
        if not low * (1 - 1e-9 * np.sign(low)) <= value <= high * (1 + 1e-9 * np.sign(high)):
            self.error(-222)
        value = min(max(value, low), high)
        return int(value) if TABLE[key][0] == "i" else value

    def settle(self, key: str) -> None:
        """Keep amplitude and offset inside the output's range: the other one of the two gives way."""
        s, on = self.s, self.s["VOLTage:LIMit:STATe"]
        low, high = (s["VOLTage:LIMit:LOW"], s["VOLTage:LIMit:HIGH"]) if on else (-10.0, 10.0)
        half, middle = (0.0 if s["FUNCtion"] == "DC" else s["VOLTage"] / 2), s["VOLTage:OFFSet"]
        if middle + half <= high + 1e-9 and middle - half >= low - 1e-9:
            return
        self.error(-221)
        if key == "VOLTage:OFFSet" and half:
            s[key] = min(max(middle, low + 0.001), high - 0.001)
            s["VOLTage"] = 2 * min(high - s[key], s[key] - low)
        else:
            half = min(half, (high - low) / 2)
            s["VOLTage"] = 2 * half or s["VOLTage"]
            s["VOLTage:OFFSet"] = min(max(middle, low + half), high - half)

    def action(self, key: str, query: bool, params: list, header: str) -> str:
        """What is no plain setting."""
        s = self.s
        if key == "*RST":
            self.reset()
        elif key in ("*CLS", "*ESR"):
            esr, self.esr = self.esr, 0
            self.errors = [] if key == "*CLS" else self.errors
            return f"+{esr}"
        elif key == "*OPC":
            self.esr |= 0 if query else 1
            return "1"
        elif key == "*STB":
            status = (4 if self.errors else 0) | (32 if self.esr & s["*ESE"] else 0)
            return f"+{status | (64 if status & s['*SRE'] else 0)}"
        elif key == "SYSTem:ERRor":
            code = self.errors.pop(0) if self.errors else 0
            return f'{code:+d},"{TEXTS.get(code, "No error")}"'
        elif key in ("*TRG", "TRIGger", "INITiate", "ABORt", "PHASe:SYNChronize"):
            self.trigger(key)
        elif key == "DISPlay:TEXT:CLEar":
            s["DISPlay:TEXT"] = ""
        elif key.startswith("APPLy"):
            return self.apply(header.partition(":APPL")[2] or header, query, params)
        elif key.startswith("DATA") or key == "FUNCtion:ARBitrary":
            if key in ("DATA:ARBitrary", "DATA:ARBitrary:DAC", "FUNCtion:ARBitrary") and not (query or params):
                raise ScpiError(-109)
            return self.memory(key, query, params)
        elif key == "FUNCtion:ARBitrary:PTPeak":
            return self.answer("VOLTage", params) if query else self.set("VOLTage", params[0]) or ""
        elif key.startswith("FUNCtion:ARBitrary"):
            n, period = len(self.waves[self.selected][1]), key.endswith("PERiod")
            if query:
                value = s["FUNCtion:ARBitrary:SRATe"] / n
                return nr3(1 / value if period else value)
            value = number(params[0])
            self.set("FUNCtion:ARBitrary:SRATe", repr(n / value if period else n * value))
        else:  # VOLTage:HIGH and VOLTage:LOW
            unit = self.scale("VOLTage")
            ends = [s["VOLTage:OFFSet"] - s["VOLTage"] / 2, s["VOLTage:OFFSet"] + s["VOLTage"] / 2]
            top = int(key.endswith("HIGH"))
            if query:
                return nr3(ends[top] / unit)
            ends[top] = self.number("VOLTage:OFFSet", params[0])
            if ends[1] - ends[0] < 0.002 - 1e-9:  # the other level gives way
                self.error(-221)
                ends[1 - top] = ends[top] + (0.002 if top == 0 else -0.002)
            s["VOLTage"], s["VOLTage:OFFSet"] = ends[1] - ends[0], (ends[1] + ends[0]) / 2
            self.settle(key)
        return ""

    def trigger(self, key: str) -> None:
        s = self.s
        if key == "ABORt":
            self.start, self.busy_until, self.armed = None, -INF, 0
        elif key == "INITiate":
            self.armed = s["TRIGger:COUNt"]
        elif key == "PHASe:SYNChronize":
            self.t0, self.cycles0 = self.now, 0.0
        elif (
            (key == "*TRG" and s["TRIGger:SOURce"] != "BUS")
            or self.now < self.busy_until
            or not (s["INITiate:CONTinuous"] or self.armed)
        ):
            raise ScpiError(-211)
        elif s["BURSt:STATe"] and s["BURSt:MODE"] == "TRIG":
            self.armed = max(0, self.armed - 1)
            self.start = self.now + s["TRIGger:DELay"]
            self.busy_until = self.start + s["BURSt:NCYCles"] / self.rate()

    def apply(self, header: str, query: bool, params: list) -> str:
        if query:
            values = [self.answer(k, []) for k in ("FREQuency", "VOLTage", "VOLTage:OFFSet")]
            return f'"{self.s["FUNCtion"]} {",".join(values)}"'
        self.set("FUNCtion", header.rpartition(":")[2])
        for k in self.s:
            self.s[k] = 0 if TABLE[k][0] == "b" and k.endswith(":STATe") and k != "VOLTage:LIMit:STATe" else self.s[k]
        self.s["TRIGger:SOURce"] = "IMM"
        rate = "FUNCtion:ARBitrary:SRATe" if self.s["FUNCtion"] == "ARB" else "FREQuency"
        for k, text in zip((rate, "VOLTage", "VOLTage:OFFSet"), params, strict=False):
            if self.s["FUNCtion"] != "DC" or k == "VOLTage:OFFSet":
                self.set(k, text)
        self.s["OUTPut"] = 1
        return ""

    def memory(self, key: str, query: bool, params: list) -> str:
        """Waveform memory: names are kept in capitals."""
        name = params[0].strip("\"'").upper() if params and isinstance(params[0], str) else self.selected
        if key == "DATA:VOLatile:CLEar":
            self.waves, self.selected = {EXP_RISE: self.waves[EXP_RISE]}, EXP_RISE
        elif key == "DATA:VOLatile:CATalog":
            return ",".join(f'"{n}"' for n in self.waves)
        elif key == "DATA:VOLatile:FREE":
            return f"+{MEMORY - sum(len(w) for _, w in self.waves.values())}"
        elif key == "FUNCtion:ARBitrary" and query:
            return f'"{self.selected}"'
        elif key in ("FUNCtion:ARBitrary", "DATA:ATTRibute:POINts"):
            if name not in self.waves:
                raise ScpiError(785)
            self.selected = self.selected if query else name
            return f"+{len(self.waves[name][1])}"
        elif key == "DATA:SEQuence":
            rows = params[0].decode("latin-1").replace('"', "").upper().split(",") if params else []
            steps = [rows[i : i + 5] for i in range(1, len(rows), 5)]  # waveform, repeats, play control, marker, point
            if not steps or any(len(r) < 5 or r[0].strip() not in self.waves for r in steps):
                raise ScpiError(785 if steps else -109)
            self.store(
                rows[0].strip(),
                np.concatenate(
                    [
                        np.tile(self.waves[r[0].strip()][1], max(1, int(r[1])) if r[2].strip() == "REPEAT" else 1)
                        for r in steps
                    ]
                ),
            )
        else:
            data, scale = params[1:], 32767.0 if key.endswith("DAC") else 1.0
            if not data:
                raise ScpiError(-109)
            if isinstance(data[0], bytes):
                order = ">" if self.s["FORMat:BORDer"] == "NORM" else "<"
                size = 2 if scale > 1 else 4
                if len(data[0]) % size:
                    raise ScpiError(-161)
                points = np.frombuffer(data[0], order + ("i2" if scale > 1 else "f4")).astype(float) / scale
            else:
                points = np.array([number(v) for v in data]) / scale
            self.store(name, points)
        return ""

    def store(self, name: str, points: np.ndarray) -> None:
        if name in self.waves:
            raise ScpiError(786)
        if not np.all(np.abs(points) <= 1.0) or len(points) < SHORTEST:
            raise ScpiError(-222)
        if len(points) + sum(len(w) for _, w in self.waves.values()) > MEMORY:
            raise ScpiError(-225)
        self.uploads += 1
        self.waves[name] = (self.uploads, points)

    def refresh(self) -> None:
        """After a command: restart what it restarts, and make a new output function if the volts change."""
        s, rate = self.s, self.rate()
        burst = s["BURSt:STATe"] and s["FUNCtion"] != "DC"
        wave = (self.selected, self.waves[self.selected][0]) if s["FUNCtion"] == "ARB" else None
        shapes = (*(s[k] for k in s if k.startswith("FUNCtion") and not k.endswith("SRATe")), wave, burst)
        bursts = tuple(s[k] for k in s if k.startswith(("BURSt", "TRIG", "INITiate:C"))) if burst else ()
        timing = (shapes, bursts, rate)
        if timing != self.timing:
            smooth = self.timing and not burst and shapes == self.timing[0]  # a new rate alone keeps the phase
            self.cycles0 = self.cycles0 + (self.now - self.t0) * self.timing[2] if smooth else 0.0
            self.t0, self.start, self.busy_until, self.timing = self.now, None, -INF, timing
        key = (
            timing,
            self.t0,
            self.cycles0,
            self.start,
            *(s[k] for k in ("VOLTage", "VOLTage:OFFSet", "PHASe", "OUTPut:POLarity")),
        )
        key = "off" if not s["OUTPut"] else ("dc", s["VOLTage:OFFSet"]) if s["FUNCtion"] == "DC" else key
        if key != self.key:
            self.key = key
            self.function = output_function(dict(s), self.points(), rate, self.t0, self.cycles0, self.start)

    def output(self) -> Callable[[np.ndarray], np.ndarray]:
        """The open output's volts over bench time; the same object until a message changes the output."""
        return self.function
