"""Simulated LabJack T7 on its wire: Modbus TCP registers on one port, the packets of its stream on another.

It is not kinder than the real one: replies come in two pieces, a stream goes on until it is stopped or its buffer has overflown, and
requests for parts of registers, other ranges, or a stream that is too fast are rejected.
"""

import contextlib
import math
import selectors
import socket
import struct
from dataclasses import replace

from drivers import Clock, SharedTime
from sim_hardware.labjack import t7_registers as registers
from sim_hardware.labjack.t7_output import SimulatedT7Output
from sim_hardware.labjack.t7_registers import RegisterError, RegisterFile
from sim_hardware.labjack.t7_stream import T7StreamSource
from sim_hardware.nidaq import GROUND_CHANNEL, SampleRateError, SimulatedCard, actual_rate
from sim_hardware.plant import CardParameters, FaultState
from sim_hardware.wires import HOST, SelectorServer

CORE_HZ, MOST_TICKS = 40e6, 65536
"""Frequency of CORE_TIMER, and the longest scan interval in periods of the timebase, which is divided by ten for longer ones."""

POLL_S, IDLE_S = 0.002, 0.05
LATE_S = 1.0
"""Longest delay of a reader, bench seconds, before bench time waits for it."""

PAUSE_S = 20.0
"""Longest pause of the program without lost scans at raised speed, real time."""

START_S = 1.0
"""Time from power-up until the device has started, an assumption: meanwhile its outputs are at 0 V, and it does not answer."""

SEND_BYTES = 16_384
"""Send buffer, small: the simulated device's own buffer is what a late reader fills."""

_FRAME = struct.Struct(">HHHB")
_READ, _WRITE = 3, 16


