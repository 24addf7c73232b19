"""USB-TMC instrument (USB Test and Measurement Class 1.0) as a PyUSB backend in place of libusb.

Everything above the transfers of the USB host controller is real: PyUSB, pyvisa-py's USB-TMC and the layers above. A message
that arrives while a reply is pending discards the reply, as IEEE 488.2 (6.3.2.3) requires.
"""

import array
import errno
import importlib
import struct
import sys
import time
from types import SimpleNamespace, TracebackType
from typing import Any, Literal, Self

import pyvisa_py.sessions
from usb.backend import IBackend, libusb1
from usb.core import USBError, USBTimeoutError

from sim_hardware.wires.port import MessagePort

VENDOR, PRODUCT, SERIAL = 0x2A8D, 0x1301, "MY00000001"
"""Of the one device on this bus."""

BULK_OUT, BULK_IN = 0x01, 0x82
PACKET = 512
HEADER = struct.Struct("<BBBxLBxxx")
COMMAND, REQUEST, TRIGGER = 1, 2, 128
"""MsgID of what is sent to the device (table 2)."""

CAPABILITIES, ABORT_IN = 7, 3
"""Control requests of the class (table 15) that the host makes."""

SUCCESS, NOT_IN_PROGRESS = 1, 0x81
END = 1
"""Attribute of the last transfer of a message."""

BUSY_S = 1e-4
"""Polling interval of a device without data."""