class SimulatedT7(SelectorServer):
    """Serves a T7 on loopback until closed.

    Args:
        output: outputs of a T7 that plays the drives; its inputs are not connected.
        parameters: of the device; default: those of `card`.

    Attributes:
        silent: whether it accepts connections and answers nothing.
        wrong_transaction: whether its replies and packets have other numbers than expected.
        stream_peer_gone: whether the next packet ends the connection of the stream.
        port, stream_port: its TCP ports.
    """

    def __init__(
        self,
        card: SimulatedCard,
        clock: Clock,
        faults: FaultState,
        output: SimulatedT7Output | None = None,
        parameters: CardParameters | None = None,
    ) -> None:
        super().__init__()
        self.card, self.clock, self.faults, self._output = card, clock, faults, output
        self._parameters = parameters or card.parameters
        self._started_s: float | None = -math.inf
        """When the device has started, or will have; None without power."""
        self.silent = self.wrong_transaction = self.stream_peer_gone = False
        self.registers = RegisterFile(self._parameters)
        self.port = self.stream_port = 0
        self._source: T7StreamSource | None = None
        self._outgoing = b""
        self._listeners: list[socket.socket] = []
        self._clients: dict[socket.socket, bytes] = {}
        self._stream_clients: list[socket.socket] = []
        self._listen()
        self._start("simulated LabJack")

    @property
    def address(self) -> str:
        """Host and both ports, as the driver takes them."""
        return f"{HOST}:{self.port}:{self.stream_port}"

    @property
    def connections(self) -> int:
        """Number of clients of its registers."""
        return len(self._clients)

    def _listen(self) -> None:
        for port in (self.port, self.stream_port):
            listener = socket.create_server((HOST, port))
            listener.setblocking(False)
            self._selector.register(listener, selectors.EVENT_READ)
            self._listeners.append(listener)
        self.port, self.stream_port = (each.getsockname()[1] for each in self._listeners)

    def _wait_s(self) -> float:
        return IDLE_S if self._source is None else POLL_S

    def _apply_faults(self) -> None:
        if self._output is not None:
            self._apply_faults_of_source(self._output)
            return
        gone = self.faults.is_active("card-unplugged") or self.faults.is_active("grpc-gone")
        if gone and self._listeners:
            self._disconnect()  # it goes on streaming, without a connection
        elif not gone and not self._listeners:
            self._listen()

    def _apply_faults_of_source(self, output: SimulatedT7Output) -> None:
        """Apply the faults of the source's mains and answers; after mains returns, the device starts."""
        self.silent = self.faults.is_active("scpi-silent")
        powered = not self.faults.is_active("generator-power-off")
        if powered and self._started_s is None:
            self._started_s = self.clock.now() + START_S
        elif not powered and self._started_s is not None:
            self._started_s = None
            output.power_off()
        starting = self._started_s is None or self.clock.now() < self._started_s
        if not starting and self._started_s != -math.inf:
            self._started_s = -math.inf
            output.power_up()
        gone = starting or self.faults.is_active("scpi-dropped")
        if gone and self._listeners:
            self._disconnect()
        elif not gone and not self._listeners:
            self._listen()

    def _disconnect(self) -> None:
        for sock in [*self._clients, *self._stream_clients]:
            self._drop(sock)
        for listener in self._listeners:
            self._selector.unregister(listener)
            listener.close()
        self._listeners.clear()

    def _drop(self, sock: socket.socket) -> None:
        self._clients.pop(sock, None)
        if sock in self._stream_clients:
            self._stream_clients.remove(sock)
        self._selector.unregister(sock)
        sock.close()

    def _serve(self, sock: socket.socket) -> None:
        if sock in self._listeners:
            client, _ = sock.accept()
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if sock is self._listeners[0]:
                self._clients[client] = b""
            else:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BYTES)
                client.setblocking(False)
                self._stream_clients.append(client)
            self._selector.register(client, selectors.EVENT_READ)
            return
        try:
            data = sock.recv(65536)
        except OSError:
            data = b""
        if not data:
            self._drop(sock)
        elif sock in self._clients and not self.silent:
            self._clients[sock] += data
            with contextlib.suppress(OSError):
                self._answer(sock)

    def _answer(self, sock: socket.socket) -> None:
        """Answer the complete requests of a client."""
        while len(self._clients[sock]) >= _FRAME.size:
            transaction, _, length, unit = _FRAME.unpack_from(self._clients[sock])
            end = 6 + length
            if len(self._clients[sock]) < end:
                return
            request, self._clients[sock] = self._clients[sock][_FRAME.size : end], self._clients[sock][end:]
            try:
                reply = self._execute(request)
            except RegisterError as error:
                self.registers.values[registers.LAST_ERROR] = error.code
                reply = bytes([request[0] | 0x80, 2 if error.code == registers.UNKNOWN_REGISTER else 4])
            number = (transaction + self.wrong_transaction) & 0xFFFF
            sock.sendall(_FRAME.pack(number, 0, 1 + len(reply), unit))  # two pieces, as TCP may deliver any reply
            sock.sendall(reply)

    def _execute(self, request: bytes) -> bytes:
        function, address, count = struct.unpack_from(">BHH", request)
        if function == _READ:
            self.registers.values[registers.TIMER] = int(self.clock.now() * CORE_HZ) & 0xFFFFFFFF
            if self._output is not None:
                self.registers.values |= {each: self._output.level_v(each) for each in registers.DACS}
                self.registers.values[registers.ENABLE] = int(self._output.is_playing)
            data = self.registers.read(address, count)
            return bytes([function, len(data)]) + data
        if function != _WRITE or request[5] != 2 * count or len(request) != 6 + 2 * count:
            raise RegisterError(registers.BAD_FUNCTION)
        if address == registers.OUT_BUFFER and self._output is not None:
            self._output.fill(struct.unpack(f">{count // 2}f", request[6:]))
            return request[:5]
        for register, value in self.registers.unpacked(address, request[6:]).items():
            self._write(register, value)
        return request[:5]

    def _write(self, register: int, value: float) -> None:
        values = self.registers.values
        if self._output is not None and self._write_output(self._output, register, value):
            return
        if register == registers.ENABLE:
            self._enable(bool(value))
        elif self._source is not None and (4000 <= register < 4400 or 40000 <= register < 42000):
            raise RegisterError(registers.STREAMING)
        elif register == registers.SCAN_RATE:
            with contextlib.suppress(SampleRateError):
                timebase_hz = self._parameters.timebase_hz
                while 0 < MOST_TICKS * value < timebase_hz:
                    timebase_hz /= 10
                value = actual_rate(replace(self._parameters, timebase_hz=timebase_hz), value, 1)
        values[register] = value

    def _write_output(self, output: SimulatedT7Output, register: int, value: float) -> bool:
        """Write a register of the outputs, or of a stream that plays one of them; return whether it is one."""
        values = self.registers.values
        if register in registers.DACS:
            output.set_level(register, value)
        elif register in registers.STREAM_OUT:
            if output.is_playing:
                raise RegisterError(registers.STREAMING)
            output.write(register, int(value))
        elif register == registers.TO_BOOTUP:
            output.power_up()
        elif register == registers.REBOOT and int(value) & 0xFFFF0000 == registers.REBOOT_KEY:
            output.power_off()
            self._started_s = self.clock.now() + START_S
        elif register == registers.ENABLE:
            if bool(value) == output.is_playing:
                raise RegisterError(registers.STREAMING if value else registers.NOT_RUNNING)
            if not value:
                output.stop()
            elif values[registers.CHANNELS] != 1 or values[registers.SCAN_LIST] != registers.OUT_SLOT:
                raise RegisterError(registers.NOT_STREAMED)
            else:
                output.start(values[registers.SCAN_RATE], int(values[registers.NUM_SCANS]))
        elif output.is_playing and 4000 <= register < 4400:
            raise RegisterError(registers.STREAMING)
        else:
            return False
        return True

    def _enable(self, on: bool) -> None:
        if not on:
            if self._source is None:
                raise RegisterError(registers.NOT_RUNNING)
            self._source, self._outgoing = None, b""
            return
        if self._source is not None:
            raise RegisterError(registers.STREAMING)
        values = {each: int(self.registers.values[each]) for each in self.registers.values}
        channels, buffer, packet = (values[k] for k in (registers.CHANNELS, registers.BUFFER, registers.PACKET))
        faulty = {
            registers.NO_CHANNEL: not 0 < channels <= 128,
            registers.BAD_TARGET: values[registers.TARGET] != 1,
            registers.BAD_TYPE: values[registers.DATA_TYPE] != 0,
            registers.BAD_BUFFER: buffer & (buffer - 1) != 0 or buffer > 32768,
            registers.BAD_PACKET: not 0 < packet <= 512,
        }
        if codes := [code for code, wrong in faulty.items() if wrong]:
            raise RegisterError(codes[0])
        addresses = [values[registers.SCAN_LIST + 2 * k] for k in range(channels)]
        if any(address % 2 or not 0 <= address <= 30 for address in addresses):
            raise RegisterError(registers.NOT_STREAMED)
        numbers = [GROUND_CHANNEL if address == 30 else address // 2 for address in addresses]
        rate_hz = self.registers.values[registers.SCAN_RATE]
        try:
            # The first scan comes one interval after the start (ljm_constants.json, STREAM_START_TIME_STAMP).
            run = self.card.start_acquisition(rate_hz, numbers, self.clock.now() + 1 / max(rate_hz, 1e-3))
        except SampleRateError:
            raise RegisterError(registers.TOO_FAST) from None
        self.registers.values[registers.STAMP] = int(run.start_time_s * CORE_HZ) & 0xFFFFFFFF
        self._outgoing = b""
        buffer_scans = (buffer or 4096) // 2 // channels
        if getattr(self.clock, "shared", None) is not None:
            # At raised speed a pause of the program counts many times.
            buffer_scans = max(buffer_scans, round(PAUSE_S * getattr(self.clock, "speed", 1.0) * run.rate_hz))
        self._source = T7StreamSource(run, max(packet // channels, 1), buffer_scans, self.clock, self.faults)

    def _advance(self) -> None:
        """Send what the connection takes; the rest stays in the device's buffer."""
        source = self._source
        if source is None or self.silent:
            return
        source.advance(blocked=bool(self._outgoing) or not self._stream_clients)
        if not self._stream_clients:
            return
        client = self._stream_clients[-1]
        try:
            if self.stream_peer_gone:
                self.stream_peer_gone = False
                raise ConnectionResetError
            while not source.ended or self._outgoing:
                self._outgoing = self._outgoing or self._numbered(source.packets())
                if not self._outgoing:
                    break
                self._outgoing = self._outgoing[client.send(self._outgoing) :]
                self._let_time_run(source)
        except BlockingIOError:
            return
        except OSError:
            self._drop(client)
        if source.ended and not self._outgoing:
            self._source, self.registers.values[registers.ENABLE] = None, 0

    def _let_time_run(self, source: T7StreamSource) -> None:
        """At raised speed, let bench time run slightly beyond the next packet; called while the reader takes packets."""
        shared: SharedTime | None = getattr(self.clock, "shared", None)
        if shared is not None:
            shared.wait_at(source.read_until_s + LATE_S)

    def _numbered(self, packets: bytes) -> bytes:
        """Return the packets, the first with a wrong number if that is chosen."""
        if not packets or not self.wrong_transaction:
            return packets
        (number,) = struct.unpack_from(">H", packets)
        return struct.pack(">H", (number + 1) & 0xFFFF) + packets[2:]