class UsbTmcBus(IBackend):  # type: ignore[misc]  # PyUSB has no types
    """The bus with the one device; within `with` it is there instead of libusb's.

    Args:
        speed: bench seconds per wall second, for answers that take the instrument time.
        command_s: bench seconds until the answer to any message is ready.
        taken: which transfers of a message the device takes. pyvisa-py 0.8.1 makes one of each packet: an SDG1032X loses a waveform
            without an error then (benchctrl at 0c6e51e), a 33622A hangs above 1 MB (pyvisa-py issue 286).
    """

    def __init__(
        self,
        instrument: MessagePort,
        speed: float = 1.0,
        command_s: float = 0.0,
        taken: Literal["all", "first", "last", "none"] = "all",
    ) -> None:
        super().__init__()
        self._instrument, self._speed, self._command_s = instrument, speed, command_s
        self._taken = taken
        self._begun: list[bytes] = []
        self._answer: tuple[float, bytes, bool] | None = None  # due, text, whether it ends there
        self._asked: tuple[int, int] | None = None  # bTag of the request that is to be answered, most bytes

    @property
    def resource(self) -> str:
        """VISA resource string."""
        return f"USB0::{VENDOR:#x}::{PRODUCT:#x}::{SERIAL}::0::INSTR"

    def __enter__(self) -> Self:
        self._before = libusb1.get_backend, dict(pyvisa_py.sessions.Session._session_classes)
        libusb1.get_backend = lambda *_, **__: self
        sys.modules.pop("pyvisa_py.usb", None)  # without libusb it had given up when it was imported
        importlib.import_module("pyvisa_py.usb")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        libusb1.get_backend, classes = self._before
        pyvisa_py.sessions.Session._session_classes.update(classes)

    # -- descriptors of the device (USB 2.0, 9.6) -------------------------------------------------------------------

    def enumerate_devices(self) -> list[str]:
        return ["device"] if self._instrument.connected else []

    def get_device_descriptor(self, dev: str) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x0200, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=64, idVendor=VENDOR, idProduct=PRODUCT, bcdDevice=0x0100, iManufacturer=0, iProduct=0,
            iSerialNumber=1, bNumConfigurations=1, address=1, bus=1, port_number=1, port_numbers=(1,), speed=3,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: str, config: int) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=32, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0,
            bmAttributes=0xC0, bMaxPower=0, extra_descriptors=(),
        )  # fmt: skip

    def get_interface_descriptor(self, dev: str, intf: int, alt: int, config: int) -> SimpleNamespace:
        if intf or alt:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=2,
            bInterfaceClass=0xFE, bInterfaceSubClass=3, bInterfaceProtocol=1, iInterface=0, extra_descriptors=(),
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev: str, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=(BULK_OUT, BULK_IN)[ep], bmAttributes=2,
            wMaxPacketSize=PACKET, bInterval=0, bRefresh=0, bSynchAddress=0, extra_descriptors=(),
        )  # fmt: skip

    # -- the host's side of it -------------------------------------------------------------------------------------------

    def open_device(self, dev: str) -> str:
        return dev

    def close_device(self, dev_handle: str) -> None: ...

    def set_configuration(self, dev_handle: str, config_value: int) -> None: ...

    def get_configuration(self, dev_handle: str) -> int:
        return 1

    def claim_interface(self, dev_handle: str, intf: int) -> None: ...

    def release_interface(self, dev_handle: str, intf: int) -> None: ...

    def is_kernel_driver_active(self, dev_handle: str, intf: int) -> bool:
        return False

    # -- transfers -------------------------------------------------------------------------------------------------------

    def ctrl_transfer(  # the names and the order are PyUSB's
        self, dev_handle: str, bmRequestType: int, bRequest: int, wValue: int, wIndex: int, data: Any, timeout: int
    ) -> int:
        self._check_connected()
        if bRequest == 6:  # a descriptor: only strings are requested this way
            text = struct.pack("<H", 0x0409) if wValue & 0xFF == 0 else SERIAL.encode("utf-16-le")
            answer = struct.pack("BB", len(text) + 2, 3) + text
        elif bRequest == CAPABILITIES:
            answer = bytes([SUCCESS]).ljust(0x18, b"\0")
        else:
            answer = bytes([NOT_IN_PROGRESS if bRequest == ABORT_IN else SUCCESS]).ljust(len(data), b"\0")
        answer = answer[: len(data)]
        data[: len(answer)] = array.array("B", answer)
        return len(answer)

    def bulk_write(self, dev_handle: str, ep: int, intf: int, data: Any, timeout: int) -> int:
        self._check_connected()
        kind, tag, _, size, attributes = HEADER.unpack_from(data.tobytes())
        if kind == REQUEST:
            self._asked = tag, size
            return len(data)
        self._begun.append(b"*TRG" if kind == TRIGGER else data.tobytes()[HEADER.size : HEADER.size + size])
        if kind == TRIGGER or attributes & END:
            message, self._answer = self._taken_message().removesuffix(b"\n"), None
            self._begun.clear()
            reply = self._instrument.handle(message.decode("latin-1")) if message else None
            if reply is not None:
                due_s = time.monotonic() + reply.wait_s(self._command_s, self._speed)
                self._answer = due_s, reply.data, reply.terminated
        return len(data)

    def _taken_message(self) -> bytes:
        if len(self._begun) == 1 or self._taken == "all":
            return b"".join(self._begun)
        return {"first": self._begun[0], "last": self._begun[-1]}.get(self._taken, b"")

    def bulk_read(self, dev_handle: str, ep: int, intf: int, buff: Any, timeout: int) -> int:
        given_up_s = time.monotonic() + timeout / 1000
        while self._asked is None or self._answer is None or self._answer[0] > time.monotonic():
            self._check_connected()
            if time.monotonic() > given_up_s:
                raise USBTimeoutError("Operation timed out", errno=errno.ETIMEDOUT)
            time.sleep(BUSY_S)
        (tag, most), (due_s, text, ended) = self._asked, self._answer
        part, rest = text[:most], text[most:]
        self._asked, self._answer = None, (due_s, rest, ended) if rest else None
        packed = HEADER.pack(REQUEST, tag, ~tag & 0xFF, len(part), END if ended and not rest else 0)
        packed += part + bytes(-len(part) % 4)
        buff[: len(packed)] = array.array("B", packed)
        return len(packed)

    def _check_connected(self) -> None:
        if not self._instrument.connected:
            raise USBError("No such device (it may have been disconnected)", errno=errno.ENODEV)
